"""Room and free space of cameras on their side and upside down."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from furnished import CONFIG, with_truth

from room_layout_ros.core.cuboids import compute_object_cuboids
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.floor.floor_plane import FloorPlane
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.freespace import FREE_CELL, compute_free_space
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.core.upright import Turn
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import KINECT, NOISES, camera_pose, random_scene, render


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator()


LEFT = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter turn of the picture to the left: what was at the right is up, what was down is at the right."""


def sample_of(noise: str) -> Sample:
    rng = np.random.default_rng(7)
    return render(random_scene(rng), KINECT, camera_pose(-1.4, 0.3, 0.8, 0.1, -0.2), NOISES[noise], rng)


def turned(sample: Sample, quarters: int) -> tuple[RgbdFrame, dict[str, Any]]:
    """Frame of a camera that hangs turned, and what its estimate has else than with_truth(sample)."""
    frame, truth = sample.frame, with_truth(sample)
    assert truth.cuboid is not None
    camera, R = frame.camera, truth.cuboid.R_room_camera
    for _ in range(quarters):
        c = camera
        camera = CameraIntrinsics(c.height, c.width, c.fy, c.fx, c.cy, c.width - 1 - c.cx)
        R = R @ LEFT.T

    def image(pixels: Any) -> Any:
        return np.ascontiguousarray(np.rot90(pixels, quarters))

    other: dict[str, Any] = {name: image(getattr(truth, name)) for name in ("layout", "labels", "superpixels")}
    other.update(R_room_camera=R, cuboid=RoomCuboid(R, truth.cuboid.distances))
    return RgbdFrame(camera, image(frame.color), image(frame.depth_m)), other


@pytest.mark.parametrize("given", [False, True], ids=["", "height given"])
@pytest.mark.parametrize("noise", ["clean", "kinect", "nyu8"])
def test_a_turned_camera_sees_the_same_floor(noise: str, given: bool) -> None:
    sample = sample_of(noise)
    found = []
    for quarters in range(4):
        frame, other = turned(sample, quarters)
        estimate = replace(with_truth(sample), **other)
        floor = FloorPlane(other["R_room_camera"][1], 0.81) if given else None
        geometry = compute_depth_geometry(frame, CONFIG)
        assert geometry is not None
        space = compute_free_space(geometry, estimate, CONFIG, floor, frame.color)
        assert space is not None
        found.append(space)
        boxes = compute_object_cuboids(geometry, estimate, space, CONFIG)
        assert len(boxes) > 0
    first = found[0]
    assert (first.grid == FREE_CELL).sum() > 300
    for quarters, space in enumerate(found):
        back = np.linalg.matrix_power(LEFT, quarters)
        np.testing.assert_array_equal(space.grid, first.grid)
        np.testing.assert_allclose(back.T @ space.T_camera_floor[:3], first.T_camera_floor[:3], atol=1e-9)
        np.testing.assert_allclose(space.obstacles @ back, first.obstacles, atol=1e-5)
        np.testing.assert_allclose(space.floor @ back, first.floor, atol=1e-5)
        np.testing.assert_allclose(space.scan.ranges_m, first.scan.ranges_m, atol=1e-6)


@pytest.mark.parametrize("roll", [-170.0, -100.0, -46.0, -44.0, 0.0, 30.0, 44.0, 46.0, 134.0, 136.0, 180.0])
def test_after_the_turn_down_is_nearest_to_down_in_the_picture(roll: float) -> None:
    angle = np.deg2rad(roll)
    down = np.array([np.sin(angle), np.cos(angle), 0.0])
    upright = Turn.upright(down).rotation @ down
    assert upright[1] >= abs(upright[0]) - 1e-9


@pytest.mark.parametrize("down", [(0.0, 0.0, 1.0), (np.nan, np.nan, np.nan)])
def test_no_turn_without_a_down_in_the_picture(down: tuple[float, float, float]) -> None:
    assert Turn.upright(np.array(down)).quarters == 0


@pytest.mark.parametrize("sees", ["depth", "colour"])
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_where_gravity_is_known_a_turned_camera_finds_the_same_room(
    estimator: LayoutEstimator, quarters: int, sees: str
) -> None:
    sample = sample_of("kinect")
    frame, other = turned(sample, quarters)
    upright = sample.frame
    if sees == "colour":
        frame, upright = frame.without_depth(), upright.without_depth()
    down = with_truth(sample).R_room_camera[1]
    first = estimator.estimate(upright, TemporalPrior(gravity=down))
    found = estimator.estimate(frame, TemporalPrior(gravity=other["R_room_camera"][1]))
    back = np.linalg.matrix_power(LEFT, quarters)
    for name in ("layout", "labels", "furniture", "superpixels"):
        np.testing.assert_array_equal(np.rot90(getattr(found, name), -quarters), getattr(first, name), name)
    assert first.cuboid is not None
    assert found.cuboid is not None
    np.testing.assert_allclose(found.cuboid.R_room_camera @ back, first.cuboid.R_room_camera, atol=1e-9)
    np.testing.assert_allclose(found.cuboid.distances, first.cuboid.distances)
    assert [p.face for p in found.polygons] == [p.face for p in first.polygons]
    again = estimator.estimate(frame, replace(next_prior(found), gravity=other["R_room_camera"][1]))
    assert again.cuboid is not None
    np.testing.assert_allclose(again.cuboid.R_room_camera, found.cuboid.R_room_camera, atol=0.02)
