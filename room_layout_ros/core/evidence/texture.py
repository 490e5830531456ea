"""Texture of superpixels in colour images: directions of gradients, local binary patterns, energy by scale."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

STRIDE = 2
N_DIRECTIONS = 8
N_PATTERNS = 10
_SCALES = (1.0, 2.0, 4.0, 8.0)
_PATTERN_STEP = 3
"""Grey levels by which a neighbour must be brighter: less is noise."""

TEXTURE_COLUMNS = (
    *(f"direction_{k}" for k in range(N_DIRECTIONS)),
    "edges",
    *(f"pattern_{k}" for k in range(N_PATTERNS)),
    *(f"band_{k}" for k in range(len(_SCALES) - 1)),
)


def compute_texture(
    index: NDArray[np.int32], count: int, color: NDArray[np.uint8] | None
) -> dict[str, NDArray[np.floating]]:
    """Describe the texture of each superpixel at half resolution.

    Parameters
    ----------
    index : (H, W) int32, 0..count-1. color : (H, W, 3) uint8 or None.

    Returns
    -------
    dict of (count,) float64
        Shares of the gradient by direction (undirected, eighths of half a turn from 0 along x), share of strong
        gradients, histogram of rotation-invariant uniform local binary patterns [O02], mean absolute value in bands of
        a difference-of-Gaussians pyramid. NaN without colour.
    """
    if color is None:
        return {name: np.full(count, np.nan) for name in TEXTURE_COLUMNS}
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    half = cv2.resize(grey, None, fx=1.0 / STRIDE, fy=1.0 / STRIDE, interpolation=cv2.INTER_AREA)
    smooth = [cv2.GaussianBlur(half, (0, 0), sigma).astype(np.int16) for sigma in _SCALES]
    bands = np.stack([np.abs(a - b) for a, b in pairwise(smooth)])
    sums = _sum_texture(index, count, np.asarray(half, np.uint8), bands, _pattern_table())
    pixels = np.maximum(sums[:, -1], 1.0)
    last = N_DIRECTIONS + 1
    sums[:, :N_DIRECTIONS] /= np.maximum(sums[:, :N_DIRECTIONS].sum(axis=1, keepdims=True), 1e-6)
    sums[:, last - 1 :] /= pixels[:, None]
    return {name: sums[:, k] for k, name in enumerate(TEXTURE_COLUMNS)}


def _pattern_table() -> NDArray[np.uint8]:
    """(256,) class of each pattern: number of bright neighbours if they are in one run, 9 otherwise."""
    bits = (np.arange(256)[:, None] >> np.arange(8)) & 1
    changes = (bits != np.roll(bits, 1, axis=1)).sum(axis=1)
    return np.where(changes <= 2, bits.sum(axis=1), N_PATTERNS - 1).astype(np.uint8)


@njit(cache=True, nogil=True)
def _sum_texture(index, count, grey, bands, table):  # type: ignore[no-untyped-def]
    n_columns = N_DIRECTIONS + 1 + N_PATTERNS + bands.shape[0] + 1
    sums = np.zeros((count, n_columns))
    rows, cols = grey.shape
    for row in range(1, rows - 1):
        for col in range(1, cols - 1):
            s = sums[index[row * STRIDE, col * STRIDE]]
            here = int(grey[row, col]) + _PATTERN_STEP
            gx = float(grey[row, col + 1]) - float(grey[row, col - 1])
            gy = float(grey[row + 1, col]) - float(grey[row - 1, col])
            strength = np.sqrt(gx * gx + gy * gy)
            if strength > 6.0:
                angle = np.arctan2(gy, gx)
                if angle < 0.0:
                    angle += np.pi
                s[int(angle * (N_DIRECTIONS / np.pi) + 0.5) % N_DIRECTIONS] += strength
            if strength > 24.0:
                s[N_DIRECTIONS] += 1.0
            code = int(grey[row - 1, col - 1] > here)
            code |= int(grey[row - 1, col] > here) << 1
            code |= int(grey[row - 1, col + 1] > here) << 2
            code |= int(grey[row, col + 1] > here) << 3
            code |= int(grey[row + 1, col + 1] > here) << 4
            code |= int(grey[row + 1, col] > here) << 5
            code |= int(grey[row + 1, col - 1] > here) << 6
            code |= int(grey[row, col - 1] > here) << 7
            s[N_DIRECTIONS + 1 + table[code]] += 1.0
            for k in range(bands.shape[0]):
                s[N_DIRECTIONS + 1 + N_PATTERNS + k] += bands[k, row, col]
            s[n_columns - 1] += 1.0
    return sums
