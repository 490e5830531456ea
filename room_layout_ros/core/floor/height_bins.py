"""Bins of the height over the floor that its noise and the slow error of the depth share, and the median of bins."""

from __future__ import annotations

from numba import njit

BAND_M = 0.5
"""Width of the bands of depth in which the noise of the height is measured."""

BIN_M = 0.001
BINS = 120
"""Width of a bin in m, bins to either side of the floor."""


@njit(cache=True, nogil=True)
def median_bin(counts, total):  # type: ignore[no-untyped-def]
    """Which bin holds the median of `total` > 0 counted values, and how many lie in those before it."""
    before, k = 0, 0
    while before + counts[k] < 0.5 * total:
        before += counts[k]
        k += 1
    return k, before
