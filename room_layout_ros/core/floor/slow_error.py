"""The slow error of a depth sensor (ripple, radial error), measured on the floor and taken off the whole image.

In inverse depth it hardly changes over tens of pixels: it is followed over tiles of the image, as the median error of
the pixels of floor in each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .height_bins import BAND_M, BIN_M, BINS, median_bin

TILE_PX = 64
"""Side of the tiles."""

_CARRY_ROUNDS = 30
_CARRY_TO_ZERO = 0.3
"""Beyond the floor the slow error is taken to be that of the nearest floor, less by so much over four per tile."""

_SLOW_ROWS = 4
"""The slow error is the same in so many rows."""

_FARTHEST = np.float32(0.01)
_MIN_TILE_PIXELS = 40


def tiles(height: int, width: int) -> tuple[int, int]:
    """Return how many rows and columns of tiles an image has."""
    return -(-height // TILE_PX), -(-width // TILE_PX)


@njit(cache=True, nogil=True)
def measure_slow_error(pixels, intrinsics, plane, sigma, shape):  # type: ignore[no-untyped-def]
    """(rows, cols) float64, 1/m: error of the inverse depth in the middle of each tile, carried on beyond the floor.

    Parameters
    ----------
    pixels : (n, 4) float32 u, v, inverse depth and weight, 1 for floor.
    plane : (3,) normal over distance. sigma : (bands,) noise of the height, per `BAND_M`. shape : of `tiles`.
    """
    return _carried_on(_tile_errors(pixels, intrinsics, plane, sigma, shape))


@njit(cache=True, nogil=True)
def remove_bias(inverse, bias):  # type: ignore[no-untyped-def]
    """Take the slow error of the sensor (`FloorFit.bias`) off the inverse depth (H, W) float32 in place; 0 stays 0."""
    height, width = inverse.shape
    column = np.empty(bias.shape[1], np.float32)
    before, after = np.empty(width, np.int32), np.empty(width, np.int32)
    share, slow = np.empty(width, np.float32), np.empty(width, np.float32)
    for u in range(width):
        before[u], after[u], share[u] = between_tiles(u, bias.shape[1])
    for v in range(height):
        if v % _SLOW_ROWS == 0:
            i, m, p = between_tiles(v, bias.shape[0])
            for j in range(bias.shape[1]):
                column[j] = bias[i, j] + p * (bias[m, j] - bias[i, j])
            for u in range(width):
                slow[u] = column[before[u]] + share[u] * (column[after[u]] - column[before[u]])
        _take_off(inverse[v], slow)


@njit(cache=True, nogil=True)
def between_tiles(pixel, tiles):  # type: ignore[no-untyped-def]
    """Tiles before and after a pixel along one axis, and how far it is from the one to the other (0..1)."""
    place = min(max((pixel + 0.5) / TILE_PX - 0.5, 0.0), tiles - 1.0)
    before = min(int(place), max(tiles - 2, 0))
    return before, min(before + 1, tiles - 1), place - before


@njit(cache=True, nogil=True)
def _tile_errors(pixels, intrinsics, plane, sigma, shape):  # type: ignore[no-untyped-def]
    """(rows, cols) median error of the inverse depth of floor pixels within three sigma; NaN where too few are."""
    fx, fy, cx, cy = intrinsics
    rows, cols = shape
    counts = np.zeros((rows, cols, 2 * BINS), np.int32)
    errors = np.zeros((rows, cols, 2 * BINS))
    total = np.zeros((rows, cols), np.int64)
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    for n in range(len(pixels)):
        u, v, w = pixels[n, 0], pixels[n, 1], pixels[n, 2]
        s = sigma[min(int(1.0 / (w * BAND_M)), len(sigma) - 1)]
        error = w - (plane[0] * ((u - cx) / fx) + plane[1] * ((v - cy) / fy) + plane[2])
        h = d * error / w
        if abs(h) < 3.0 * s and pixels[n, 3] == 1.0:
            i, j = int(v) // TILE_PX, int(u) // TILE_PX
            k = min(max(int(h / BIN_M + BINS), 0), 2 * BINS - 1)
            counts[i, j, k] += 1
            errors[i, j, k] += error
            total[i, j] += 1
    measured = np.full((rows, cols), np.nan)
    for i in range(rows):
        for j in range(cols):
            if total[i, j] >= _MIN_TILE_PIXELS:
                k, _ = median_bin(counts[i, j], total[i, j])
                measured[i, j] = errors[i, j, k] / counts[i, j, k]
    return measured


@njit(cache=True, nogil=True)
def _carried_on(measured):  # type: ignore[no-untyped-def]
    """Fill tiles without a value (NaN) by what surrounds them, drawn to 0 with distance from those that have one."""
    rows, cols = measured.shape
    field = np.where(np.isnan(measured), 0.0, measured)
    for _ in range(_CARRY_ROUNDS):
        for i in range(rows):
            for j in range(cols):
                if np.isnan(measured[i, j]):
                    total, weight = 0.0, _CARRY_TO_ZERO
                    for m, n in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                        if 0 <= m < rows and 0 <= n < cols:
                            total += field[m, n]
                            weight += 1.0
                    field[i, j] = total / weight
    return field


@njit(cache=True, nogil=True)
def _take_off(row, slow):  # type: ignore[no-untyped-def]
    """Take the slow error off a row; by itself, all float32, so that it runs on vectors."""
    for u in range(len(row)):
        right = row[u] - slow[u]
        right = right if right > _FARTHEST else _FARTHEST
        row[u] = right if row[u] > np.float32(0.0) else row[u]
