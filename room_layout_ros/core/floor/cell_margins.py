"""Cells that are not free for what stands near them: within the margin before a thing or a wall, and close behind.

What a thing's pixels say of its place is as uncertain as their depth, and that goes along the ray; to its side it is
known to a pixel. So before a thing the margin begins at its pixels on the ray of the cell, beside it there is none, and
behind it cells are not free as far as noise and the spacing of the pixels on a level surface may hide the rest of it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .floor_cells import FINE, FREE_CELL, UNKNOWN_CELL, FloorCells

Reach = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Four (rows, cols) of metres: so much behind its pixels in the cell a thing begins (before them: below 0; inf: there
is none); distance from below the camera at which what fills the cell begins (inf); at which it may end (-inf); and at
which the far side of a hole in it may end (-inf)."""

_STEP_CELLS, _BESIDE_CELLS = 0.125, 0.1
"""Of the look along the ray: it shall not step over the corner of a quarter cell; and how wide it is to either side."""

_FARTHEST_CELLS = 1.5
"""It goes on so far beyond the margin: so early a thing may stand, so far may it go on behind its pixels."""

_FARTHEST_HOLE_M = 0.8
"""The far side of a hole looks like floor no farther before its upper edge."""

_MARGIN_CELLS = 0.15
"""Added to the margin: the place of a thing is known to a pixel, not better (7 mm for cells of 5 cm)."""


def keep_away(
    grid: NDArray[np.int8], reach: Reach, cells: FloorCells, walls: NDArray[np.float64], margin_m: float
) -> None:
    """Make free cells unknown that are too near to something, in place.

    Parameters
    ----------
    grid : (rows, cols) int8. reach : of what stands in the cells.
    walls : (n, 4) float64 of `walls_on_floor`. margin_m : before things and walls, along the ray.
    """
    size = cells.resolution_m
    margin = margin_m + _MARGIN_CELLS * size
    around = _around(reach, margin / size + _FARTHEST_CELLS)
    _keep_away(grid, around, cells.stands, reach, walls, cells.corner, margin)


def _around(reach: Reach, farthest_cells: float) -> NDArray[np.uint8]:
    """(rows, cols) uint8, 1 where a look along the ray may come upon a thing: to save the others the look."""
    early, nearest, farthest, _ = reach
    some = (early < np.inf) | (nearest < np.inf) | (farthest > -np.inf)
    side = 2 * int(np.ceil(farthest_cells)) + 1
    return np.asarray(cv2.dilate(some.astype(np.uint8), np.ones((side, side), np.uint8)))


@njit(cache=True, nogil=True)
def _keep_away(grid, around, stands, reach, walls, corner, margin):  # type: ignore[no-untyped-def]
    """Free cells become unknown within the margin before a thing or a wall, or behind a thing where it may reach."""
    rows, cols = grid.shape
    x0, y0, size = corner
    _hide_far_sides(grid, reach[3], corner)
    for i in range(rows):
        y = y0 + (i + 0.5) * size
        for j in range(cols):
            if grid[i, j] != FREE_CELL:
                continue
            x = x0 + (j + 0.5) * size
            r = np.sqrt(x * x + y * y)
            near = around[i, j] and _is_before_or_behind(i, j, (x / r, y / r, r), stands, reach, size, margin)
            for k in range(len(walls)):
                ahead = 1.0 + margin / r
                near = near or walls[k, 0] * x * ahead + walls[k, 1] * y * ahead >= walls[k, 2]
            if near:
                grid[i, j] = UNKNOWN_CELL


@njit(cache=True, nogil=True)
def _is_before_or_behind(i, j, ray, stands, reach, size, margin):  # type: ignore[no-untyped-def]
    """Whether a thing may stand within the margin behind the middle of a cell on its ray, or reach to it."""
    early, nearest, farthest, _ = reach
    ex, ey, r = ray
    rows, cols = early.shape
    steps = int(np.ceil((margin + _FARTHEST_CELLS * size) / (_STEP_CELLS * size)))
    for k in range(-steps, steps + 1):
        ahead = _STEP_CELLS * k
        m, n = int(np.floor(i + 0.5 + ahead * ey)), int(np.floor(j + 0.5 + ahead * ex))
        if not (0 <= m < rows and 0 <= n < cols):
            continue
        if (k >= 0 and nearest[m, n] <= r + margin) or (k < 0 and farthest[m, n] >= r):
            return True
        for side in range(-1, 2 if k >= 0 else -1):
            a, b = i + 0.5 + ahead * ey + side * _BESIDE_CELLS * ex, j + 0.5 + ahead * ex - side * _BESIDE_CELLS * ey
            m, n = int(np.floor(a)), int(np.floor(b))
            inside = 0 <= m < rows and 0 <= n < cols
            if inside and ahead * size + early[m, n] <= margin and stands[int(a * FINE), int(b * FINE)]:
                return True
    return False


@njit(cache=True, nogil=True)
def _hide_far_sides(grid, hole_end, corner):  # type: ignore[no-untyped-def]
    """Free cells become unknown behind a hole as far as its far side may look like floor."""
    rows, cols = grid.shape
    x0, y0, size = corner
    for i in range(rows):
        y = y0 + (i + 0.5) * size
        for j in range(cols):
            if hole_end[i, j] == -np.inf:
                continue
            x = x0 + (j + 0.5) * size
            r = np.sqrt(x * x + y * y)
            for k in range(int(min(hole_end[i, j] - r, _FARTHEST_HOLE_M) / (2.0 * _STEP_CELLS * size)) + 1):
                ahead = 2.0 * _STEP_CELLS * k / r
                m, n = int(np.floor(i + 0.5 + ahead * y)), int(np.floor(j + 0.5 + ahead * x))
                if 0 <= m < rows and 0 <= n < cols and grid[m, n] == FREE_CELL:
                    grid[m, n] = UNKNOWN_CELL
