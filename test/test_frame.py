"""Camera and frame: right rays, and a sentence for whatever is not a camera or a frame."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scenes import TINY

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame

COLOR = np.zeros((30, 40, 3), np.uint8)
DEPTH = np.ones((30, 40), np.float32)


def test_rays_project_back_to_their_pixels() -> None:
    projected = TINY.rays().astype(np.float64) @ TINY.matrix.T
    y, x = np.mgrid[:30, :40]
    np.testing.assert_allclose(projected, np.stack([x, y, np.ones_like(x)], -1), atol=1e-4)


def test_rays_are_shared_and_cannot_be_spoilt() -> None:
    assert TINY.rays() is TINY.rays()
    with pytest.raises(ValueError, match="read-only"):
        TINY.rays()[0, 0, 0] = 1.0


def test_a_resized_camera_sees_the_same_ray_at_the_same_place() -> None:
    """The image's corners, half a pixel outside the first and last centres, keep their rays."""
    camera = CameraIntrinsics(640, 480, 500.0, 510.0, 300.0, 250.0)
    half = camera.scaled(0.5)
    assert (half.width, half.height) == (320, 240)
    for corner, same in ((np.array([-0.5, -0.5, 1]), np.array([-0.5, -0.5, 1])),
                         (np.array([639.5, 479.5, 1]), np.array([319.5, 239.5, 1]))):  # fmt: skip
        np.testing.assert_allclose(np.linalg.solve(camera.matrix, corner), np.linalg.solve(half.matrix, same))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"width": 0}, "camera size is 0x30; each side must be 1 to 8192 pixels"),
        ({"height": -3}, "camera size is 40x-3; each side must be 1 to 8192 pixels"),
        ({"width": 8193}, "camera size is 8193x30; each side must be 1 to 8192 pixels"),
        ({"fx": float("nan")}, "camera intrinsics (fx, fy, cx, cy) are (nan, 34.0, 18.2, 15.7); all must be finite"),
        ({"cy": float("inf")}, "camera intrinsics (fx, fy, cx, cy) are (33.0, 34.0, 18.2, inf); all must be finite"),
        ({"fx": 0.0}, "focal lengths are (0.0, 34.0) px; both must be above 0 (is the camera calibrated?)"),
        ({"fy": -5.0}, "focal lengths are (33.0, -5.0) px; both must be above 0 (is the camera calibrated?)"),
    ],
)
def test_a_camera_that_is_none_is_refused_in_one_sentence(change: dict[str, float], sentence: str) -> None:
    values = {"width": 40, "height": 30, "fx": 33.0, "fy": 34.0, "cx": 18.2, "cy": 15.7} | change
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        CameraIntrinsics(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("images", "sentence"),
    [
        ({}, "frame has neither colour nor depth; at least one is needed"),
        ({"color": COLOR[:29]}, "colour image has shape (29, 40, 3); the camera says (30, 40, 3)"),
        ({"color": COLOR[..., 0]}, "colour image has shape (30, 40); the camera says (30, 40, 3)"),
        ({"color": COLOR.astype(np.float32)}, "colour image is float32; it must be uint8"),
        ({"color": COLOR, "depth_m": DEPTH.T}, "depth image has shape (40, 30); the camera says (30, 40)"),
        ({"depth_m": DEPTH.astype(np.uint16)}, "depth image is uint16; it must be float32"),
        ({"depth_m": DEPTH.astype(np.float64)}, "depth image is float64; it must be float32"),
    ],
)
def test_a_frame_that_is_none_is_refused_in_one_sentence(images: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        RgbdFrame(TINY, **images)


def test_a_frame_without_depth_keeps_all_else() -> None:
    frame = RgbdFrame(TINY, COLOR, DEPTH, 7, "camera", "0059")
    assert frame.without_depth() == RgbdFrame(TINY, COLOR, None, 7, "camera", "0059")
