"""Axes from lines alone: exact on synthetic lines, stable among clutter, right on real frames."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.lines import LineSegments, compute_line_segments
from room_layout_ros.core.manhattan import estimate_manhattan_frame, find_axes
from room_layout_ros.core.room_axes import AXIS_TURNS, angle_between_axes
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.core.vanishing_points import _rotation, estimate_axes_from_lines
from room_layout_ros.datasets.folder import open_folder

CAMERA = CameraIntrinsics(640, 480, 520.0, 521.0, 321.0, 243.0)
CONFIG = EstimatorConfig()


def off_deg(R: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    return float(np.rad2deg(angle_between_axes(R, reference)))


def _lines(R: np.ndarray, rng: np.random.Generator, count: int, noise_px: float, clutter: int) -> LineSegments:
    points: list[list[float]] = []
    while len(points) < count:
        start = rng.uniform([-2, -1.3, 2], [2, 1.3, 6])
        end = start + R[len(points) % 3] * rng.uniform(0.3, 1.5)
        if end[2] < 0.5:
            continue
        p, q = ((CAMERA.matrix @ v / v[2])[:2] for v in (start, end))
        if np.hypot(*(p - q)) > 20:
            points.append([*p, *q])
    for _ in range(clutter):
        p = rng.uniform([0, 0], [640, 480])
        angle = rng.uniform(0, np.pi)
        points.append([*p, *(p + rng.uniform(20, 60) * np.array([np.cos(angle), np.sin(angle)]))])
    noisy = np.array(points) + rng.normal(0, noise_px, (len(points), 4))
    return LineSegments(noisy.astype(np.float32))


@pytest.mark.parametrize("tilt", [-40.0, -10.0, 0.0, 25.0])
@pytest.mark.parametrize("yaw", [-44.0, -20.0, 0.0, 31.0])
def test_axes_are_found_to_a_fraction_of_a_degree(tilt: float, yaw: float, rng: np.random.Generator) -> None:
    R = _rotation(np.deg2rad(tilt), np.deg2rad(4.0), np.deg2rad(yaw))
    found = estimate_axes_from_lines(_lines(R, rng, 60, 0.3, 0), CAMERA, CONFIG)
    assert off_deg(found.hypotheses[0], R) < 0.5
    assert found.confidence > 0.8


def test_axes_are_found_among_as_many_clutter_lines(rng: np.random.Generator) -> None:
    errors = []
    for _ in range(20):
        R = _rotation(*np.deg2rad(rng.uniform([-30, -5, -45], [30, 5, 45])))
        found = estimate_axes_from_lines(_lines(R, rng, 45, 0.7, 45), CAMERA, CONFIG)
        errors.append(off_deg(found.hypotheses[0], R))
    assert np.mean(np.array(errors) < 3.0) >= 0.9


def test_results_are_rotations_whose_second_row_is_down(rng: np.random.Generator) -> None:
    R = _rotation(0.3, 0.1, 0.7)
    found = estimate_axes_from_lines(_lines(R, rng, 60, 0.3, 10), CAMERA, CONFIG)
    for hypothesis in found.hypotheses:
        assert np.allclose(hypothesis @ hypothesis.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(hypothesis) == pytest.approx(1.0)
        assert hypothesis[1, 1] > 0.5


def test_gravity_fixes_the_vertical_where_lines_do_not(rng: np.random.Generator) -> None:
    R = _rotation(np.deg2rad(-35.0), np.deg2rad(28.0), 0.2)  # rolled beyond the search around an upright camera
    lines = _lines(R, rng, 60, 0.3, 10)
    down = R[1] + rng.normal(0, 0.005, 3)
    found = estimate_axes_from_lines(lines, CAMERA, CONFIG, gravity=down)
    assert off_deg(found.hypotheses[0], R) < 1.0


def test_no_lines_give_the_upright_camera_without_confidence() -> None:
    found = estimate_axes_from_lines(LineSegments(np.empty((0, 4), np.float32)), CAMERA, CONFIG)
    assert found.confidence == 0.0
    assert off_deg(found.hypotheses[0], np.eye(3)) < 46.0


def test_same_lines_give_the_same_bytes(rng: np.random.Generator) -> None:
    lines = _lines(_rotation(0.1, 0.0, 0.3), rng, 40, 0.5, 40)
    first, second = (estimate_axes_from_lines(lines, CAMERA, CONFIG) for _ in range(2))
    assert first.hypotheses[0].tobytes() == second.hypotheses[0].tobytes()


def test_angle_between_axes_knows_the_24_turns() -> None:
    R = np.asarray(cv2.Rodrigues(np.array([0.05, 0.0, 0.0]))[0])
    assert len({turn.tobytes() for turn in AXIS_TURNS}) == 24
    assert all(angle_between_axes(turn @ R, np.eye(3)) == pytest.approx(0.05, abs=1e-6) for turn in AXIS_TURNS)


def test_angle_between_axes_is_the_least_over_all_names(rng: np.random.Generator) -> None:
    """Rounding the rotation between them to the nearest turn would be up to 16 degrees too large."""
    for first, second in zip(Rotation.random(50, rng), Rotation.random(50, rng), strict=True):
        between = Rotation.create_group("O") * (first * second.inv())
        expected = float(between.magnitude().min())
        assert angle_between_axes(first.as_matrix(), second.as_matrix()) == pytest.approx(expected, abs=1e-6)


def test_axes_from_lines_are_named_by_gravity(rng: np.random.Generator) -> None:
    """A camera that hangs upside down: what is up in the picture is down in the room."""
    R = _rotation(np.deg2rad(-10.0), 0.1, 0.3)
    hanging = R * (-1.0, -1.0, 1.0)  # the camera turned by half a turn about its axis
    prior = TemporalPrior(gravity=hanging[1])
    found = find_axes(None, _lines(hanging, rng, 60, 0.3, 10), CAMERA, CONFIG, prior)
    assert found is not None
    for axes in (found.R_room_camera, *found.hypotheses[:2]):
        assert axes[1] @ hanging[1] > 0.99
    assert np.linalg.det(found.R_room_camera) == pytest.approx(1.0)


def test_axes_from_lines_agree_with_depth_on_real_frames(data_root: Path) -> None:
    """Issue 3: within 5 degrees of the RGB-D axes on 70 % of the frames with a hand-made layout."""
    names = json.loads((data_root / "nyuv2" / "splits.json").read_text())["layout_dev"]
    folder = open_folder(data_root / "nyuv2")
    errors = []
    for name in names:
        frame = folder.read(f"{name:04d}").frame
        geometry = compute_depth_geometry(frame, CONFIG)
        assert geometry is not None
        assert frame.color is not None
        reference = estimate_manhattan_frame(geometry)
        assert reference is not None
        found = estimate_axes_from_lines(compute_line_segments(frame.color, CONFIG), frame.camera, CONFIG)
        errors.append(off_deg(found.hypotheses[0], reference.R_room_camera))
    assert np.mean(np.array(errors) < 5.0) >= 0.8


@pytest.mark.parametrize(("count", "most"), [(1, 0.1), (4, 0.3), (12, 0.65)])
def test_few_lines_are_little_confidence(count: int, most: float, rng: np.random.Generator) -> None:
    """One line always meets an axis."""
    R = _rotation(np.deg2rad(5.0), 0.0, np.deg2rad(20.0))
    found = estimate_axes_from_lines(_lines(R, rng, count, 0.2, 0), CAMERA, CONFIG)
    assert found.confidence < most
