"""Straight line segments of an image and their classes by room axis."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .frame import CameraIntrinsics
from .line_detection import detect_segments

_BORDER_SHARE = 0.03
"""Segments that run along the image's border within this share of its size are the picture's own frame
(registered images carry a border of 1-2 % without data)."""

_CLASS_TOLERANCE_DEG = 3.0
_ENDPOINT_NOISE_PX = 1.0


@dataclass(frozen=True, slots=True)
class LineSegments:
    """Line segments of one image.

    Attributes
    ----------
    points : (n, 4) float32
        End points x1, y1, x2, y2 in pixels of the full image, pixel centres at integers.
    """

    points: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 4 or self.points.dtype != np.float32:
            raise ValueError(f"segments are {self.points.dtype} of shape {self.points.shape}; (n, 4) float32 is needed")

    def __len__(self) -> int:
        return len(self.points)

    @property
    def length_px(self) -> NDArray[np.float32]:
        """(n,) float32 lengths in pixels."""
        delta = self.points[:, 2:] - self.points[:, :2]
        return np.sqrt((delta * delta).sum(axis=1))


def compute_line_segments(image: NDArray[np.uint8], config: EstimatorConfig) -> LineSegments:
    """Detect straight segments (LSD, von Gioi et al. 2010) in the image at reduced resolution.

    Parameters
    ----------
    image : (H, W, 3) or (H, W) uint8 array
        RGB or grey.
    config : EstimatorConfig
        `line_scale` and `line_min_length_px`.

    Returns
    -------
    LineSegments
        Longest first; segments along the image's own border are left out.

    Raises
    ------
    ValueError
        When the image is not uint8 or not of one of these shapes.
    """
    if image.dtype != np.uint8 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ValueError(f"image is {image.dtype} of shape {image.shape}; uint8 (H, W) or (H, W, 3) is needed")
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    scale = config.line_scale
    if min(gray.shape) * scale < 1.0:
        return LineSegments(np.empty((0, 4), np.float32))  # nothing is left of an image this small
    if scale < 1.0:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    found = detect_segments(np.ascontiguousarray(gray, np.uint8))
    points = (found + np.float32(0.5)) / np.float32(scale) - np.float32(0.5)
    length = np.hypot(points[:, 2] - points[:, 0], points[:, 3] - points[:, 1])
    keep = (length >= config.line_min_length_px) & ~_along_border(points, image.shape[0], image.shape[1])
    order = np.argsort(-length[keep], kind="stable")
    return LineSegments(np.ascontiguousarray(points[keep][order]))


def _along_border(points: NDArray[np.float32], height: int, width: int) -> NDArray[np.bool_]:
    x, y = points[:, 0::2], points[:, 1::2]
    mx, my = _BORDER_SHARE * width, _BORDER_SHARE * height
    left, right = (x < mx).all(axis=1), (x > width - 1 - mx).all(axis=1)
    top, bottom = (y < my).all(axis=1), (y > height - 1 - my).all(axis=1)
    return np.asarray(left | right | top | bottom)


def segment_planes(segments: LineSegments, camera: CameraIntrinsics) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the interpretation planes of segments.

    Returns
    -------
    normal : (n, 3) float64
        Unit normal of the plane through the camera and the segment.
    middle : (n, 3) float64
        Unit ray through the segment's middle.
    """
    normal, middle = _planes(segments.points, *camera.numbers)
    return normal, middle


@njit(cache=True, nogil=True)
def _planes(points, fx, fy, cx, cy):  # type: ignore[no-untyped-def]
    n = points.shape[0]
    normal, middle = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        ax, ay = (points[i, 0] - cx) / fx, (points[i, 1] - cy) / fy
        bx, by = (points[i, 2] - cx) / fx, (points[i, 3] - cy) / fy
        nx, ny, nz = ay - by, bx - ax, ax * by - ay * bx
        length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
        normal[i, 0], normal[i, 1], normal[i, 2] = nx / length, ny / length, nz / length
        mx, my = ax + bx, ay + by
        length = np.sqrt(mx * mx + my * my + 4.0)
        middle[i, 0], middle[i, 1], middle[i, 2] = mx / length, my / length, 2.0 / length
    return normal, middle


def classify_segments(
    segments: LineSegments, R_room_camera: NDArray[np.float64], camera: CameraIntrinsics
) -> NDArray[np.int8]:
    """Name the room axis each segment runs along.

    A segment belongs to the axis whose vanishing point it aims at best, when the angle in the image between
    the segment and the line from its middle to that point is within 3 degrees plus the end points' noise.

    Returns
    -------
    (n,) int8
        0 X, 1 Y, 2 Z, -1 none.
    """
    normal, middle = segment_planes(segments, camera)
    axes = np.ascontiguousarray(R_room_camera, np.float64)
    return np.asarray(_classify(normal, middle, segments.length_px.astype(np.float64), axes))


@njit(cache=True, nogil=True)
def _classify(normal, middle, length, axes):  # type: ignore[no-untyped-def]
    n = normal.shape[0]
    out = np.full(n, -1, np.int8)
    for i in range(n):
        best = np.sin(np.deg2rad(_CLASS_TOLERANCE_DEG) + np.arctan(_ENDPOINT_NOISE_PX / max(length[i], 1.0)))
        for k in range(3):
            d0, d1, d2 = axes[k, 0], axes[k, 1], axes[k, 2]
            across = abs(normal[i, 0] * d0 + normal[i, 1] * d1 + normal[i, 2] * d2)
            along = middle[i, 0] * d0 + middle[i, 1] * d1 + middle[i, 2] * d2
            sine = across / np.sqrt(max(1.0 - along * along, 1e-6))
            if sine < best:
                best, out[i] = sine, k
    return out
