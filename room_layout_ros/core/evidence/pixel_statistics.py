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

_HALF, _THIRD, _FIFTH = 32, 21, 12
"""Bits of a sum of which two, three or five are packed in an int64: room for runs of 8190 pixels, every second one.
(Five have no bit to spare: longer runs are taken in parts.)
Running sums of a row may overflow: their differences are right all the same, for whole numbers wrap around."""
_IN_HALF, _IN_THIRD, _IN_FIFTH = 2**_HALF - 1, 2**_THIRD - 1, 2**_FIFTH - 1

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
    lab = (np.zeros((1, 1), np.uint8),) * 3
    top = bottom = left = right = 0
    if color is not None:
        half = cv2.resize(color, None, fx=1.0 / STRIDE, fy=1.0 / STRIDE, interpolation=cv2.INTER_AREA)
        lightness, a, b = cv2.split(cv2.cvtColor(half, cv2.COLOR_RGB2LAB))
        lab = (np.asarray(lightness, np.uint8), np.asarray(a, np.uint8), np.asarray(b, np.uint8))
        top, bottom, left, right = (-(-side // STRIDE) for side in blank_border(color))
    w = np.zeros((1, 1), np.float32) if inverse_depth is None else inverse_depth
    faces = np.zeros((1, 1), np.uint8) if orientation is None else orientation
    matrix = np.ascontiguousarray(R_room_camera @ np.linalg.inv(camera.matrix))
    border = np.array([top, bottom, left, right])
    sums, bounds = _sum(index, count, lab, color is not None, border, w, faces, matrix)
    bounds[~np.isfinite(bounds)] = np.nan  # nothing of the superpixel was looked at
    return sums, bounds


@njit(cache=True, nogil=True, error_model="numpy")
def _sum(index, count, lab, has_color, border, inverse, faces, matrix):  # type: ignore[no-untyped-def]
    """Walk the runs of one superpixel in each row: what is summed stays in registers and is added once per run.

    What each pixel adds is made for a whole row before, in vector registers, and whole numbers are packed: one
    addition sums two or three of them.
    """
    height, width = index.shape
    sums = np.zeros((count, N_SUMS))
    bounds = np.empty((count, N_BOUNDS), np.float32)
    bounds[:, 0::2] = np.inf
    bounds[:, 1::2] = -np.inf
    has_depth, has_faces = inverse.shape[0] > 1, faces.shape[0] > 1
    rows, cols = lab[0].shape
    n = width // STRIDE
    if n == 0:  # one pixel wide: there is no second pixel
        return sums, bounds
    colors, named = np.zeros((4, cols + 1), np.int64), np.zeros(n + 1, np.int64)
    depth, points = np.zeros((2, n)), np.zeros((3, n), np.float32)
    starts = np.empty(n + 1, np.int32)
    for row in range(height // STRIDE):
        y = row * STRIDE
        colored = has_color and border[0] < row < rows - border[1] - 1
        if colored:
            _color_row(lab[0], lab[1], lab[2], row, colors)
        if has_depth:
            _point_row(inverse[y], y, matrix, depth, points)
        if has_faces:
            _name_row(faces[y], named)
        labels, runs = index[y], _find_runs(index[y], starts)
        _add_places(sums, bounds, labels, starts, runs, y)
        if colored:
            _add_colors(sums, labels, starts, runs, colors, border[2] + 1, cols - border[3] - 1)
        if has_depth:
            _add_points(sums, bounds, labels, starts, runs, depth, points, y, matrix)
        if has_faces:
            _add_names(sums, labels, starts, runs, named)
    return sums, bounds


@njit(cache=True, nogil=True)
def _find_runs(index, starts):  # type: ignore[no-untyped-def]
    """Write where the runs of a row start, in strides, and its end; return how many there are.

    Each place is written where the next start belongs, and stays if it is one: no branch that a processor cannot guess.
    """
    starts[0], n = 0, 1
    for k in range(1, len(starts) - 1):
        starts[n] = k
        n += int(index[k * STRIDE] != index[(k - 1) * STRIDE])
    starts[n] = len(starts) - 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _add_places(s, b, labels, starts, runs, y):  # type: ignore[no-untyped-def]
    """Add number, positions and their products of the runs of a row in closed form, and widen the image boxes."""
    for run in range(runs):
        first, last = starts[run] * STRIDE, (starts[run + 1] - 1) * STRIDE
        i, n = labels[first], starts[run + 1] - starts[run]
        px = 0.5 * n * (first + last)
        s[i, COUNT] += n
        s[i, PX] += px
        s[i, PY] += n * y
        s[i, PXX] += n * float(first) * first + STRIDE * (n * (n - 1.0)) * (first + STRIDE * (2.0 * n - 1.0) / 6.0)
        s[i, PYY] += n * float(y) * y
        s[i, PXY] += px * y
        b[i, 0], b[i, 1] = min(b[i, 0], first), max(b[i, 1], last)
        b[i, 2], b[i, 3] = min(b[i, 2], y), max(b[i, 3], y)


@njit(cache=True, nogil=True)
def _color_row(lightness, a, b, row, colors):  # type: ignore[no-untyped-def]
    """Write what the pixels of a row but its first and last add up to into `colors` (4, cols + 1): L, a and b; the
    squares of L and a; that of b and the fine structure; the gradients.

    Column k + 1 is for all pixels up to k. One loop for each: the compiler gives vectors up where it would have to tell
    many arrays apart.
    """
    up, here, down, a_row, b_row = lightness[row - 1], lightness[row], lightness[row + 1], a[row], b[row]
    for k in range(1, len(here) - 1):
        colors[0, k + 1] = np.int64(here[k]) | np.int64(a_row[k]) << _THIRD | np.int64(b_row[k]) << 2 * _THIRD
    for k in range(1, len(here) - 1):
        value, of_a = np.int32(here[k]), np.int32(a_row[k])
        colors[1, k + 1] = np.int64(value * value) | np.int64(of_a * of_a) << _HALF
    for k in range(1, len(here) - 1):
        value, of_b = np.int32(here[k]), np.int32(b_row[k])
        around = np.int32(here[k + 1]) + np.int32(here[k - 1]) + np.int32(up[k]) + np.int32(down[k])
        colors[2, k + 1] = np.int64(of_b * of_b) | np.int64(abs(4 * value - around)) << _HALF
    for k in range(1, len(here) - 1):
        across, along = np.int32(here[k + 1]) - np.int32(here[k - 1]), np.int32(down[k]) - np.int32(up[k])
        colors[3, k + 1] = np.int64(abs(across)) | np.int64(abs(along)) << _HALF
    first = second = third = fourth = np.int64(0)
    for k in range(2, len(here)):
        first += colors[0, k]
        second += colors[1, k]
        third += colors[2, k]
        fourth += colors[3, k]
        colors[0, k], colors[1, k], colors[2, k], colors[3, k] = first, second, third, fourth


@njit(cache=True, nogil=True)
def _add_colors(s, labels, starts, runs, colors, low, high):  # type: ignore[no-untyped-def]
    """Add the columns `low` to `high` - 1 of a row."""
    for run in range(runs):
        i, first = labels[starts[run] * STRIDE], max(starts[run], low)
        end = max(min(starts[run + 1], high), first)
        lab, squares = colors[0, end] - colors[0, first], colors[1, end] - colors[1, first]
        fine, gradient = colors[2, end] - colors[2, first], colors[3, end] - colors[3, first]
        s[i, COLORED] += end - first
        s[i, L] += lab & _IN_THIRD
        s[i, A] += lab >> _THIRD & _IN_THIRD
        s[i, B] += lab >> 2 * _THIRD
        s[i, LL] += squares & _IN_HALF
        s[i, AA] += squares >> _HALF
        s[i, BB] += fine & _IN_HALF
        s[i, GRADIENT_X] += gradient & _IN_HALF
        s[i, GRADIENT_Y] += gradient >> _HALF
        s[i, FINE] += fine >> _HALF


@njit(cache=True, nogil=True, error_model="numpy")
def _point_row(inverse, y, matrix, depth, points):  # type: ignore[no-untyped-def]
    """Write z and x z of the pixels of a row into `depth`, 0 where not measured, and X, Y, Z, or NaN, into `points`.

    One loop for each, as in `_color_row`.
    """
    k0 = matrix[0, 1] * y + matrix[0, 2]
    k1 = matrix[1, 1] * y + matrix[1, 2]
    k2 = matrix[2, 1] * y + matrix[2, 2]
    m0, m1, m2 = matrix[0, 0], matrix[1, 0], matrix[2, 0]
    for k in range(depth.shape[1]):
        w = inverse[k * STRIDE]
        depth[0, k] = 1.0 / w if w > 0 else 0.0
    for k in range(depth.shape[1]):
        depth[1, k] = k * STRIDE * depth[0, k]
    for k in range(depth.shape[1]):
        points[0, k] = m0 * depth[1, k] + k0 * depth[0, k] if depth[0, k] > 0 else np.nan
    for k in range(depth.shape[1]):
        points[1, k] = m1 * depth[1, k] + k1 * depth[0, k] if depth[0, k] > 0 else np.nan
    for k in range(depth.shape[1]):
        points[2, k] = m2 * depth[1, k] + k2 * depth[0, k] if depth[0, k] > 0 else np.nan


@njit(cache=True, nogil=True, error_model="numpy")
def _add_points(s, b, labels, starts, runs, depth, points, y, matrix):  # type: ignore[no-untyped-def]
    """Add the measured points of a row; their coordinates are linear in z and x z, and so are the sums."""
    k0 = matrix[0, 1] * y + matrix[0, 2]
    k1 = matrix[1, 1] * y + matrix[1, 2]
    k2 = matrix[2, 1] * y + matrix[2, 2]
    m0, m1, m2 = matrix[0, 0], matrix[1, 0], matrix[2, 0]
    for run in range(runs):
        i, n = labels[starts[run] * STRIDE], 0
        z1 = zx = zz = zzx = zzxx = 0.0
        x_low, x_high, y_low, y_high, z_low, z_high = b[i, 4], b[i, 5], b[i, 6], b[i, 7], b[i, 8], b[i, 9]
        for k in range(starts[run], starts[run + 1]):
            z, xz = depth[0, k], depth[1, k]
            n += int(z > 0.0)
            z1 += z
            zx += xz
            zz += z * z
            zzx += xz * z
            zzxx += xz * xz
            rx, ry, rz = points[0, k], points[1, k], points[2, k]
            x_low, x_high = rx if rx < x_low else x_low, rx if rx > x_high else x_high
            y_low, y_high = ry if ry < y_low else y_low, ry if ry > y_high else y_high
            z_low, z_high = rz if rz < z_low else z_low, rz if rz > z_high else z_high
        s[i, MEASURED] += n
        s[i, X] += m0 * zx + k0 * z1
        s[i, Y] += m1 * zx + k1 * z1
        s[i, Z] += m2 * zx + k2 * z1
        s[i, XX] += m0 * m0 * zzxx + 2.0 * m0 * k0 * zzx + k0 * k0 * zz
        s[i, YY] += m1 * m1 * zzxx + 2.0 * m1 * k1 * zzx + k1 * k1 * zz
        s[i, ZZ] += m2 * m2 * zzxx + 2.0 * m2 * k2 * zzx + k2 * k2 * zz
        s[i, DEPTH] += z1
        s[i, DEPTH2] += zz
        b[i, 4], b[i, 5], b[i, 6], b[i, 7], b[i, 8], b[i, 9] = x_low, x_high, y_low, y_high, z_low, z_high


@njit(cache=True, nogil=True)
def _name_row(faces, named):  # type: ignore[no-untyped-def]
    """Write how many pixels of a row up to k have each id 1..5 into column k + 1 of `named`."""
    for k in range(len(named) - 1):
        named[k + 1] = np.int64(1) << _FIFTH * np.int64(faces[k * STRIDE]) >> _FIFTH  # nothing for id 0
    total = np.int64(0)
    for k in range(1, len(named)):
        total += named[k]
        named[k] = total


@njit(cache=True, nogil=True)
def _add_names(s, labels, starts, runs, named):  # type: ignore[no-untyped-def]
    """Add how many pixels of each run have each id of the orientation map; those of id 0 are the rest."""
    for run in range(runs):
        i = labels[starts[run] * STRIDE]
        for first in range(starts[run], starts[run + 1], _IN_FIFTH):
            end = min(first + _IN_FIFTH, starts[run + 1])
            none, counts = end - first, named[end] - named[first]
            for face in range(1, 6):
                n = counts >> _FIFTH * (face - 1) & _IN_FIFTH
                s[i, ORIENTATION + face] += n
                none -= n
            s[i, ORIENTATION] += none


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
