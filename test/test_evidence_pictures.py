"""The pictures of the evidence say what the evidence says: vanishing points, horizon, offsets of planes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF, ROOM, look, seen_from_inside

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.depth_profiles import DepthProfiles
from room_layout_ros.core.evidence.pictures import (
    AXIS_COLORS,
    HORIZON_COLOR,
    SUPPORT_COLOR,
    VIOLATION_COLOR,
    draw_pencils,
    draw_planes,
)
from room_layout_ros.core.frame_evidence import FrameEvidence
from room_layout_ros.core.joint_problem import build_joint_problem
from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.superpixels import compute_superpixels

F64 = NDArray[np.float64]
POSES = {"turned": look(30.0, 12.0, 4.0), "straight ahead": look(0.0, 0.0), "looking down": look(10.0, 60.0)}


def pixels_of(image: NDArray[np.uint8], color: tuple[int, ...]) -> F64:
    """(n, 2) x and y of the pixels of a colour."""
    y, x = np.nonzero((image == np.array(color, np.uint8)).all(axis=2))
    return np.column_stack([x, y]).astype(np.float64)


@pytest.mark.parametrize("R", POSES.values(), ids=POSES)
def test_pencils_run_through_the_vanishing_points(R: F64) -> None:
    """A line through the vanishing point of an axis is a plane through it: its rays have one angle about the axis."""
    drawn = draw_pencils(np.zeros((240, 320, 3), np.uint8), R, HALF)
    for axis, color in enumerate(AXIS_COLORS):
        at = pixels_of(drawn, color)
        rays = np.column_stack([at, np.ones(len(at))]) @ np.linalg.inv(HALF.matrix).T @ R.T
        across = np.delete(rays, axis, axis=1)
        clear = np.linalg.norm(across, axis=1) > 0.15  # nearer to the point a pixel is more than a degree
        assert clear.sum() > 300
        angle = np.sort(np.rad2deg(np.arctan2(across[clear, 0], across[clear, 1])) % 180.0)
        gaps = np.diff(angle, append=angle[0] + 180.0)
        assert 4 <= (gaps > 3.0).sum() <= 8, "lines in view"


def test_the_horizon_is_where_rays_are_level() -> None:
    R = POSES["turned"]
    at = pixels_of(draw_pencils(np.zeros((240, 320, 3), np.uint8), R, HALF), HORIZON_COLOR)
    assert len(at) > 200
    rays = np.column_stack([at, np.ones(len(at))]) @ np.linalg.inv(HALF.matrix).T
    assert np.abs(HALF.fy * rays @ R[1]).max() < 1.5, "pixels off the horizon"
    down = draw_pencils(np.zeros((240, 320, 3), np.uint8), POSES["looking down"], HALF)
    assert len(pixels_of(down, HORIZON_COLOR)) == 0, "it is out of view"


@pytest.fixture(scope="module")
def profiles() -> DepthProfiles:
    frame, room = seen_from_inside(HALF)
    geometry = compute_depth_geometry(frame, EstimatorConfig())
    assert geometry is not None
    superpixels = compute_superpixels(frame.color, geometry.inverse_depth, EstimatorConfig())
    evidence = FrameEvidence(room.R_room_camera)
    found = build_joint_problem(HALF, superpixels, evidence, geometry, EstimatorConfig()).profiles
    assert found is not None
    return found


def chosen_column(row: NDArray[np.uint8], face: int) -> float:
    """Middle of the columns that are in the face's colour from top to bottom."""
    full = (row == LABEL_COLORS[face]).all(axis=2).mean(axis=0) > 0.9
    assert full.any()
    return float(np.nonzero(full)[0].mean())


def test_the_chosen_offset_of_an_exact_room_stands_at_the_peak_of_the_support(profiles: DepthProfiles) -> None:
    image = draw_planes(profiles, ROOM, (640, 480))
    far = draw_planes(profiles, 1.5 * ROOM, (640, 480))
    assert image.shape == (480, 640, 3)
    for k in range(5):
        row, moved = image[96 * k : 96 * (k + 1)], far[96 * k : 96 * (k + 1)]
        green = (moved == np.array(SUPPORT_COLOR, np.uint8)).all(axis=2).sum(axis=0)  # not under the line
        if profiles.support[k].max() < 0.01:
            continue  # hardly in view
        assert abs(chosen_column(row, k + 1) - float(np.argmax(green))) < 6
        assert chosen_column(moved, k + 1) - chosen_column(row, k + 1) == pytest.approx(
            639 * np.log(1.5) / np.log(15.0 / 0.2), abs=2
        )


def test_a_face_out_of_view_has_no_offset(profiles: DepthProfiles) -> None:
    absent = draw_planes(profiles, np.array([np.inf, 1.3, np.inf, 3.5, np.inf]), (640, 480))
    for k, seen in enumerate((False, True, False, True, False)):
        row = absent[96 * k : 96 * (k + 1)]
        assert bool(((row == LABEL_COLORS[k + 1]).all(axis=2).mean(axis=0) > 0.9).any()) == seen


def test_curves_stay_below_the_words_and_a_plane_that_nothing_lies_on_has_no_hill(profiles: DepthProfiles) -> None:
    empty = replace(profiles, support=1e-4 * profiles.support)
    for k, row in enumerate(np.split(draw_planes(empty, np.full(5, np.inf), (640, 480)), 5)):
        assert not (row[:16] == np.array(VIOLATION_COLOR, np.uint8)).all(axis=2).any(), f"face {k}"
        assert (row == np.array(SUPPORT_COLOR, np.uint8)).all(axis=2).sum() < 640, f"face {k}"
