"""Sums over the pixels of each superpixel, in one pass at half resolution: colour, texture, points, orientation."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..color import blank_border
from ..frame import CameraIntrinsics
from ..lines import LineSegments

STRIDE = 2
"""Statistics look at every second pixel each way: a superpixel of 1500 px keeps about 380."""

(
    COUNT,
    PX,
    PY,
    PXX,
    PYY,
    PXY,
    COLORED,
    L,
    A,
    B,
    LL,
    AA,
    BB,
    GRADIENT_X,
    GRADIENT_Y,
    FINE,
    MEASURED,
    X,
    Y,
    Z,
    XX,
    YY,
    ZZ,
    DEPTH,
    DEPTH2,
) = range(25)
ORIENTATION = 25
"""First of six columns: pixels per id 0..5 of the orientation map."""
N_SUMS = 31

N_BOUNDS = 10
"""Columns of bounds: x and y of the image box, X, Y, Z of the room box (low, high each)."""


def sum_pixels(
    index: NDArray[np.int32],
    count: int,
    color: NDArray[np.uint8] | None,
    inverse_depth: NDArray[np.float32] | None,
    orientation: NDArray[np.uint8] | None,
    R_room_camera: NDArray[np.float64],
    camera: CameraIntrinsics,
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return (sums (K, 31) float64, bounds (K, 10) float32); what is not given leaves its columns 0, bounds NaN."""
    lab = np.zeros((1, 1, 3), np.uint8)
    top = bottom = left = right = 0
    if color is not None:
        half = cv2.resize(color, None, fx=1.0 / STRIDE, fy=1.0 / STRIDE, interpolation=cv2.INTER_AREA)
        lab = np.asarray(cv2.cvtColor(half, cv2.COLOR_RGB2LAB), np.uint8)
        top, bottom, left, right = (-(-side // STRIDE) for side in blank_border(color))
    w = np.zeros((1, 1), np.float32) if inverse_depth is None else inverse_depth
    faces = np.zeros((1, 1), np.uint8) if orientation is None else orientation
    matrix = np.ascontiguousarray(R_room_camera @ np.linalg.inv(camera.matrix))
    border = np.array([top, bottom, left, right])
    sums, bounds = _sum(index, count, lab, color is not None, border, w, faces, matrix)
    bounds[~np.isfinite(bounds)] = np.nan  # nothing of the superpixel was looked at
    return sums, bounds


@njit(cache=True, nogil=True)
def _sum(index, count, lab, has_color, border, inverse, faces, matrix):  # type: ignore[no-untyped-def]
    height, width = index.shape
    sums = np.zeros((count, N_SUMS))
    bounds = np.empty((count, N_BOUNDS), np.float32)
    bounds[:, 0::2] = np.inf
    bounds[:, 1::2] = -np.inf
    has_depth, has_faces = inverse.shape[0] > 1, faces.shape[0] > 1
    rows, cols = lab.shape[0], lab.shape[1]
    for y in range(0, height - STRIDE + 1, STRIDE):
        row = y // STRIDE
        for x in range(0, width - STRIDE + 1, STRIDE):
            i = index[y, x]
            s, b = sums[i], bounds[i]
            s[COUNT] += 1.0
            s[PX] += x
            s[PY] += y
            s[PXX] += x * x
            s[PYY] += y * y
            s[PXY] += x * y
            b[0], b[1] = min(b[0], x), max(b[1], x)
            b[2], b[3] = min(b[2], y), max(b[3], y)
            col = x // STRIDE
            if has_color and border[0] < row < rows - border[1] - 1 and border[2] < col < cols - border[3] - 1:
                l_here, a, c = float(lab[row, col, 0]), float(lab[row, col, 1]), float(lab[row, col, 2])
                gx = abs(float(lab[row, col + 1, 0]) - float(lab[row, col - 1, 0]))
                gy = abs(float(lab[row + 1, col, 0]) - float(lab[row - 1, col, 0]))
                around = float(lab[row, col + 1, 0]) + float(lab[row, col - 1, 0])
                around += float(lab[row + 1, col, 0]) + float(lab[row - 1, col, 0])
                s[COLORED] += 1.0
                s[L] += l_here
                s[A] += a
                s[B] += c
                s[LL] += l_here * l_here
                s[AA] += a * a
                s[BB] += c * c
                s[GRADIENT_X] += gx
                s[GRADIENT_Y] += gy
                s[FINE] += abs(4.0 * l_here - around)
            if has_depth:
                w = inverse[y, x]
                if w > 0:
                    z = 1.0 / w
                    rx = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) * z
                    ry = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) * z
                    rz = (matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]) * z
                    s[MEASURED] += 1.0
                    s[X] += rx
                    s[Y] += ry
                    s[Z] += rz
                    s[XX] += rx * rx
                    s[YY] += ry * ry
                    s[ZZ] += rz * rz
                    s[DEPTH] += z
                    s[DEPTH2] += z * z
                    b[4], b[5] = min(b[4], rx), max(b[5], rx)
                    b[6], b[7] = min(b[6], ry), max(b[7], ry)
                    b[8], b[9] = min(b[8], rz), max(b[9], rz)
            if has_faces:
                s[ORIENTATION + faces[y, x]] += 1.0
    return sums, bounds


def count_lines(
    index: NDArray[np.int32], count: int, segments: LineSegments, line_class: NDArray[np.int8]
) -> NDArray[np.float64]:
    """(K, 4) length in pixels of the segments of class X, Y, Z and none inside each superpixel."""
    return np.asarray(_count_lines(index, count, segments.points, line_class))


@njit(cache=True, nogil=True)
def _count_lines(index, count, points, line_class):  # type: ignore[no-untyped-def]
    height, width = index.shape
    lengths = np.zeros((count, 4))
    for i in range(points.shape[0]):
        x1, y1, x2, y2 = points[i, 0], points[i, 1], points[i, 2], points[i, 3]
        length = np.sqrt((x2 - x1) ** 2 + (y2 - y1) ** 2)
        steps = max(int(length / 3.0), 1)
        kind = line_class[i] if line_class[i] >= 0 else 3
        across_x, across_y = -(y2 - y1) / max(length, 1e-6) * 3.0, (x2 - x1) / max(length, 1e-6) * 3.0
        for k in range(steps):
            t = (k + 0.5) / steps
            for side in range(-1, 2, 2):  # a segment lies on a border: it counts for both sides of it
                x = int(x1 + t * (x2 - x1) + side * across_x + 0.5)
                y = int(y1 + t * (y2 - y1) + side * across_y + 0.5)
                if 0 <= x < width and 0 <= y < height:
                    lengths[index[y, x], kind] += 0.5 * length / steps
    return lengths
