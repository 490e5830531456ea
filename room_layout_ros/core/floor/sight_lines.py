"""Floor that a costmap may clear along the straight line to it.

A camera looks over a thing of 4 cm and sees floor behind it. A costmap's layer is flat: it clears every cell between
the sensor and a point, and so would clear the thing. Only floor before the first thing in its direction is offered,
and before the first gap in the depth beyond which floor goes on: a pit that swallows the light, a black box. Gaps of a
cell or two that are floor by the picture do not count.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .floor_cells import FREE_CELL, OCCUPIED_CELL

_BEAMS = 1440
"""Directions over the half circle ahead: an eighth of a degree, a quarter of a cell of 5 cm at 6 m."""

_BLUR_CELLS = 1.5
"""The cells of a costmap lie askew to these ones: a line that passes this near to a cell may go through it there."""


def in_line_of_sight(
    grid: NDArray[np.int8], blind: NDArray[np.bool_], corner: tuple[float, float, float]
) -> NDArray[np.bool_]:
    """Return (rows, cols) bool: free cells before which no occupied or blind one lies, seen from below the camera.

    Blind cells that are nearer than all free ones in their direction do not count: the sensor's shortest range.

    Parameters
    ----------
    grid : (rows, cols) int8, decided. blind : (rows, cols) bool of `blind_cells`.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    """
    blur = _BLUR_CELLS * corner[2]
    return np.asarray(_in_line(grid, blind, *_directions(grid.shape, corner, blur), blur))


@lru_cache(maxsize=1)  # a node has one grid, and a large one has many cells (14 bytes each)
def _directions(
    shape: tuple[int, ...], corner: tuple[float, float, float], blur: float
) -> tuple[NDArray[np.float64], NDArray[np.int16]]:
    """Of each cell of a grid: distance (rows, cols) of its middle; first, last and middle direction (rows, cols, 3).

    Never written to: threads share them. Threads with unlike grids compute them anew in turn, with the same result.
    """
    distance, beams = _cell_directions(shape[0], shape[1], corner, blur)
    return np.asarray(distance), np.asarray(beams)


@njit(cache=True, nogil=True)
def _cell_directions(rows, cols, corner, blur):  # type: ignore[no-untyped-def]
    """Distance and directions of `_directions`; the first and last are those of a disc of `blur` m about the middle."""
    x0, y0, size = corner
    distance, beams = np.empty((rows, cols)), np.empty((rows, cols, 3), np.int16)
    for i in range(rows):
        for j in range(cols):
            x, y = x0 + (j + 0.5) * size, y0 + (i + 0.5) * size
            r, bearing = np.sqrt(x * x + y * y), np.arctan2(y, x)
            half = np.arcsin(min(blur / r, 1.0))
            distance[i, j] = r
            beams[i, j, 0], beams[i, j, 1] = _beam(bearing - half), _beam(bearing + half)
            beams[i, j, 2] = _beam(bearing)
    return distance, beams


@njit(cache=True, nogil=True)
def _in_line(grid, blind, distance, beams, blur):  # type: ignore[no-untyped-def]
    """Note per direction how near the first free cell is, then the first that counts; free cells before that remain."""
    rows, cols = grid.shape
    free_from, first = np.full(_BEAMS, np.inf), np.full(_BEAMS, np.inf)
    for look_for_free in (True, False):
        for i in range(rows):
            for j in range(cols):
                if look_for_free:
                    counts = grid[i, j] == FREE_CELL
                else:
                    counts = grid[i, j] == OCCUPIED_CELL or (blind[i, j] and grid[i, j] != FREE_CELL)
                if not counts:
                    continue
                r = distance[i, j]
                for k in range(beams[i, j, 0], beams[i, j, 1] + 1):
                    if look_for_free:
                        free_from[k] = min(free_from[k], r)
                    elif grid[i, j] == OCCUPIED_CELL or r > free_from[k]:
                        first[k] = min(first[k], r)
    result = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if grid[i, j] == FREE_CELL:
                result[i, j] = distance[i, j] < first[beams[i, j, 2]] - blur
    return result


@njit(cache=True, nogil=True)
def _beam(bearing):  # type: ignore[no-untyped-def]
    """Direction 0.._BEAMS-1 of a bearing in radians, from the right to the left."""
    return min(max(int((bearing / np.pi + 0.5) * _BEAMS), 0), _BEAMS - 1)
