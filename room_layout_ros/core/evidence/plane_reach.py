"""What lies beyond the plane of each plane segment: a wall ends the room, a wardrobe's front does not."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .room_extents import CELL_PX

COLUMNS = (
    "reach_beyond",
    "reach_before",
    "reach_on",
    "reach_on_top",
    "reach_on_bottom",
    "reach_beside_beyond",
    "reach_above_beyond",
    "reach_near_beyond",
    "reach_ceiling",
    "reach_floor",
)
"""Shares of the scene's cells beyond the plane, before it and on it; how near the cells on it come to the ceiling and
to the floor (m); shares beyond it among the cells beside the segment, above it and close around it; how far ceiling and
floor go on beyond it (m)."""

_TOLERANCE_M, _TOLERANCE_PER_M = 0.10, 0.005
"""Off the plane is what is farther from it than the first plus the second times the square of the range."""

_LEVEL_M = 0.12
"""Cells so near to the scene's top or bottom are ceiling or floor."""

_AROUND_PX = 6
"""How many cells around a segment's box are close to it."""


def compute_plane_reach(
    points: NDArray[np.float32],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    planes: NDArray[np.float64],
    boxes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Compare all cells of a frame with each plane.

    Parameters
    ----------
    points : (rows, cols, 3) float32
        Means of the cells of 8 px in room axes, m; NaN where not measured.
    low, high : (3,) float64
        Robust extents of the scene.
    planes : (S, 4) float64
        Normal away from the camera in room axes and distance; NaN for none.
    boxes : (S, 4) float64
        Bounds of the segments in the image: x low, x high, y low, y high, px.

    Returns
    -------
    (S, 10) float64
        `COLUMNS`; NaN without a plane or where there is no cell to compare.
    """
    cells = np.floor(boxes / CELL_PX).astype(np.int64)
    return np.asarray(_reach(points, float(low[1]), float(high[1]), planes, cells))


@njit(cache=True, nogil=True)
def _reach(points, top, bottom, planes, cells):  # type: ignore[no-untyped-def]
    rows, cols = points.shape[:2]
    out = np.full((planes.shape[0], 10), np.nan)
    for s in range(planes.shape[0]):
        nx, ny, nz, d = planes[s]
        if np.isnan(d):
            continue
        left, right, upper, lower = cells[s]
        count = beyond = before = on = 0
        beside = beside_beyond = above = above_beyond = near = near_beyond = 0
        on_top, on_bottom = np.inf, -np.inf
        ceiling = floor = 0.0
        for row in range(rows):
            for col in range(cols):
                x, y, z = points[row, col]
                if np.isnan(z):
                    continue
                off = nx * x + ny * y + nz * z - d
                tolerance = _TOLERANCE_M + _TOLERANCE_PER_M * (x * x + y * y + z * z)
                count += 1
                if off > tolerance:
                    beyond += 1
                    if y < top + _LEVEL_M:
                        ceiling = max(ceiling, off)
                    elif y > bottom - _LEVEL_M:
                        floor = max(floor, off)
                elif off < -tolerance:
                    before += 1
                else:
                    on += 1
                    on_top, on_bottom = min(on_top, y), max(on_bottom, y)
                in_rows, in_cols = upper <= row <= lower, left <= col <= right
                if in_rows and not in_cols:
                    beside += 1
                    beside_beyond += off > tolerance
                if in_cols and row < upper:
                    above += 1
                    above_beyond += off > tolerance
                if (
                    not (in_rows and in_cols)
                    and upper - _AROUND_PX <= row <= lower + _AROUND_PX
                    and left - _AROUND_PX <= col <= right + _AROUND_PX
                ):
                    near += 1
                    near_beyond += off > tolerance
        out[s, 0], out[s, 1], out[s, 2] = beyond / count, before / count, on / count
        if on > 0:
            out[s, 3], out[s, 4] = on_top - top, bottom - on_bottom
        if beside > 0:
            out[s, 5] = beside_beyond / beside
        if above > 0:
            out[s, 6] = above_beyond / above
        if near > 0:
            out[s, 7] = near_beyond / near
        out[s, 8], out[s, 9] = ceiling, floor
    return out
