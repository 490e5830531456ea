"""How much the height of floor pixels scatters, by depth: measured on the floor itself, not told by a sensor model."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..depth import MAD_TO_SIGMA, NOISE_FLOOR_M, NOISE_QUADRATIC, depth_sigma
from .floor_level import height_over
from .height_bins import BAND_M, BIN_M, BINS, median_bin
from .slow_error import between_tiles

PER_METRE, STEPS = 50.0, 700
"""Entries of the table of the noise per metre of depth, and all of them: up to 14 m."""

MIN_BAND_PIXELS = 40
"""Of floor: fewer say nothing."""

_BANDS = 24
_LEAST_SIDE = 0.1
"""Share of a band's pixels on either side of the floor, below which there is no floor in it."""
_MIN_SIGMA_M = 0.002

_FAR, _FAR_TO_SIGMA = 1.6, 0.9 / 1.2816
"""Twice the share of a side that is looked at besides its half, and most of the deviation over its distance: where the
sensor's steps of depth are larger than its noise, half of a side may lie on the floor to the millimetre."""


def usual_sigma(distance_m: float) -> NDArray[np.float64]:
    """(bands,) noise of the height where it cannot be measured, with the camera so high over the floor."""
    z = (np.arange(_BANDS) + 0.5) * BAND_M
    sigma = np.asarray(depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC)) * distance_m / z
    return np.maximum(sigma, _MIN_SIGMA_M)


@njit(cache=True, nogil=True)
def count_heights(pixels, intrinsics, plane, bias):  # type: ignore[no-untyped-def]
    """Count |height| of pixels in mm bins: (2, bands, bins), below the floor and above it, by distance."""
    fx, fy, cx, cy = intrinsics
    counts = np.zeros((2, _BANDS, BINS), np.int64)
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    for k in range(len(pixels)):
        u, v = pixels[k, 0], pixels[k, 1]
        i, m, p = between_tiles(v, bias.shape[0])
        j, n, q = between_tiles(u, bias.shape[1])
        top = bias[i, j] + q * (bias[i, n] - bias[i, j])
        slow = top + p * (bias[m, j] + q * (bias[m, n] - bias[m, j]) - top)
        z = 1.0 / (pixels[k, 2] - slow)
        h = height_over(plane, d, (u - cx) / fx, (v - cy) / fy, z)
        bin_, band = int(abs(h) / BIN_M), int(z / BAND_M)
        if bin_ < BINS and 0 <= band < _BANDS:
            counts[0 if h <= 0.0 else 1, band, bin_] += 1
    return counts


@njit(cache=True, nogil=True)
def sigma_bands(counts, height):  # type: ignore[no-untyped-def]
    """Standard deviation per band from the median |height|; bands without floor follow the model of the noise.

    Noise lies on both sides of the floor, things above it and drops below: the quieter side counts, and a band of
    which one side is nearly empty shows no floor.
    """
    sigma, ratio = np.full(_BANDS, np.nan), np.full(_BANDS, np.nan)
    for band in range(_BANDS):
        z = (band + 0.5) * BAND_M
        model = depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC) * height / z
        below, above = counts[0, band].sum(), counts[1, band].sum()
        if min(below, above) >= max(MIN_BAND_PIXELS, _LEAST_SIDE * (below + above)):
            sigma[band] = min(_scatter(counts[0, band]), _scatter(counts[1, band]))
            ratio[band] = sigma[band] / model
    usual = np.nanmedian(ratio) if np.isfinite(ratio).any() else 1.0
    for band in range(_BANDS):
        if np.isnan(sigma[band]):
            z = (band + 0.5) * BAND_M
            sigma[band] = usual * depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC) * height / z
        sigma[band] = max(sigma[band], _MIN_SIGMA_M)
    return sigma


@njit(cache=True, nogil=True)
def _scatter(counts):  # type: ignore[no-untyped-def]
    """Standard deviation of normal noise that gives a side of the floor these counts; more, if a fifth lies far out."""
    total = counts.sum()
    middle, far = median_bin(counts, total)[0], median_bin(counts, _FAR * total)[0]
    return max(MAD_TO_SIGMA * (middle + 0.5), _FAR_TO_SIGMA * (far + 0.5)) * BIN_M


@njit(cache=True, nogil=True)
def band_sigma(sigma, z):  # type: ignore[no-untyped-def]
    """Noise of the height at depth z, linear between the middles of the bands."""
    position = min(max(z / BAND_M - 0.5, 0.0), len(sigma) - 1.001)
    low = int(position)
    return sigma[low] + (position - low) * (sigma[low + 1] - sigma[low])


@njit(cache=True, nogil=True)
def noise_table(sigma):  # type: ignore[no-untyped-def]
    """Noise of the height per step of depth."""
    noise = np.empty(STEPS)
    for k in range(STEPS):
        noise[k] = band_sigma(sigma, (k + 0.5) / PER_METRE)
    return noise
