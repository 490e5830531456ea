"""Orientation map: which way the surface at a pixel faces, from line segments alone ([L09]; docs/evidence.md).

A segment of class c, swept along the direction of another axis e, paints the surface that c and e span, until a
segment of the third class blocks it. Seen from the pixel: looking along e, the nearest segment that is not of class e
is of class c. A pixel has the orientation k where both sweeps of the other two classes agree, and no other k does.

All pixels on one line through the vanishing point of e share their view along e. The kernel therefore walks such lines
once, from every pixel of the image's border, and carries along the class seen last: O(pixels), no sorting.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..labels import CEILING, FLOOR, FRONT_WALL, LEFT_WALL, RIGHT_WALL
from ..lines import LineSegments, classify_segments
from ..weights import uses

_MAP_WIDTH = 160
"""Sweeps run on a map of this width: segments are sparse, and finer maps gave the same faces in 98 % of the pixels."""


def map_orientation(
    segments: LineSegments | None, R_room_camera: NDArray[np.float64], camera: CameraIntrinsics, variant: str = "full"
) -> tuple[NDArray[np.int8] | None, NDArray[np.uint8] | None]:
    """Axis of each segment, and the orientation map.

    Parameters
    ----------
    segments : LineSegments or None
        None without colour.
    R_room_camera : (3, 3) float64
    camera : CameraIntrinsics
    variant : str
        Of the model (`weights.VARIANTS`).

    Returns
    -------
    line_class : (n,) int8 or None
    orientation : (H, W) uint8 or None
        None also in a variant without the map.
    """
    if segments is None:
        return None, None
    line_class = classify_segments(segments, R_room_camera, camera)
    seen = uses(variant, "layout_om")
    return line_class, compute_orientation_map(segments, line_class, R_room_camera, camera) if seen else None


def compute_orientation_map(
    segments: LineSegments,
    line_class: NDArray[np.int8],
    R_room_camera: NDArray[np.float64],
    camera: CameraIntrinsics,
) -> NDArray[np.uint8]:
    """Sweep classified segments and name the face each pixel's orientation stands for.

    Parameters
    ----------
    segments : LineSegments
    line_class : (n,) int8
        Axis of each segment, 0 X, 1 Y, 2 Z, -1 none (`classify_segments`).
    R_room_camera : (3, 3) float64
    camera : CameraIntrinsics

    Returns
    -------
    (H, W) uint8
        Label id 1..5 (orientation z is the front wall; x the left or right wall by the side of the vanishing
        point; y ceiling or floor by the horizon), 0 where the lines leave it open.

    Raises
    ------
    ValueError
        When there are not as many classes as segments.
    """
    if len(line_class) != len(segments):
        raise ValueError(f"{len(line_class)} line classes are given for {len(segments)} segments; counts must agree")
    small = camera.scaled(min(1.0, _MAP_WIDTH / camera.width))
    lines = _draw(segments, line_class, camera, small)
    matrix = np.ascontiguousarray(R_room_camera @ np.linalg.inv(small.matrix))
    seen = np.zeros((3, small.height, small.width), np.uint8)
    for axis in range(3):
        toward = small.matrix @ R_room_camera[axis]
        _sweep(lines, toward[0], toward[1], toward[2], axis, seen[axis])
    faces = _faces(seen, matrix)
    return np.asarray(cv2.resize(faces, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST), np.uint8)


def _draw(
    segments: LineSegments, line_class: NDArray[np.int8], camera: CameraIntrinsics, small: CameraIntrinsics
) -> NDArray[np.uint8]:
    """(h, w) uint8: bit c is set where a segment of class c runs; 4-connected, so that no sweep slips through."""
    scale = small.fx / camera.fx
    points = np.rint((segments.points.astype(np.float64) + 0.5) * scale - 0.5).astype(np.int32)
    lines = np.zeros((small.height, small.width), np.uint8)
    layer = np.zeros_like(lines)
    for axis in range(3):
        layer[:] = 0
        for x1, y1, x2, y2 in points[line_class == axis]:
            cv2.line(layer, (int(x1), int(y1)), (int(x2), int(y2)), 1 << axis, 1, cv2.LINE_4)
        lines |= layer
    return lines


@njit(cache=True, nogil=True)
def _sweep(lines, vx, vy, vw, axis, seen):  # type: ignore[no-untyped-def]
    """Walk every line through the vanishing point (vx, vy, vw) both ways; set bit c where class c is in view."""
    height, width = lines.shape
    for k in range(2 * (width + height)):
        if k < width:
            x, y = k, 0
        elif k < 2 * width:
            x, y = k - width, height - 1
        elif k < 2 * width + height:
            x, y = 0, k - 2 * width
        else:
            x, y = width - 1, k - 2 * width - height
        dx, dy = vx - vw * x, vy - vw * y  # towards the point where vw > 0, along the same line otherwise
        major = max(abs(dx), abs(dy))
        if major < 1e-9:
            continue
        dx, dy = dx / major, dy / major
        for way in range(2):
            _walk(lines, float(x), float(y), dx, dy, vx, vy, vw, axis, seen)
            dx, dy = -dx, -dy


@njit(cache=True, nogil=True)
def _walk(lines, x, y, dx, dy, vx, vy, vw, axis, seen):  # type: ignore[no-untyped-def]
    """Step from the border pixel until the image ends or the vanishing point is reached, then back."""
    height, width = lines.shape
    steps = 0
    limit = width + height
    if abs(vw) > 1e-12:
        ahead = max(abs(vx / vw - x), abs(vy / vw - y))
        same = (vx / vw - x) * dx + (vy / vw - y) * dy > 0.0
        if same and ahead < limit:
            limit = int(ahead)
    others = 7 & ~(1 << axis)
    view = 0
    while steps <= limit:
        column, row = int(np.floor(x + dx * steps + 0.5)), int(np.floor(y + dy * steps + 0.5))
        if column < 0 or row < 0 or column >= width or row >= height:
            break
        here = lines[row, column] & others
        if here == others:
            view = 0
        elif here:
            view = here
        seen[row, column] |= view
        steps += 1
    view = 0
    for back in range(steps - 1, -1, -1):
        column, row = int(np.floor(x + dx * back + 0.5)), int(np.floor(y + dy * back + 0.5))
        here = lines[row, column] & others
        if here == others:
            view = 0
        elif here:
            view = here
        seen[row, column] |= view


@njit(cache=True, nogil=True)
def _faces(seen, matrix):  # type: ignore[no-untyped-def]
    height, width = seen.shape[1:]
    faces = np.zeros((height, width), np.uint8)
    for y in range(height):
        for x in range(width):
            found, count = -1, 0
            for k in range(3):
                c, e = (k + 1) % 3, (k + 2) % 3
                if seen[e, y, x] & (1 << c) and seen[c, y, x] & (1 << e):
                    found = k
                    count += 1
            if count != 1:
                continue
            if found == 2:
                faces[y, x] = FRONT_WALL
            elif found == 0:
                side = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]
                faces[y, x] = LEFT_WALL if side < 0.0 else RIGHT_WALL
            else:
                side = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]
                faces[y, x] = CEILING if side < 0.0 else FLOOR
    return faces
