"""A step in the floor, up or down, before the camera: one plane through both of its levels is neither.

The height of the floor over a plane that was fitted to all of it is looked at by distance. A plane that is tilted or
too high makes a straight line of it, a step a jump. Both are fitted together, with the jump where it explains most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..depth import NOISE_FLOOR_M, NOISE_QUADRATIC, depth_sigma
from .floor_level import height_over
from .height_bins import median_bin

_BAND_M, _BANDS = 0.05, 120
_BIN_M, _BINS = 0.005, 100
"""Bands of distance, and bins of height to either side of the plane."""

_LEAST_PIXELS, _MOST_PIXELS = 20, 200
"""A band with fewer pixels says nothing; more than the second make it no surer: errors of neighbours go together."""

_UNEVEN_M = 0.005
"""Floors and sensors are no more even than this."""

_LEAST_BANDS = 4
"""On either side of a step."""

_FARTHEST_M = 4.0
"""Beyond it the foot of a wall that is labelled floor looks like a step."""

_LEAST_RISE_M, _MOST_RISE_M, _SURE, _MOST_LEFT, _FLAT = 0.04, 0.18, 8.0, 0.25, 0.25
"""A step rises or falls by no less, and by so many of its own standard deviations; by no more, for what is higher may
be a thing with a level top (`floor_level.py`). It leaves no more than this part of the squared errors of a straight
line, and either level is even to this part of it."""

_STEEPEST = 0.105
"""Slope, 6 degrees, of a plane through two levels against either."""

_LEAST_AHEAD = 0.2
"""Part of the optical axis along the floor: a camera that looks down more steeply sees all around, nothing ahead."""

_MARGIN_M = 0.05


@dataclass(frozen=True, slots=True)
class FloorStep:
    """Where the floor steps up or down.

    Attributes
    ----------
    distance_m : along the floor, from below the camera. rise_m : of the floor behind it; below 0 for a drop.
    plane : (3,) float64 n / d of the level before it.
    """

    distance_m: float
    rise_m: float
    plane: NDArray[np.float64]


def find_step(
    pixels: NDArray[np.float32], intrinsics: tuple[float, ...], plane: NDArray[np.float64]
) -> FloorStep | None:
    """Find the step that explains the heights of the floor over a plane; None where there is none.

    Parameters
    ----------
    pixels : (n, 4) float32 u, v, inverse depth and weight of pixels near the plane; the weight of floor is 1.
    intrinsics : fx, fy, cx, cy. plane : (3,) float64 n / d, fitted to all of the floor.
    """
    at, level, slope, rise, least, left, uneven = _best_step(*_profile(pixels, intrinsics, plane))
    if not 0.0 <= at <= _FARTHEST_M or not max(_LEAST_RISE_M, least) <= abs(rise) <= _MOST_RISE_M:
        return None
    if left > _MOST_LEFT or uneven > _FLAT * abs(rise) or abs(slope) > _STEEPEST:
        return None
    distance = 1.0 / float(np.linalg.norm(plane))
    normal = plane * distance
    ahead = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    length = float(np.linalg.norm(ahead))
    if length < _LEAST_AHEAD or level >= distance:
        return None
    return FloorStep(at, rise, (normal + slope * ahead / length) / (distance - level))


def are_before(pixels: NDArray[np.float32], intrinsics: tuple[float, ...], step: FloorStep) -> NDArray[np.bool_]:
    """(n,) bool: which pixels lie before the step, and not at its edge."""
    return np.asarray(_ranges(pixels, intrinsics, step.plane) < step.distance_m - _MARGIN_M)


@njit(cache=True, nogil=True)
def _place(pixel, intrinsics, plane, d):  # type: ignore[no-untyped-def]
    """Distance along the floor from below the camera, height over the floor, and depth of a pixel, m."""
    fx, fy, cx, cy = intrinsics
    rx, ry, z = (pixel[0] - cx) / fx, (pixel[1] - cy) / fy, 1.0 / pixel[2]
    h = height_over(plane, d, rx, ry, z)
    return np.sqrt(max(z * z * (1.0 + rx * rx + ry * ry) - (d - h) ** 2, 0.0)), h, z


@njit(cache=True, nogil=True)
def _ranges(pixels, intrinsics, plane):  # type: ignore[no-untyped-def]
    """(n,) distance of each pixel along the floor."""
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    ranges = np.empty(len(pixels), np.float32)
    for k in range(len(pixels)):
        ranges[k] = _place(pixels[k], intrinsics, plane, d)[0]
    return ranges


@njit(cache=True, nogil=True)
def _profile(pixels, intrinsics, plane):  # type: ignore[no-untyped-def]
    """Median height of the floor per band of distance, and how much it weighs: 0 where too little floor is."""
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    counts, noise = np.zeros((_BANDS, 2 * _BINS), np.int32), np.zeros(_BANDS)
    for k in range(len(pixels)):
        if pixels[k, 3] != 1.0:
            continue
        r, h, z = _place(pixels[k], intrinsics, plane, d)
        band, bin_ = int(r / _BAND_M), int(np.floor(h / _BIN_M)) + _BINS
        if band < _BANDS and 0 <= bin_ < 2 * _BINS:
            counts[band, bin_] += 1
            noise[band] += depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC) * d / z
    heights, weight = np.zeros(_BANDS), np.zeros(_BANDS)
    for band in range(_BANDS):
        total = counts[band].sum()
        if total >= _LEAST_PIXELS:
            k, before = median_bin(counts[band], total)
            heights[band] = (k - _BINS + (0.5 * total - before) / counts[band, k]) * _BIN_M
            weight[band] = min(total, _MOST_PIXELS) / ((noise[band] / total) ** 2 + _UNEVEN_M**2)
    return heights, weight


@njit(cache=True, nogil=True)
def _best_step(heights, weight):  # type: ignore[no-untyped-def]
    """The step that leaves least: its distance (below 0: none), level and slope of the line before it, its rise, the
    least that is sure, what part it leaves of the squared errors of a line alone, and how uneven either level is; m.
    """
    bands = len(heights)
    line = _fit(heights, weight, bands)
    best, best_at = line, -1
    for at in range(_LEAST_BANDS, bands - _LEAST_BANDS):
        enough = (weight[:at] > 0.0).sum() >= _LEAST_BANDS and (weight[at:] > 0.0).sum() >= _LEAST_BANDS
        if enough and weight[at] > 0.0:
            found = _fit(heights, weight, at)
            if found[4] < best[4]:
                best, best_at = found, at
    if best_at < 0:
        return -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0
    level, slope, rise, variance, left = best
    spread = np.sqrt(variance * left / max((weight > 0.0).sum() - 3, 1))
    squares, used = np.zeros(2), np.zeros(2)
    for k in range(bands):
        if weight[k] > 0.0:
            side = int(k >= best_at)
            squares[side] += (heights[k] - level - slope * (k + 0.5) * _BAND_M - rise * side) ** 2
            used[side] += 1.0
    uneven = np.sqrt((squares / used).max())
    return best_at * _BAND_M, level, slope, rise, _SURE * spread, left / max(line[4], 1e-12), uneven


@njit(cache=True, nogil=True)
def _fit(heights, weight, at):  # type: ignore[no-untyped-def]
    """Least squares of level + slope r + rise (behind band `at`): the three, variance of the rise, squared errors."""
    A, b, x = 1e-9 * np.eye(3), np.zeros(3), np.ones(3)
    for k in range(len(heights)):
        x[1], x[2] = (k + 0.5) * _BAND_M, 1.0 if k >= at else 0.0
        for i in range(3):
            b[i] += weight[k] * x[i] * heights[k]
            for j in range(3):
                A[i, j] += weight[k] * x[i] * x[j]
    inverse = np.linalg.inv(A)
    level, slope, rise = inverse @ b
    left = 0.0
    for k in range(len(heights)):
        off = heights[k] - level - slope * (k + 0.5) * _BAND_M - (rise if k >= at else 0.0)
        left += weight[k] * off * off
    return level, slope, rise, inverse[2, 2], left
