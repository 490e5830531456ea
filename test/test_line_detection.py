"""The segment detector against OpenCV's, and on images whose segments are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from room_layout_ros.core.line_detection import detect_segments


def _scene(rng: np.random.Generator) -> np.ndarray:
    """Overlapping polygons with noise: some hundred edges of all directions and contrasts."""
    image = np.full((240, 320), 90, np.uint8)
    for _ in range(40):
        corners = rng.integers(-20, 340, (1, 2)) + rng.integers(-70, 70, (4, 2))
        cv2.fillPoly(image, [cv2.convexHull(corners.astype(np.int32))], int(rng.integers(0, 255)))
    noisy = cv2.GaussianBlur(image, (3, 3), 0.8) + rng.normal(0.0, 2.0, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(5))
def test_finds_what_opencv_finds(seed: int) -> None:
    image = _scene(np.random.default_rng(seed))
    theirs = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE, 1.0).detect(image)[0].reshape(-1, 4)
    ours = detect_segments(image)
    assert len(theirs) > 50
    assert abs(len(ours) - len(theirs)) <= 0.03 * len(theirs)
    apart = np.abs(theirs[:, None] - ours[None]).max(axis=2).min(axis=1)
    # Neighbours of equal steepness may come in another order, which parts a few regions elsewhere
    assert (apart < 0.1).mean() > 0.9


def test_brighter_side_is_on_the_left_hand() -> None:
    image = np.zeros((60, 80), np.uint8)
    image[20:40, 20:60] = 200
    for x1, y1, x2, y2 in detect_segments(image):
        middle, along = np.array([x1 + x2, y1 + y2]) / 2, np.array([x2 - x1, y2 - y1])
        inward = np.array([39.5, 29.5]) - middle
        assert along[0] * inward[1] - along[1] * inward[0] < 0


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (2, 2), (3, 200)])
def test_tiny_and_blank_images_have_none(shape: tuple[int, int]) -> None:
    assert detect_segments(np.full(shape, 77, np.uint8)).shape == (0, 4)
