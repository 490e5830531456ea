"""How far the scene reaches: robust extents along the room axes, and the farthest range seen in each azimuth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics

CELL_PX = 8
_BINS = 120
"""Azimuth bins of 3 degrees: wide enough that a few cells fall into each."""

LOW_QUANTILE, HIGH_QUANTILE = 0.01, 0.99


@dataclass(frozen=True, slots=True)
class RoomExtents:
    """Extents of the measured points in room axes, in metres.

    Attributes
    ----------
    low, high : (3,) float64
        1st and 99th percentile of X, Y and Z; NaN without depth.
    farthest : (120,) float32
        Largest horizontal distance from the camera seen in each azimuth bin, 0 where nothing was measured.
    beyond : (3, 2, 64) float32
        Share of the cells farther out than d_k = k * 0.15 m along the negative and the positive axis.
    cells : (rows, cols, 3) float32
        Mean points of the cells of `CELL_PX` in room axes, m; NaN where not measured.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    farthest: NDArray[np.float32]
    beyond: NDArray[np.float32]
    cells: NDArray[np.float32]


BEYOND_STEP_M = 0.15


def compute_room_extents(
    inverse_depth: NDArray[np.float32], R_room_camera: NDArray[np.float64], camera: CameraIntrinsics
) -> RoomExtents:
    """Measure the scene's reach on 8-pixel cells (their mean is less noisy than a pixel)."""
    matrix = np.ascontiguousarray(R_room_camera @ np.linalg.inv(camera.matrix))
    points, cells = _cell_points(inverse_depth, matrix)
    if len(points) == 0:
        nan = np.full(3, np.nan)
        return RoomExtents(nan, nan, np.zeros(_BINS, np.float32), np.zeros((3, 2, 64), np.float32), cells)
    low, high = np.quantile(points, [LOW_QUANTILE, HIGH_QUANTILE], axis=0)
    farthest, beyond = _reach(points)
    return RoomExtents(low, high, farthest, beyond, cells)


def azimuth_bin(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.int64]:
    """Bin of `RoomExtents.farthest` for horizontal directions (x right, z front)."""
    return np.minimum(((np.arctan2(x, z) + np.pi) * (_BINS / (2 * np.pi))).astype(np.int64), _BINS - 1)


@njit(cache=True, nogil=True)
def _cell_points(inverse, matrix):  # type: ignore[no-untyped-def]
    height, width = inverse.shape
    rows, cols = height // CELL_PX, width // CELL_PX
    points = np.empty((rows * cols, 3))
    cells = np.full((rows, cols, 3), np.nan, np.float32)
    n = 0
    for row in range(rows):
        for col in range(cols):
            total, seen = 0.0, 0
            for y in range(row * CELL_PX, (row + 1) * CELL_PX, 2):
                for x in range(col * CELL_PX, (col + 1) * CELL_PX, 2):
                    w = inverse[y, x]
                    if w > 0:
                        total += w
                        seen += 1
            if seen < 6:
                continue
            z = seen / total
            px, py = (col + 0.5) * CELL_PX - 0.5, (row + 0.5) * CELL_PX - 0.5
            for k in range(3):
                points[n, k] = (matrix[k, 0] * px + matrix[k, 1] * py + matrix[k, 2]) * z
                cells[row, col, k] = points[n, k]
            n += 1
    return points[:n], cells


@njit(cache=True, nogil=True)
def _reach(points):  # type: ignore[no-untyped-def]
    farthest = np.zeros(_BINS, np.float32)
    beyond = np.zeros((3, 2, 64), np.float32)
    for i in range(points.shape[0]):
        x, z = points[i, 0], points[i, 2]
        k = min(int((np.arctan2(x, z) + np.pi) * (_BINS / (2 * np.pi))), _BINS - 1)
        farthest[k] = max(farthest[k], np.sqrt(x * x + z * z))
        for axis in range(3):
            value = points[i, axis]
            side = 1 if value > 0 else 0
            beyond[axis, side, min(int(abs(value) / BEYOND_STEP_M), 63)] += 1.0
    for axis in range(3):
        for side in range(2):
            for k in range(62, -1, -1):
                beyond[axis, side, k] += beyond[axis, side, k + 1]
    beyond /= points.shape[0]
    return farthest, beyond
