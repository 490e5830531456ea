"""Floor below what hangs over it, seen from about its own height; against scenes, the slow twin and turned cameras."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from furnished import CONFIG, GREY, ahead_of, box, empty, free_space_of, with_truth
from naive_level_things import naive_below
from numpy.typing import NDArray

from room_layout_ros.core.floor.floor_cells import FREE_CELL, UNKNOWN_CELL
from room_layout_ros.core.floor.floor_frame import floor_frame
from room_layout_ros.core.floor.floor_pixels import FLYING_PIXEL, NOTHING, OBSTACLE_PIXEL, WALL_PIXEL
from room_layout_ros.core.floor.level_things import below_level_things
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import CLUTTER, FLOOR, FRONT_WALL
from room_layout_ros.datasets.synthetic import KINECT, NOISES, SyntheticRoom, camera_pose, render
from room_layout_ros.datasets.synthetic.shapes import Solid

CORNER = (0.0, -2.0, 0.097)
SHAPE = (41, 41)
CAMERA = CameraIntrinsics(80, 60, 70.0, 72.0, 39.3, 30.2)
HEIGHT_M = 0.8

View = tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.int32]]


def pose(pitch: float, roll: float = 0.0) -> NDArray[np.float64]:
    normal = np.array([np.sin(roll), np.cos(roll) * np.cos(pitch), -np.sin(pitch)])
    return floor_frame(normal / np.linalg.norm(normal), HEIGHT_M)


def slabs(rng: np.random.Generator, T: NDArray[np.float64]) -> View:
    """Level tops on a leg at random places and heights, some pixels without depth, before a wall at 5 m."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    pixels = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    rays = pixels @ T[:3, :3]
    depth, thing = np.full(u.shape, 5.0), np.zeros(u.shape, np.bool_)
    for _ in range(6):
        level, (near, width, left) = rng.uniform(0.05, 1.4), rng.uniform((1.0, 0.2, -1.0), (3.0, 1.0, 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            for z in ((level - HEIGHT_M) / rays[..., 2], near / rays[..., 0]):  # its surface, its edge
                x, y, h = (rays[..., k] * z + (HEIGHT_M if k == 2 else 0.0) for k in range(3))
                on = (near - 1e-6 <= x) & (x < near + width) & (abs(y - left) < 0.4) & (abs(h - level) < 0.021)
                on &= (z > 0.2) & (z < depth)
                depth[on], thing[on] = z[on], True
        z = (near + width - 0.1) / rays[..., 0]
        y, h = rays[..., 1] * z, rays[..., 2] * z + HEIGHT_M
        on = (abs(y - left) < 0.05) & (h > 0.0) & (h < level) & (z > 0.2) & (z < depth)
        depth[on], thing[on] = z[on], True
    lost = thing & (rng.random(u.shape) < 0.2)
    inverse = np.where(lost, 0.0, 1.0 / depth).astype(np.float32)
    kind = np.where(thing & ~lost, OBSTACLE_PIXEL, WALL_PIXEL).astype(np.uint8)
    kind[thing & (rng.random(u.shape) < 0.1)] = FLYING_PIXEL
    kind[thing & (rng.random(u.shape) < 0.05)] = NOTHING  # as if over the robot
    kind[lost] = NOTHING
    labels = np.where(thing, CLUTTER, FLOOR).astype(np.uint8)
    labels[lost & (rng.random(u.shape) < 0.5)] = FRONT_WALL
    at = rays[..., :2] / np.maximum(inverse, 1e-6)[..., None]
    j, i = (np.floor((at[..., k] - CORNER[k]) / CORNER[2]).astype(int) for k in range(2))
    inside = (i >= 0) & (j >= 0) & (i < SHAPE[0]) & (j < SHAPE[1]) & (inverse > 0)
    return inverse, kind, labels, np.where(inside, i * SHAPE[1] + j, -1).astype(np.int32)


def hidden(
    view: View, camera: CameraIntrinsics, T: NDArray[np.float64], free: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    grid = np.where(np.ones(SHAPE, np.bool_) if free is None else free, FREE_CELL, UNKNOWN_CELL).astype(np.int8)
    return below_level_things(grid, *view, camera, T, CORNER) | (grid != FREE_CELL)


def with_table(length: float) -> SyntheticRoom:
    """A room with a table of 1.4 m times a length ahead, 75 cm high, its middle 70 cm ahead of the room's."""
    top, end = Solid(0.7, 0.0, 0.0, length, 1.4, 0.71, 0.75, 5, GREY, thing=1), 0.5 * length - 0.05
    return empty(top, *(box(0.7 + x, y, 0.05, 0.71) for x in (-end, end) for y in (-0.65, 0.65)))


@pytest.mark.parametrize("pitch", [-0.4, -0.1, 0.15])
def test_floor_is_hidden_where_the_slow_twin_says(pitch: float) -> None:
    some = 0
    for seed in range(8):
        T = pose(pitch)
        view = slabs(np.random.default_rng(seed), T)
        expected = naive_below(*view[:3], CAMERA, T, CORNER, SHAPE)
        closed = cv2.morphologyEx(expected.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
        np.testing.assert_array_equal(hidden(view, CAMERA, T), closed)
        free = np.random.default_rng(seed).random(SHAPE) < 0.7
        assert not (hidden(view, CAMERA, T, free) & free & ~closed).any()
        some += int(closed.sum())
    assert some > 100


@pytest.mark.parametrize("noise", ["clean", "kinect", "stereo"])
@pytest.mark.parametrize("height", [0.55, 0.72, 0.8])
def test_below_a_table_at_the_cameras_height_nothing_is_free(height: float, noise: str) -> None:
    """A table of 1.4 x 0.8 m, 75 cm high, of whose top a robot's low camera sees the edge alone."""
    sample = render(
        with_table(0.8), KINECT, camera_pose(-1.4, 0.0, height, 0.0, -0.15), NOISES[noise], np.random.default_rng(5)
    )
    found = free_space_of(sample.frame, with_truth(sample))
    # its top covers 1.7-2.5 m ahead, 0.7 m to either side
    assert not (ahead_of(found, (1.75, 2.45), 0.65) == FREE_CELL).any()
    assert (ahead_of(found, (1.2, 1.5), 0.3) == FREE_CELL).mean() > 0.7  # stereo loses some floor


@pytest.mark.parametrize("noise", ["clean", "kinect", "stereo"])
def test_below_a_table_that_is_seen_edge_on_nothing_is_free_up_to_its_farther_legs(noise: str) -> None:
    """A table of 1.4 x 1.5 m, 75 cm high, at whose edge both legs of its other end are seen to end."""
    sample = render(
        with_table(1.5), KINECT, camera_pose(-1.4, 0.0, 0.72, 0.0, -0.15), NOISES[noise], np.random.default_rng(5)
    )
    found = free_space_of(sample.frame, with_truth(sample))
    # its top covers 1.35-2.85 m ahead, 0.7 m to either side
    assert not (ahead_of(found, (1.4, 2.9), 0.6) == FREE_CELL).any()
    assert (ahead_of(found, (3.1, 3.8), 0.3) == FREE_CELL).mean() > 0.7


@pytest.mark.parametrize("label", [CLUTTER, FRONT_WALL])
def test_a_top_that_is_seen_flat_and_has_no_depth_hides_what_is_below_it_by_whatever_label(label: int) -> None:
    """Its few rows of pixels belong to the superpixels of the wall behind it as often as to its edge's."""
    sample = render(
        with_table(0.8), KINECT, camera_pose(-1.4, 0.0, 0.8, 0.0, -0.15), NOISES["kinect"], np.random.default_rng(5)
    )
    estimate, depth_m = with_truth(sample), sample.frame.depth_m
    assert depth_m is not None
    lost = np.isnan(depth_m) & (estimate.labels == CLUTTER)
    assert lost.sum() > 500
    found = free_space_of(sample.frame, replace(estimate, labels=np.where(lost, label, estimate.labels)))
    assert not (ahead_of(found, (1.75, 2.45), 0.65) == FREE_CELL).any()


@pytest.mark.parametrize(
    ("label", "rows", "hides"), [(FRONT_WALL, 3, True), (FRONT_WALL, 16, False), (CLUTTER, 16, True)]
)
def test_what_has_no_depth_over_a_tall_thing_is_its_own_only_by_its_label(label: int, rows: int, hides: bool) -> None:
    """A lamp that hangs 2 m ahead, 8 or 44 cm high, and five rows without depth over it."""
    size = (CAMERA.height, CAMERA.width)
    inverse, kind, labels = np.full(size, 0.2, np.float32), np.full(size, WALL_PIXEL), np.full(size, FRONT_WALL)
    lamp, lost = np.s_[36 - rows : 36, 35:45], np.s_[31 - rows : 36 - rows, 35:45]
    inverse[lamp], kind[lamp], labels[lamp] = 0.5, OBSTACLE_PIXEL, CLUTTER
    inverse[lost], kind[lost], labels[lost] = 0.0, 0, label
    view = inverse, kind.astype(np.uint8), labels.astype(np.uint8), np.full(size, -1, np.int32)
    behind = int(2.5 / CORNER[2])
    assert hidden(view, CAMERA, pose(0.0))[:, behind:].any() == hides


@pytest.mark.parametrize("noise", ["clean", "kinect", "stereo"])
def test_below_a_bed_nothing_is_free_up_to_where_it_ends(noise: str) -> None:
    """A bed of 1.4 x 2 m on legs of 32 cm, whose front alone a robot's low camera sees, and floor below it."""
    bed = Solid(0.9, 0.0, 0.0, 2.0, 1.4, 0.32, 0.62, 5, GREY, thing=1)
    room = empty(bed, *(box(0.9 + x, y, 0.06, 0.32) for x in (-0.95, 0.95) for y in (-0.65, 0.65)))
    sample = render(room, KINECT, camera_pose(-1.6, 0.0, 0.46, 0.0, -0.1), NOISES[noise], np.random.default_rng(5))
    found = free_space_of(sample.frame, with_truth(sample))
    # it covers 1.5-3.5 m ahead, 0.7 m to either side
    assert not (ahead_of(found, (1.55, 3.45), 0.65) == FREE_CELL).any()
    assert (ahead_of(found, (1.0, 1.3), 0.3) == FREE_CELL).mean() > 0.7


def test_below_a_table_cut_off_by_the_picture_nothing_is_free() -> None:
    """A table of 80 x 80 cm on one leg, of whose underside the picture shows the farthest 25 cm at its top."""
    top = Solid(0.2, 0.0, 0.0, 0.8, 0.8, 0.70, 0.74, 5, GREY, thing=1)
    room = empty(top, box(0.2, 0.0, 0.06, 0.70))
    sample = render(room, KINECT, camera_pose(-1.3, 0.0, 0.38, 0.0, -0.24))
    found = free_space_of(sample.frame, with_truth(sample))
    # it covers 1.1-1.9 m ahead, 0.4 m to either side
    assert not (ahead_of(found, (1.15, 1.85), 0.3) == FREE_CELL).any()
    assert (ahead_of(found, (0.7, 0.95), 0.3) == FREE_CELL).all()


@pytest.mark.parametrize("height", [0.6, 0.7])
def test_below_a_desk_whose_front_rises_through_the_cameras_height_nothing_is_free(height: float) -> None:
    """A desk of 1.4 x 0.7 m with drawers 30 cm high along its front, the lower edge at 45 cm."""
    desk = Solid(0.4, 0.0, 0.0, 0.7, 1.4, 0.45, 0.75, 5, GREY, thing=1)
    room = empty(desk, *(box(0.4 + x, y, 0.06, 0.45) for x in (-0.3, 0.3) for y in (-0.65, 0.65)))
    sample = render(room, KINECT, camera_pose(-1.4, 0.0, height, 0.0, -0.15))
    found = free_space_of(sample.frame, with_truth(sample))
    # it covers 1.45-2.15 m ahead, 0.7 m to either side
    assert not (ahead_of(found, (1.5, 2.1), 0.65) == FREE_CELL).any()
    assert (ahead_of(found, (1.1, 1.25), 0.3) == FREE_CELL).all()
    assert (ahead_of(found, (2.8, 3.2), 0.3) == FREE_CELL).mean() > 0.5


@pytest.mark.parametrize("noise", ["clean", "kinect"])
def test_below_a_cupboard_cut_off_by_two_sides_of_the_picture_nothing_is_free(noise: str) -> None:
    """Of a cupboard of 1.1 x 0.8 m that hangs 70 cm over the floor the picture shows 50 cm of its front."""
    cupboard = Solid(0.7, -1.05, 0.0, 0.8, 1.1, 0.70, 1.7, 5, GREY, thing=1)
    sample = render(
        empty(cupboard), KINECT, camera_pose(-1.4, 0.0, 1.2, 0.0, -0.3), NOISES[noise], np.random.default_rng(5)
    )
    found = free_space_of(sample.frame, with_truth(sample))
    # it covers 1.7-2.5 m ahead, 0.5-1.6 m to the right
    assert not (ahead_of(found, (1.75, 2.45), 0.2, left=-0.75) == FREE_CELL).any()
    assert (ahead_of(found, (1.5, 2.4), 0.3) == FREE_CELL).all()


@pytest.mark.parametrize("robot_m", [0.7, 0.5])
@pytest.mark.parametrize(
    ("depth_m", "bottom", "top", "height", "pitch"),
    [(0.9, 0.30, 0.75, 0.50, -0.05), (0.9, 0.45, 0.75, 0.60, -0.15)],
    ids=["chest", "desk"],
)
def test_floor_below_what_is_higher_than_the_robot_is_not_free(
    depth_m: float, bottom: float, top: float, height: float, pitch: float, robot_m: float
) -> None:
    """A robot of 70 or 50 cm does not fit below, though what rises over it is no obstacle."""
    sample = render(
        empty(Solid(0.5, 0.0, 0.0, depth_m, 1.4, bottom, top, 5, GREY, thing=1)),
        KINECT,
        camera_pose(-1.4, 0.0, height, 0.0, pitch),
    )
    found = free_space_of(sample.frame, with_truth(sample), replace(CONFIG, robot_height_m=robot_m))
    middle = 1.9
    assert not (ahead_of(found, (middle - depth_m / 2 + 0.05, middle + depth_m / 2 - 0.05), 0.6) == FREE_CELL).any()
    assert (ahead_of(found, (1.0, 1.3), 0.3) == FREE_CELL).mean() > 0.7


@pytest.mark.parametrize("roll", [-0.35, -0.17, 0.17, 0.35])
def test_a_table_seen_by_a_rolled_camera_hides_the_floor_below(roll: float) -> None:
    """Of a top that is seen flat and askew pixels seem to hang between near and far."""
    room = empty(Solid(0.8, 0.0, 0.0, 1.0, 1.0, 0.68, 0.72, 5, GREY, thing=1))
    sample = render(room, KINECT, camera_pose(-1.4, 0.0, 0.78, 0.0, -0.15, roll))
    found = free_space_of(sample.frame, with_truth(sample))
    assert not (ahead_of(found, (1.75, 2.65), 0.45) == FREE_CELL).any()
    assert (ahead_of(found, (1.2, 1.5), 0.2) == FREE_CELL).mean() > 0.7


def test_what_the_side_cuts_off_goes_on_beside_the_picture() -> None:
    """A camera that looks down sees floor at the picture's side, and not what hangs over it."""
    room = empty(Solid(0.4, 1.35, 0.0, 0.8, 1.6, 0.71, 0.75, 5, GREY, thing=1))
    sample = render(room, KINECT, camera_pose(-1.4, 0.0, 0.85, 0.0, -0.3), NOISES["kinect"], np.random.default_rng(5))
    found = free_space_of(sample.frame, with_truth(sample))
    assert not (ahead_of(found, (1.45, 2.15), 0.7, 1.35) == FREE_CELL).any()
    assert (ahead_of(found, (1.2, 2.2), 0.3) == FREE_CELL).mean() > 0.9


@pytest.mark.parametrize("height", [0.71, 0.73, 0.75])
def test_a_table_seen_from_its_end_may_be_twice_as_long_as_wide(height: float) -> None:
    """Of a top at the camera's height the edge alone is seen, here the short one: 0.9 of 0.9 x 1.6 m."""
    sides = [(x, y) for x in (-0.75, 0.75) for y in (-0.4, 0.4)]
    top = Solid(0.8, 0.0, 0.0, 1.6, 0.9, 0.71, 0.75, 5, GREY, thing=1)
    room = empty(top, *(box(0.8 + x, y, 0.05, 0.71) for x, y in sides))
    sample = render(room, KINECT, camera_pose(-1.4, 0.0, height, 0.0, -0.25))
    found = free_space_of(sample.frame, with_truth(sample))
    # it covers 1.4-3.0 m ahead, 0.45 m to either side
    assert not (ahead_of(found, (1.45, 2.95), 0.4) == FREE_CELL).any()
    assert (ahead_of(found, (1.0, 1.25), 0.3) == FREE_CELL).mean() > 0.7
