"""Depth registered to another camera: equal to the obvious way, right on analytic rooms, refused where it must be."""

from __future__ import annotations

import naive_registration
import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.registration import register_depth
from room_layout_ros.node_config import parse_pose

SMALL = CameraIntrinsics(16, 12, 14.0, 14.0, 7.5, 5.5)
WIDE = CameraIntrinsics(24, 18, 21.0, 20.0, 12.0, 8.0)


def test_a_camera_registered_to_itself_is_unchanged(rng: np.random.Generator) -> None:
    depth_m = rng.uniform(0.5, 4.0, (12, 16)).astype(np.float32)
    depth_m[3, 4] = np.nan
    registered = register_depth(depth_m, SMALL, SMALL, np.eye(4))
    np.testing.assert_array_equal(np.isnan(registered), np.isnan(depth_m))
    np.testing.assert_allclose(registered, depth_m, rtol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_the_kernel_equals_the_naive_way(seed: int) -> None:
    chance = np.random.default_rng(seed)
    depth_m = chance.uniform(0.8, 3.0, (12, 16)).astype(np.float32)
    depth_m[chance.random((12, 16)) < 0.2] = chance.choice([np.nan, 0.0, -1.0, np.inf])
    quaternion = np.array([0, 0, 0, 1]) + chance.normal(0, 0.05, 4)
    T = parse_pose(" ".join(map(str, [*chance.normal(0, 0.05, 3), *quaternion])))
    expected = naive_registration.register_depth(depth_m, SMALL, WIDE, T)
    np.testing.assert_allclose(register_depth(depth_m, SMALL, WIDE, T), expected, rtol=1e-5)


def room_seen_by(camera: CameraIntrinsics, T_first_camera: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the depth of a box room, given in the first camera's frame, as a camera at that pose sees it."""
    distances = np.array([1.2, 1.3, 1.8, 3.5, 2.2])
    position = T_first_camera[:3, 3]
    moved = distances + np.array([position[1], -position[1], position[0], -position[2], -position[0]])
    return RoomCuboid(T_first_camera[:3, :3].copy(), moved).depth(camera)


def test_an_analytic_room_is_seen_as_the_colour_camera_sees_it() -> None:
    depth_camera = CameraIntrinsics(640, 480, 500.0, 500.0, 319.5, 239.5)
    color_camera = CameraIntrinsics(800, 600, 700.0, 700.0, 401.0, 297.0)
    T_color_depth = parse_pose("0.05 0.01 -0.01 0.01 0.02 0.005 1")
    truth = room_seen_by(color_camera, np.eye(4))
    registered = register_depth(room_seen_by(depth_camera, T_color_depth), depth_camera, color_camera, T_color_depth)
    seen = np.isfinite(registered)
    assert seen.mean() > 0.9
    assert seen[100:500, 100:700].mean() > 0.999, "no holes"
    error = np.abs(registered - truth)[seen]
    assert np.quantile(error, 0.99) < 0.02
    assert np.median(error) < 0.003


@pytest.mark.parametrize("offset_m", [-0.05, 0.05])
def test_a_floor_that_is_seen_flat_has_no_empty_rows(offset_m: float) -> None:
    """The colour camera is above or below the depth camera, both 25 cm over the floor: its rows part or overlap."""
    camera = CameraIntrinsics(320, 240, 260.0, 260.0, 159.5, 119.5)
    T_color_depth = np.eye(4)
    T_color_depth[1, 3] = offset_m
    room = RoomCuboid(np.eye(3), np.array([2.0, 0.25, 3.0, 5.0, 3.0]))
    seen_below = RoomCuboid(np.eye(3), room.distances + [offset_m, -offset_m, 0.0, 0.0, 0.0])
    registered = register_depth(seen_below.depth(camera), camera, camera, T_color_depth)
    truth, inner = room.depth(camera), np.s_[24:190, 20:300]  # what both see
    assert np.isfinite(registered[inner]).all()
    off = np.abs(registered - truth)[inner] / truth[inner]
    assert np.quantile(off, 0.99) < 0.06


def test_what_is_in_front_hides_what_is_behind() -> None:
    depth_m = np.full((12, 16), 4.0, np.float32)
    depth_m[:, 6:10] = 1.0
    T = np.eye(4)
    T[0, 3] = 0.15  # the colour camera stands to the left: the near strip moves right over the wall
    registered = register_depth(depth_m, SMALL, SMALL, T)
    near = registered[6] < 2.0
    assert near.sum() == 4
    np.testing.assert_array_equal(np.flatnonzero(near), np.arange(8, 12))


def test_a_transform_that_is_not_rigid_is_refused() -> None:
    with pytest.raises(ValueError, match="not rigid"):
        register_depth(np.ones((12, 16), np.float32), SMALL, SMALL, 2.0 * np.eye(4))


def test_an_image_of_another_camera_is_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(5, 5\)"):
        register_depth(np.ones((5, 5), np.float32), SMALL, SMALL, np.eye(4))


def test_a_pose_is_a_translation_and_a_rotation() -> None:
    half = np.sqrt(0.5)
    pose = parse_pose(f"1 2 3 0 0 {2 * half} {2 * half}")  # a quarter turn about z, quaternion of length 2
    np.testing.assert_allclose(pose, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("text", ("1 2 3", "1 2 3 0 0 0 0", "a b c d e f g", "nan 0 0 0 0 0 1", "1,2,3,0,0,0,1"))
def test_what_is_no_pose_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="must be seven numbers"):
        parse_pose(text)


@pytest.mark.parametrize(("depth_px", "color_px"), [((80, 60), (1920, 1080)), ((160, 120), (3840, 2160))])
def test_a_coarse_sensor_fills_the_picture_of_a_fine_camera(
    depth_px: tuple[int, int], color_px: tuple[int, int]
) -> None:
    """A pixel of depth covers 19 of colour in either direction."""
    (width, height), (wide, high) = depth_px, color_px
    coarse = CameraIntrinsics(width, height, 0.75 * width, 0.75 * width, (width - 1) / 2, (height - 1) / 2)
    fine = CameraIntrinsics(wide, high, 0.58 * wide, 0.58 * wide, (wide - 1) / 2, (high - 1) / 2)
    T = np.eye(4)
    T[0, 3] = 0.02
    seen = register_depth(np.full((height, width), 2.0, np.float32), coarse, fine, T)
    assert np.isfinite(seen).mean() > 0.6
