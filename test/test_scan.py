"""The scan covers what the camera sees however it is mounted, and ends at what stands, in the grid or beyond it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, box, empty, with_truth
from numpy.typing import NDArray

from room_layout_ros.core.floor.floor_frame import floor_frame, view_fan
from room_layout_ros.core.floor.floor_plane import FloorPlane
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.freespace import FreeSpace, free_space_of_frame
from room_layout_ros.datasets.synthetic import CLEAN, KINECT, KINECT_NOISE, SensorNoise, camera_pose, render
from room_layout_ros.datasets.synthetic.shapes import Solid


def seen_from(x: float, height: float, pitch: float, roll: float, *things: Solid) -> FreeSpace:
    sample = render(empty(*things), KINECT, camera_pose(x, 0.0, height, 0.0, pitch, roll), CLEAN)
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    floor = FloorPlane(sample.truth.down_camera, height, "parameters")
    found = free_space_of_frame(sample.frame, with_truth(sample), CONFIG, floor)
    assert found is not None
    return found


def bearings(points: NDArray[np.float32], T: NDArray[np.float64]) -> NDArray[np.float64]:
    local = (points - T[:3, 3]) @ T[:3, :3]
    return np.asarray(np.arctan2(local[:, 1], local[:, 0]))


@pytest.mark.parametrize(("height", "pitch", "roll"), [(1.2, -0.26, 0.0), (1.9, -0.6, 0.0), (1.2, -0.2, 1.57)])
def test_every_thing_that_is_seen_is_in_the_scan(height: float, pitch: float, roll: float) -> None:
    """A camera that looks down sees things to its sides far outside the angle that the picture's sides make."""
    things = [box(0.2, y, 0.2, 0.4) for y in (-0.9, -0.5, 0.0, 0.5, 0.9)]
    found = seen_from(-1.0, height, pitch, roll, *things)
    half = 0.5 * found.scan.angle_increment
    last = found.scan.angle_min + found.scan.angle_increment * (len(found.scan.ranges_m) - 1)
    angles = bearings(found.obstacles, found.T_camera_floor)
    assert len(angles) > 100
    assert angles.min() >= found.scan.angle_min - half
    assert angles.max() <= last + half


def test_a_level_cameras_fan_is_its_field_of_view() -> None:
    right, left = view_fan(KINECT, floor_frame(np.array([0.0, 1.0, 0.0]), 1.0))
    assert left == pytest.approx(np.arctan2(320, 525))
    assert right == pytest.approx(-np.arctan2(320, 525))


def posed(pitch_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """The floor frame of a camera that looks up by `pitch_deg`."""
    R = camera_pose(0.0, 0.0, 1.2, 0.0, np.deg2rad(pitch_deg), np.deg2rad(roll_deg))[:3, :3]
    return floor_frame(R.T @ (0.0, 0.0, -1.0), 1.2)


def bearings_ahead(camera: CameraIntrinsics, T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of the picture's points that lie ahead: of all corners of pixels, and of many points along its border."""
    u, v = np.meshgrid(np.arange(camera.width + 1) - 0.5, np.arange(camera.height + 1) - 0.5)
    part, left, top = np.linspace(0.0, 1.0, 5001), np.full(5001, -0.5), np.full(5001, -0.5)
    right, bottom = left + camera.width, top + camera.height
    across, down = part * camera.width - 0.5, part * camera.height - 0.5
    u, v = np.r_[u.ravel(), across, across, left, right], np.r_[v.ravel(), top, bottom, down, down]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1) @ T[:3, :3]
    rays = rays[rays[:, 0] > 1e-9]
    return np.asarray(np.arctan2(rays[:, 1], rays[:, 0]))


@pytest.mark.parametrize("pitch_deg", range(-50, 51, 5))
def test_of_a_usual_pose_the_fan_is_that_of_the_corners(pitch_deg: int) -> None:
    u, v = np.array([-0.5, 639.5, -0.5, 639.5]), np.array([-0.5, -0.5, 479.5, 479.5])
    rays = np.stack([(u - KINECT.cx) / KINECT.fx, (v - KINECT.cy) / KINECT.fy, np.ones(4)], axis=1)
    for roll_deg in range(-180, 181, 5):
        T = posed(pitch_deg, roll_deg)
        ahead, left, _ = (rays @ T[:3, :3]).T
        corners = np.arctan2(left, ahead)
        np.testing.assert_allclose(view_fan(KINECT, T), (corners.min(), corners.max()), rtol=0, atol=1e-12)


@pytest.mark.parametrize("pitch_deg", [-89, -75, -65, -55, 65])
def test_of_a_steep_and_rolled_camera_the_fan_holds_all_pixels_ahead(pitch_deg: int) -> None:
    coarse = CameraIntrinsics(64, 48, 52.5, 52.5, 31.5, 23.5)
    for roll_deg in range(-180, 181, 10):
        T = posed(pitch_deg, roll_deg)
        truth, (right, left) = bearings_ahead(coarse, T), view_fan(coarse, T)
        assert right <= truth.min() + 1e-9, f"roll {roll_deg}"
        assert left >= truth.max() - 1e-9, f"roll {roll_deg}"
        assert truth.min() - right < 0.02, f"roll {roll_deg}: too wide"
        assert left - truth.max() < 0.02, f"roll {roll_deg}: too wide"


def test_of_a_part_of_the_picture_with_nothing_ahead_the_fan_is_the_half_circle() -> None:
    """Rows from 400 on of a camera that looks down: the point below it is above them."""
    cut = replace(KINECT, height=80, cy=KINECT.cy - 400.0)
    T = posed(-85.0, 0.0)
    assert not len(bearings_ahead(cut, T))
    assert view_fan(cut, T) == (-np.pi / 2, np.pi / 2)


def test_of_a_camera_that_looks_straight_down_the_fan_is_the_half_circle() -> None:
    assert view_fan(KINECT, floor_frame(np.array([0.0, 0.0, 1.0]), 1.0)) == (-np.pi / 2, np.pi / 2)


@pytest.mark.parametrize("noise", [CLEAN, KINECT_NOISE])
def test_what_stands_beyond_the_grid_ends_a_beam(noise: SensorNoise) -> None:
    """A grid of 1.5 m, a cabinet at 2.1 m before a wall at 4.4 m."""
    sample = render(
        empty(box(0.9, 0.0, 0.6, 1.0)), KINECT, camera_pose(-1.5, 0.0, 1.2, 0.0, -0.3), noise, np.random.default_rng(2)
    )
    config = replace(CONFIG, free_space_forward_m=1.5, free_space_side_m=1.5)
    found = free_space_of_frame(sample.frame, with_truth(sample), config)
    assert found is not None
    angles = found.scan.angle_min + found.scan.angle_increment * np.arange(len(found.scan.ranges_m))
    ahead = found.scan.ranges_m[np.abs(angles) < 0.1]
    np.testing.assert_allclose(ahead, 2.1, atol=0.05)
    assert np.nanmax(found.scan.ranges_m) > 2.5, "beside it the wall is told"


def test_a_direction_of_down_that_no_floor_has_gives_no_height() -> None:
    sample = render(empty(), KINECT, camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35), CLEAN)
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    upside_down = FloorPlane(-sample.truth.down_camera, float("nan"), "parameters")
    assert free_space_of_frame(sample.frame, with_truth(sample), CONFIG, upside_down) is None
