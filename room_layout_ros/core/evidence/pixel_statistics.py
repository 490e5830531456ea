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
    """Walk the runs of one superpixel in each row: what is summed stays in registers and is added once per run."""
    height, width = index.shape
    sums = np.zeros((count, N_SUMS))
    bounds = np.empty((count, N_BOUNDS), np.float32)
    bounds[:, 0::2] = np.inf
    bounds[:, 1::2] = -np.inf
    has_depth, has_faces = inverse.shape[0] > 1, faces.shape[0] > 1
    rows, cols = lab.shape[0], lab.shape[1]
    end = width - STRIDE + 1
    for y in range(0, height - STRIDE + 1, STRIDE):
        row = y // STRIDE
        colored = has_color and border[0] < row < rows - border[1] - 1
        x = 0
        while x < end:
            i, first = index[y, x], x
            while x < end and index[y, x] == i:
                x += STRIDE
            s, b = sums[i], bounds[i]
            _add_place(s, b, first, x, y)
            if colored:
                low, high = max(first // STRIDE, border[2] + 1), min(x // STRIDE, cols - border[3] - 1)
                _add_color(s, lab, row, low, high)
            if has_depth:
                _add_points(s, b, inverse, y, first, x, matrix)
            if has_faces:
                for k in range(first, x, STRIDE):
                    s[ORIENTATION + faces[y, k]] += 1.0
    return sums, bounds


@njit(cache=True, nogil=True)
def _add_place(s, b, first, end, y):  # type: ignore[no-untyped-def]
    n = (end - first) // STRIDE
    last = end - STRIDE
    px = 0.5 * n * (first + last)
    s[COUNT] += n
    s[PX] += px
    s[PY] += n * y
    s[PXX] += n * float(first) * first + STRIDE * (n * (n - 1.0)) * (first + STRIDE * (2.0 * n - 1.0) / 6.0)
    s[PYY] += n * float(y) * y
    s[PXY] += px * y
    b[0], b[1] = min(b[0], first), max(b[1], last)
    b[2], b[3] = min(b[2], y), max(b[3], y)


@njit(cache=True, nogil=True)
def _add_color(s, lab, row, low, high):  # type: ignore[no-untyped-def]
    """Add the columns `low` to `high` - 1 of a row of the (rows, cols, 3) uint8 Lab image at half resolution."""
    zero = np.int32(0)
    l_sum, a_sum, b_sum, ll, aa, bb, gx, gy, fine = zero, zero, zero, zero, zero, zero, zero, zero, zero
    for k in range(low, high):
        here, a, c = np.int32(lab[row, k, 0]), np.int32(lab[row, k, 1]), np.int32(lab[row, k, 2])
        left, right = np.int32(lab[row, k - 1, 0]), np.int32(lab[row, k + 1, 0])
        up, down = np.int32(lab[row - 1, k, 0]), np.int32(lab[row + 1, k, 0])
        l_sum += here
        a_sum += a
        b_sum += c
        ll += here * here
        aa += a * a
        bb += c * c
        gx += abs(right - left)
        gy += abs(down - up)
        fine += abs(4 * here - (right + left + down + up))
    s[COLORED] += max(high - low, 0)
    s[L] += l_sum
    s[A] += a_sum
    s[B] += b_sum
    s[LL] += ll
    s[AA] += aa
    s[BB] += bb
    s[GRADIENT_X] += gx
    s[GRADIENT_Y] += gy
    s[FINE] += fine


@njit(cache=True, nogil=True)
def _add_points(s, b, inverse, y, first, end, matrix):  # type: ignore[no-untyped-def]
    """Add the measured points of a run; their coordinates are linear in z and x z, and so are the sums."""
    k0 = matrix[0, 1] * y + matrix[0, 2]
    k1 = matrix[1, 1] * y + matrix[1, 2]
    k2 = matrix[2, 1] * y + matrix[2, 2]
    m0, m1, m2 = matrix[0, 0], matrix[1, 0], matrix[2, 0]
    n = z1 = zx = zz = zzx = zzxx = 0.0
    x_low = y_low = z_low = np.inf
    x_high = y_high = z_high = -np.inf
    for x in range(first, end, STRIDE):
        w = inverse[y, x]
        if w > 0:
            z = 1.0 / w
            xz = x * z
            n += 1.0
            z1 += z
            zx += xz
            zz += z * z
            zzx += xz * z
            zzxx += xz * xz
            rx, ry, rz = m0 * xz + k0 * z, m1 * xz + k1 * z, m2 * xz + k2 * z
            x_low, x_high = min(x_low, rx), max(x_high, rx)
            y_low, y_high = min(y_low, ry), max(y_high, ry)
            z_low, z_high = min(z_low, rz), max(z_high, rz)
    if n == 0.0:
        return
    s[MEASURED] += n
    s[X] += m0 * zx + k0 * z1
    s[Y] += m1 * zx + k1 * z1
    s[Z] += m2 * zx + k2 * z1
    s[XX] += m0 * m0 * zzxx + 2.0 * m0 * k0 * zzx + k0 * k0 * zz
    s[YY] += m1 * m1 * zzxx + 2.0 * m1 * k1 * zzx + k1 * k1 * zz
    s[ZZ] += m2 * m2 * zzxx + 2.0 * m2 * k2 * zzx + k2 * k2 * zz
    s[DEPTH] += z1
    s[DEPTH2] += zz
    b[4], b[5] = min(b[4], x_low), max(b[5], x_high)
    b[6], b[7] = min(b[6], y_low), max(b[7], y_high)
    b[8], b[9] = min(b[8], z_low), max(b[9], z_high)


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
