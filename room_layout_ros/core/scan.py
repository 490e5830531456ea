"""The free space as a laser scanner would tell it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import DepthGeometry
from .floor_cells import OBSTACLE_PIXEL, WALL_PIXEL, FloorCells

_MIN_HITS = 3
_STRIDE = 2


@dataclass(frozen=True, slots=True)
class RangeScan:
    """Ranges on the floor, seen from the point below the camera, in the floor frame.

    Attributes
    ----------
    angle_min, angle_increment : radians, counter-clockwise from ahead; of the middles of the beams.
    ranges_m : (n,) float32 nearest thing or wall; +inf where none is but floor was seen; NaN where nothing is known.
    """

    angle_min: float
    angle_increment: float
    ranges_m: NDArray[np.float32]


def cast_scan(
    geometry: DepthGeometry,
    cells: FloorCells,
    grid: NDArray[np.int8],
    T_camera_floor: NDArray[np.float64],
    beams: int,
) -> RangeScan:
    """Return the nearest thing or wall per beam: the third nearest of its pixels in occupied cells.

    Parameters
    ----------
    cells : FloorCells. grid : (rows, cols) int8, decided; things count only in occupied cells, so that a stray
        pixel is no obstacle. beams : number of beams across the horizontal field of view.
    """
    c = geometry.camera
    left, right = np.arctan2(c.cx + 0.5, c.fx), np.arctan2(c.width - 0.5 - c.cx, c.fx)
    increment = float(left + right) / beams
    angle_min = float(-right) + 0.5 * increment
    ranges = _cast(
        geometry.inverse_depth, (c.fx, c.fy, c.cx, c.cy), T_camera_floor, cells.kind, cells.cell, grid.ravel(),
        (float(-right), increment, beams), (*cells.origin_m, cells.resolution_m, grid.shape[1]),
    )  # fmt: skip
    return RangeScan(angle_min, increment, ranges)


@njit(cache=True, nogil=True)
def _cast(inverse, intrinsics, T, kind, cell, grid, fan, corner):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = intrinsics
    first, increment, beams = fan
    x0, y0, size, cols = corner
    nearest = np.full((beams, _MIN_HITS), np.inf)
    known = np.zeros(beams, np.bool_)
    height, width = inverse.shape
    for v in range(0, height, _STRIDE):
        ry = (v - cy) / fy
        for u in range(0, width, _STRIDE):
            what = kind[v, u]
            if what != OBSTACLE_PIXEL and what != WALL_PIXEL:
                continue
            if what == OBSTACLE_PIXEL and (cell[v, u] < 0 or grid[cell[v, u]] != 100):
                continue
            rx, z = (u - cx) / fx, 1.0 / inverse[v, u]
            x = (T[0, 0] * rx + T[1, 0] * ry + T[2, 0]) * z
            y = (T[0, 1] * rx + T[1, 1] * ry + T[2, 1]) * z
            beam = int(np.floor((np.arctan2(y, x) - first) / increment))
            if beam < 0 or beam >= beams:
                continue
            r = np.sqrt(x * x + y * y)
            for k in range(_MIN_HITS):
                if r < nearest[beam, k]:
                    nearest[beam, k], r = r, nearest[beam, k]
    ranges = nearest[:, _MIN_HITS - 1].copy()
    for index in range(len(grid)):
        if grid[index] < 0:
            continue
        x, y = x0 + (index % cols + 0.5) * size, y0 + (index // cols + 0.5) * size
        r = np.sqrt(x * x + y * y)
        angle, half = np.arctan2(y, x), 0.5 * size / r
        low = max(int(np.floor((angle - half - first) / increment)), 0)
        high = min(int(np.floor((angle + half - first) / increment)), beams - 1)
        for beam in range(low, high + 1):
            known[beam] = True
            # a low thing found by the mean of its cell alone, a hole, a wall that is hidden
            if grid[index] == 100 and r + size < ranges[beam]:
                ranges[beam] = r
    for beam in range(beams):
        if not known[beam] and ranges[beam] == np.inf:
            ranges[beam] = np.nan
    return ranges.astype(np.float32)
