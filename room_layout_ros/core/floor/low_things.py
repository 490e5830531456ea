"""Low things that noise hides from the depth, and a colour of their own parts from the floor.

A cube of 5 cm at 2.8 m is two deviations of a stereo camera's noise: no cell by itself tells it from a ripple. But the
picture shows where it ends. Neighbouring cells whose colour the floor of this frame does not have are one patch, and
the mean height of a patch is known better than that of its cells. A floor of many colours makes nothing stand out.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..config import EstimatorConfig
from ..depth import MAD_TO_SIGMA
from .floor_cells import FLOOR_PIXELS, HEIGHT, FloorCells
from .floor_pixels import FLOOR_PIXEL
from .free_cells import Levels

_STRIDE = 2
_MIN_PIXELS = 3
_MIN_CELLS = 50
"""Floor of fewer cells has no colour to differ from."""

_OTHER, _SOMEWHAT = 5.0, 2.5
"""In robust deviations of the floor's colours: a patch has a cell of the first, and grows over cells of the second."""

_LEAST_DEVIATION = 0.004
"""Of the shares of red and green: no floor is more even than this."""

_SAMPLE = 800
"""So many cells tell the colours of the floor."""

_MOST_CELLS = 40
"""A larger patch is a rug."""

_SHARED = 0.25
"""Of the variance of a cell's height: what neighbouring cells share, the slow error."""

_CLEARED_SIGMAS = 2.5
"""The picture warns, the depth has to clear: by so many deviations a patch is lower than a thing."""

_SIGMAS, _MEAN_SHARE = 2.0, 0.5
"""The mean height of a patch, its rim with it, is above so many deviations and this share of what counts as a thing."""


def find_low_things(
    color: NDArray[np.uint8] | None,
    cells: FloorCells,
    levels: Levels,
    thing: NDArray[np.bool_],
    config: EstimatorConfig,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return two (rows, cols) bool: small patches of another colour that are things, and those that may be.

    A patch is a thing where its mean height says so, and may be one unless its height is surely less.

    Parameters
    ----------
    color : (H, W, 3) uint8 RGB, None: there are none.
    levels : of `floor_levels`. thing : (rows, cols) bool of `occupied_cells`.
    """
    nothing = np.zeros_like(thing)
    if color is None:
        return nothing, nothing
    odd = _oddness(_cell_colors(color, cells.kind, cells.cell, cells.sums.shape[:2]))
    odd[thing] = 0.0
    count, patch = cv2.connectedComponents((odd > _SOMEWHAT).astype(np.uint8), connectivity=8)
    if count == 1:
        return nothing, nothing
    seen = (levels.height_m, levels.sigma_m)
    thing, doubt = _raised(patch, count, odd, cells.sums, seen, config.obstacle_min_height_m)
    return np.asarray(thing), np.asarray(doubt)


@njit(cache=True, nogil=True, error_model="numpy")
def _oddness(colors):  # type: ignore[no-untyped-def]
    """(rows, cols) float32 how many deviations a cell's colour is from the floor's median, 0 where it has none."""
    rows, cols, _ = colors.shape
    odd = np.zeros((rows, cols), np.float32)
    seen, count = np.empty((2, rows * cols), np.float32), 0
    for i in range(rows):
        for j in range(cols):
            if np.isfinite(colors[i, j, 0]):
                seen[0, count], seen[1, count] = colors[i, j, 0], colors[i, j, 1]
                count += 1
    if count < _MIN_CELLS:
        return odd
    for axis in range(2):
        part = seen[axis, : count : max(count // _SAMPLE, 1)].copy()
        middle = _median(part)
        spread = max(np.float32(MAD_TO_SIGMA) * _median(np.abs(part - middle)), np.float32(_LEAST_DEVIATION))
        for i in range(rows):
            for j in range(cols):
                if np.isfinite(colors[i, j, 0]):
                    odd[i, j] = max(odd[i, j], abs(colors[i, j, axis] - middle) / spread)
    return odd


@njit(cache=True, nogil=True)
def _median(values):  # type: ignore[no-untyped-def]
    """Median of float32 values as float32."""
    ordered = np.sort(values)
    n = len(ordered)
    return (ordered[(n - 1) // 2] + ordered[n // 2]) * np.float32(0.5)


@njit(cache=True, nogil=True)
def _cell_colors(color, kind, cell, shape):  # type: ignore[no-untyped-def]
    """(rows, cols, 2) float32 shares of red and green in each cell's floor, NaN where too few pixels are."""
    rows, cols = shape
    sums = np.zeros((rows * cols, 4), np.int32)
    for v in range(0, kind.shape[0], _STRIDE):
        for u in range(0, kind.shape[1], _STRIDE):
            if kind[v, u] == FLOOR_PIXEL and cell[v, u] >= 0:
                red, green, blue = color[v, u, 0], color[v, u, 1], color[v, u, 2]
                one = sums[cell[v, u]]
                one[0] += red
                one[1] += green
                one[2] += np.int32(red) + np.int32(green) + np.int32(blue)
                one[3] += 1
    colors = np.full((rows, cols, 2), np.nan, np.float32)
    for k in range(rows * cols):
        if sums[k, 3] >= _MIN_PIXELS and sums[k, 2] > 0:
            whole = np.float32(sums[k, 2])
            colors[k // cols, k % cols, 0] = np.float32(sums[k, 0]) / whole
            colors[k // cols, k % cols, 1] = np.float32(sums[k, 1]) / whole
    return colors


@njit(cache=True, nogil=True)
def _raised(patch, count, odd, sums, levels, lowest):  # type: ignore[no-untyped-def]
    """Cells of the small patches of another colour that are high for their number of cells, and that may be."""
    rows, cols = patch.shape
    level, sigma = levels
    height, pixels, cells, noise = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    oddest, highest = np.zeros(count), np.zeros(count)
    for i in range(rows):
        for j in range(cols):
            k = patch[i, j]
            if k > 0:
                height[k] += sums[i, j, HEIGHT]
                pixels[k] += sums[i, j, FLOOR_PIXELS]
                noise[k] = max(noise[k], sigma[i, j])
                oddest[k] = max(oddest[k], odd[i, j])
                highest[k] = max(highest[k], level[i, j])
                cells[k] += 1
    thing, doubt = np.zeros((rows, cols), np.bool_), np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            k = patch[i, j]
            if k > 0 and oddest[k] >= _OTHER and cells[k] <= _MOST_CELLS:
                mean, sure = height[k] / pixels[k], noise[k] * np.sqrt(1.0 / cells[k] + _SHARED)
                thing[i, j] = highest[k] > lowest and mean > max(_MEAN_SHARE * lowest, _SIGMAS * sure)
                doubt[i, j] = mean + _CLEARED_SIGMAS * sure > lowest
    return thing, doubt
