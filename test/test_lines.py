"""Line segments: where they are, which are dropped, which axis they run along."""

from __future__ import annotations

import cv2
import naive_evidence as naive
import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.lines import LineSegments, classify_segments, compute_line_segments, segment_planes

CAMERA = CameraIntrinsics(640, 480, 520.0, 521.0, 321.0, 243.0)


def _rotation(axis: tuple[float, float, float]) -> np.ndarray:
    return np.asarray(cv2.Rodrigues(np.array(axis))[0])


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_edge_is_found_at_its_place_within_half_a_pixel(scale: float) -> None:
    image = np.zeros((480, 640), np.uint8)
    image[:, 300:] = 200  # pixel centres at integers: the edge is at 299.5
    found = compute_line_segments(image, EstimatorConfig(line_scale=scale)).points
    assert len(found) == 1
    assert np.abs(found[0, [0, 2]] - 299.5).max() < 0.5
    assert abs(found[0, 3] - found[0, 1]) > 460


def test_slanted_edges_of_a_box_are_found_with_subpixel_accuracy() -> None:
    image = np.full((480, 640, 3), 60, np.uint8)
    corners = np.array([[150, 120], [480, 160], [440, 380], [120, 330]])
    cv2.fillPoly(image, [corners.astype(np.int32)], (200, 180, 190))
    found = compute_line_segments(image, EstimatorConfig()).points
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        direction = (b - a) / np.linalg.norm(b - a)
        across = np.array([-direction[1], direction[0]])
        distance = np.abs((found.reshape(-1, 2, 2) - a) @ across).max(axis=1)
        along = (found.reshape(-1, 2, 2) - a) @ direction
        covered = (along.max(axis=1) - along.min(axis=1))[distance < 1.5].sum()
        assert covered > 0.8 * np.linalg.norm(b - a)


def test_frame_of_the_picture_and_short_segments_are_left_out() -> None:
    image = np.full((480, 640), 255, np.uint8)
    image[9:-9, 9:-9] = 90
    image[200:206, 200:206] = 250
    assert len(compute_line_segments(image, EstimatorConfig())) == 0


def test_blank_image_has_no_segments() -> None:
    assert compute_line_segments(np.full((480, 640, 3), 128, np.uint8), EstimatorConfig()).points.shape == (0, 4)


def test_wrong_image_and_wrong_points_are_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="float64"):
        compute_line_segments(np.zeros((4, 4)), EstimatorConfig())  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"\(2, 3\)"):
        LineSegments(np.zeros((2, 3), np.float32))


def test_projected_lines_along_the_axes_get_their_axis_and_others_none(rng: np.random.Generator) -> None:
    R = _rotation((0.2, 0.5, -0.05))
    truth: list[int] = []
    points: list[list[float]] = []
    while len(points) < 60:
        start = rng.uniform([-1.5, -1, 2.5], [1.5, 1, 5])
        kind = len(points) % 3
        end = start + R[kind] * rng.uniform(0.4, 1.0) * rng.choice([-1, 1])
        if end[2] < 0.5:
            continue
        p, q = (CAMERA.matrix @ v / v[2] for v in (start, end))
        if np.hypot(*(p - q)[:2]) > 25:
            points.append([*p[:2], *q[:2]])
            truth.append(kind)
    segments = LineSegments(np.array(points, np.float32))
    assert (classify_segments(segments, R, CAMERA) == truth).mean() > 0.95
    normal, middle = segment_planes(segments, CAMERA)
    assert np.array_equal(classify_segments(segments, R, CAMERA), naive.classify(normal, middle, segments.length_px, R))
    diagonal = LineSegments(np.array([[100, 100, 200, 190]], np.float32))
    assert classify_segments(diagonal, np.eye(3), CAMERA)[0] == -1
