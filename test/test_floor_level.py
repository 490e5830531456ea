"""What lies below a plane that fits: a wall mirrored in a glossy floor, or the front of a stage taken for floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, GREY, ahead_of, empty, free_space_of, with_truth
from numpy.typing import NDArray

from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.floor.floor_cells import FREE_CELL
from room_layout_ros.core.freespace import compute_free_space
from room_layout_ros.core.labels import CLUTTER, FLOOR
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import KINECT, NOISES, camera_pose, render
from room_layout_ros.datasets.synthetic.shapes import Solid

PATCH_M = (1.45, 1.85)
"""From the camera over the floor; as much to either side."""


def mirrored(sample: Sample) -> NDArray[np.float32]:
    """(H, W) depth: in a patch of 40 x 50 cm of the floor that of the front wall, carried on below the floor."""
    frame, truth = sample.frame, sample.truth
    assert frame.depth_m is not None
    assert truth is not None
    assert truth.cuboid is not None
    R, distances = truth.cuboid.R_room_camera, truth.cuboid.distances
    rays = frame.camera.rays() @ R.T  # right, down, ahead
    floor = rays * (distances[1] / np.maximum(rays[..., 1], 1e-6))[..., None]
    ahead = (floor[..., 2] > PATCH_M[0]) & (floor[..., 2] < PATCH_M[1]) & (np.abs(floor[..., 0]) < 0.25)
    wall = distances[3] / np.maximum(rays[..., 2], 1e-6)
    return np.where(ahead & (truth.labels == FLOOR), wall, frame.depth_m).astype(np.float32)


@pytest.mark.parametrize("noise", ["clean", "kinect", "stereo"])
def test_the_mirror_image_of_a_wall_is_no_lower_floor(noise: str) -> None:
    sample = render(empty(), KINECT, camera_pose(-1.4, 0.0, 1.2, 0.0, -0.3), NOISES[noise], np.random.default_rng(5))
    depth_m = mirrored(sample)
    assert sample.frame.depth_m is not None
    assert (depth_m > np.nan_to_num(sample.frame.depth_m) + 1.0).sum() > 0.01 * depth_m.size
    found = free_space_of(replace(sample.frame, depth_m=depth_m), with_truth(sample))
    assert abs(found.camera_height_m - 1.2) < 0.02
    assert not (ahead_of(found, PATCH_M, 0.2) == FREE_CELL).any()
    assert (ahead_of(found, (2.2, 3.0), 0.5) == FREE_CELL).mean() > 0.7


@pytest.mark.parametrize("seed", range(4))
def test_the_front_of_a_stage_is_no_mirror_image(seed: int) -> None:
    """A stage of 72 cm begins 58 cm ahead, its top is labelled floor, and the cuboid's floor lies on it."""
    stage = Solid(0.08, 0.0, 0.0, 1.8, 2.4, 0.0, 0.72, 5, GREY, thing=1)
    pose, rng = camera_pose(-1.4, 0.0, 1.38, 0.0, -0.77), np.random.default_rng(seed)
    sample = render(empty(stage), KINECT, pose, NOISES["kinect"], rng)
    estimate, geometry = with_truth(sample), compute_depth_geometry(sample.frame, CONFIG)
    assert estimate.cuboid is not None
    assert geometry is not None
    distances = estimate.cuboid.distances - np.array([0.0, 0.72, 0.0, 0.0, 0.0])
    on_top = RoomCuboid(estimate.cuboid.R_room_camera, distances)
    labels = np.where(estimate.labels == CLUTTER, np.uint8(FLOOR), estimate.labels)
    found = compute_free_space(
        geometry, replace(estimate, labels=labels, cuboid=on_top), CONFIG, color=sample.frame.color
    )
    assert found is None or abs(found.camera_height_m - 1.38) < 0.05
