"""The free space as a laser scanner would tell it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..depth import DepthGeometry
from .floor_cells import OCCUPIED_CELL, UNKNOWN_CELL, FloorCells
from .floor_frame import view_fan
from .floor_pixels import OBSTACLE_PIXEL, WALL_PIXEL

_MIN_HITS = 3
"""So many pixels make a range: the last of them is it."""

_STRIDE = 2
"""Every second row and column is looked at."""


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
    """Return the nearest thing or wall per beam: the third nearest of its pixels in occupied cells or beyond the grid.

    Parameters
    ----------
    cells : FloorCells. grid : (rows, cols) int8, decided; in the grid things count only in occupied cells, so that a
        stray pixel is no obstacle. beams : number of beams across what is in the picture, at most a half circle.
    """
    right, left = view_fan(geometry.camera, T_camera_floor)
    increment = (left - right) / beams
    angle_min = right + 0.5 * increment
    ranges = _cast(
        geometry.inverse_depth, geometry.camera.numbers, T_camera_floor, cells.kind, cells.cell, grid.ravel(),
        (right, increment, beams), (*cells.origin_m, cells.resolution_m, grid.shape[1]),
    )  # fmt: skip
    return RangeScan(angle_min, increment, ranges)


@njit(cache=True, nogil=True, error_model="numpy")
def _bearing(x, y):  # type: ignore[no-untyped-def]
    """arctan2(y, x) for x > 0, to 1e-5 rad (Abramowitz and Stegun, 4.4.49): a five-hundredth of a beam."""
    steep = abs(y) > x
    t = (x if steep else y) / (y if steep else x)
    q = t * t
    angle = t * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351))))
    turned = (0.5 * np.pi if y > 0 else -0.5 * np.pi) - angle
    return turned if steep else angle


@njit(cache=True, nogil=True, error_model="numpy")
def _row_beams(column, ahead, ahead_per_px, across, across_per_px, first, per_beam, beams):  # type: ignore[no-untyped-def]
    """Write the beam of each pixel of a row, below 0 where it is not ahead; by itself, so that it runs on vectors."""
    for k in range(len(column)):
        ax, ay = ahead + ahead_per_px * column[k], across + across_per_px * column[k]
        beam = np.int32(np.floor((_bearing(ax, ay) - first) * per_beam))
        beams[k] = beam if ax > 0.0 else np.int32(-1)  # the beams lie within a half circle


@njit(cache=True, nogil=True)
def _cast(inverse, intrinsics, T, kind, cell, grid, fan, corner):  # type: ignore[no-untyped-def]
    """Ranges (beams,) float32 of `RangeScan`: of pixels, then of cells that no pixel tells of."""
    ranges = _pixel_ranges(inverse, intrinsics, T, kind, cell, grid, fan)
    known = _add_cells(ranges, grid, fan, corner)
    for beam in range(len(ranges)):
        if not known[beam] and ranges[beam] == np.inf:
            ranges[beam] = np.nan
    return ranges.astype(np.float32)


@njit(cache=True, nogil=True)
def _pixel_ranges(inverse, intrinsics, T, kind, cell, grid, fan):  # type: ignore[no-untyped-def]
    """Distance (beams,) of the `_MIN_HITS`-th nearest pixel of walls, and of things in occupied cells or outside the
    grid; inf without.
    """
    fx, fy, cx, cy = intrinsics
    first, increment, beams = fan
    per_beam = 1.0 / increment
    nearest = np.full((beams, _MIN_HITS), np.inf)
    height, width = inverse.shape
    column = np.arange(0.0, width, _STRIDE)
    beam_of = np.empty(len(column), np.int32)
    # from below, where the nearest are: all others are passed over
    for v in range((height - 1) // _STRIDE * _STRIDE, -1, -_STRIDE):
        ry = (v - cy) / fy
        ax0, ay0 = T[1, 0] * ry + T[2, 0] - T[0, 0] * cx / fx, T[1, 1] * ry + T[2, 1] - T[0, 1] * cx / fx
        _row_beams(column, ax0, T[0, 0] / fx, ay0, T[0, 1] / fx, first, per_beam, beam_of)
        for u in range(0, width, _STRIDE):
            what = kind[v, u]
            if what != OBSTACLE_PIXEL and what != WALL_PIXEL:
                continue
            if what == OBSTACLE_PIXEL and cell[v, u] >= 0 and grid[cell[v, u]] != OCCUPIED_CELL:
                continue
            beam = beam_of[u // _STRIDE]
            if beam < 0 or beam >= beams:
                continue
            ax, ay = ax0 + T[0, 0] / fx * u, ay0 + T[0, 1] / fx * u
            most = nearest[beam, _MIN_HITS - 1] * inverse[v, u]  # of the ray, so that few need a root and a division
            if ax * ax + ay * ay >= most * most:
                continue
            r = np.sqrt(ax * ax + ay * ay) / inverse[v, u]
            for k in range(_MIN_HITS):
                if r < nearest[beam, k]:
                    nearest[beam, k], r = r, nearest[beam, k]
    return nearest[:, _MIN_HITS - 1].copy()


@njit(cache=True, nogil=True)
def _add_cells(ranges, grid, fan, corner):  # type: ignore[no-untyped-def]
    """Shorten ranges to occupied cells before them; return in which directions any cell is known (beams,) bool."""
    first, increment, beams = fan
    x0, y0, size, cols = corner
    known = np.zeros(beams, np.bool_)
    for index in range(len(grid)):
        if grid[index] == UNKNOWN_CELL:
            continue
        x, y = x0 + (index % cols + 0.5) * size, y0 + (index // cols + 0.5) * size
        r = np.sqrt(x * x + y * y)
        angle, half = _bearing(x, y), 0.5 * size / r
        low = max(int(np.floor((angle - half - first) / increment)), 0)
        high = min(int(np.floor((angle + half - first) / increment)), beams - 1)
        for beam in range(low, high + 1):
            known[beam] = True
            # a low thing found by the mean of its cell alone, a hole, a wall that is hidden
            if grid[index] == OCCUPIED_CELL and r + size < ranges[beam]:
                ranges[beam] = r
    return known
