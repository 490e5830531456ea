"""Floor that a costmap may clear along the straight line to it.

A camera looks over a thing of 4 cm and sees floor behind it. A costmap's layer is flat: it clears every cell between
the sensor and a point, and so would clear the thing. Only floor before the first thing in its direction is offered.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .free_cells import OCCUPIED_CELL

_BEAMS = 1440
"""Directions over the half circle ahead: an eighth of a degree, a quarter of a cell of 5 cm at 6 m."""

_BLUR_CELLS = 1.5
"""The cells of a costmap lie askew to these ones: a line that passes this near to a cell may go through it there."""


def in_line_of_sight(grid: NDArray[np.int8], corner: tuple[float, float, float]) -> NDArray[np.bool_]:
    """Return (rows, cols) bool: no occupied cell stands before the cell, seen from below the camera.

    Parameters
    ----------
    grid : (rows, cols) int8, decided.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    """
    size = corner[2]
    rows, cols = np.nonzero(grid == OCCUPIED_CELL)
    range_m, bearing = _polar(rows, cols, corner)
    half = np.arcsin(np.minimum(_BLUR_CELLS * size / range_m, 1.0))
    first = np.full(_BEAMS, np.inf)
    low, high = _beam(bearing - half), _beam(bearing + half)
    for k in np.argsort(-range_m):  # the nearest is written last
        first[low[k] : high[k] + 1] = range_m[k]
    index = np.indices(grid.shape)
    cell_range_m, cell_bearing = _polar(index[0], index[1], corner)
    return np.asarray(cell_range_m < first[_beam(cell_bearing)] - _BLUR_CELLS * size)


def _polar(
    row: NDArray[np.int64], col: NDArray[np.int64], corner: tuple[float, float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range and bearing of the centres of cells."""
    x0, y0, size = corner
    x, y = x0 + (col + 0.5) * size, y0 + (row + 0.5) * size
    return np.hypot(x, y), np.arctan2(y, x)


def _beam(bearing: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.clip(((bearing / np.pi + 0.5) * _BEAMS).astype(np.int64), 0, _BEAMS - 1)
