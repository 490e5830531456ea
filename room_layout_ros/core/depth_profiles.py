"""What depth says about the offset of each plane: support and violation profiles (docs/method.md, section 5).

A cell of the depth image *supports* the plane that it lies on with an agreeing normal, and *violates* every plane that
it lies beyond. Both depend on one plane's offset alone, so in the joint energy they are unary terms, given the metric
scale c (the distance of the front wall): the planes of a layout are at a c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .labels import FRONT_FACE
from .layout import FACE_AXIS, FACE_SIGN

NEAREST_M = 0.2
FARTHEST_M = 15.0
N_OFFSETS = 256
_STEP = float(np.log(FARTHEST_M / NEAREST_M) / (N_OFFSETS - 1))
_LOG_OFFSETS = np.log(NEAREST_M) + _STEP * np.arange(N_OFFSETS)
_LOG_NEAREST = float(_LOG_OFFSETS[0])
OFFSETS: NDArray[np.float64] = np.exp(_LOG_OFFSETS)
"""Distances in m at which profiles are sampled."""
_FIRST_STEP_M = 0.004
_FIRST = np.searchsorted(OFFSETS, np.arange(0.0, FARTHEST_M + 1.0, _FIRST_STEP_M)).astype(np.uint16)
"""First offset that is not below 0, 4, 8... mm: where the search for one begins."""
_SPREAD = (0.3, 0.6, 1.0)
_TOLERANCE_M = 0.03
"""Unevenness of real walls, on top of the sensor's noise."""


@dataclass(frozen=True, slots=True)
class DepthProfiles:
    """Support and violation per plane and offset, as shares of the image.

    Attributes
    ----------
    offsets : (n,) float64 distances in m, log-spaced.
    support, violation : (5, n) float64, faces in the order of `labels.FACES`.
    scales : (C,) float64 candidate distances of the front wall in m.
    """

    offsets: NDArray[np.float64]
    support: NDArray[np.float64]
    violation: NDArray[np.float64]
    scales: NDArray[np.float64]

    def at(self, face: int, distances: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return support and violation of a face (0..4) at distances in m; both 0 at +inf (the face is absent)."""
        return interpolate(self.support[face], distances), interpolate(self.violation[face], distances)


def compute_depth_profiles(
    points: NDArray[np.float64],
    agreement: NDArray[np.float64],
    structure: NDArray[np.float64],
    sigma: NDArray[np.float64],
    scale_count: int = 12,
) -> DepthProfiles:
    """Histogram the cells of a depth image along the room's axes.

    Parameters
    ----------
    points : (n, 3) float64
        Mean point of each cell in room axes in m; NaN where nothing was measured. Cells have equal areas.
    agreement : (n, 3) float64
        0..1, how well the cell's normal agrees with each axis.
    structure : (n, 5) float64
        0..1, how likely the cell is part of each face of the room (1 where nothing is known).
    sigma : (n,) float64
        Depth noise in m.
    scale_count : int
        Candidates for the distance of the front wall: the strongest peaks of its support, then an even spread.
    """
    support, violation = _profiles(
        points, agreement, structure, sigma, FACE_AXIS, FACE_SIGN, OFFSETS, _FIRST, _FIRST_STEP_M, _TOLERANCE_M
    )
    scales = _scales(OFFSETS, support[FRONT_FACE] - violation[FRONT_FACE], support[FRONT_FACE], scale_count)
    return DepthProfiles(OFFSETS, support, violation, scales)


@njit(cache=True, nogil=True)
def _scales(offsets, balance, support, count):  # type: ignore[no-untyped-def]
    """Ascending distances of the front wall: the strongest peaks of its support, then 0.3, 0.6 and 1 of the way to the
    offset beyond which hardly anything lies.
    """
    peaks, strength = np.empty(len(support), np.int64), np.empty(len(support))
    n = 0
    for b in range(1, len(support) - 1):
        if support[b] >= support[b - 1] and support[b] > support[b + 1] and support[b] > 1e-3:
            peaks[n], strength[n] = b, -balance[b]
            n += 1
    strongest = np.argsort(strength[:n], kind="mergesort")[: count - 3]
    extent = offsets[-1]
    for b in range(len(support) - 1, -1, -1):
        extent = offsets[b] if support[b] - balance[b] <= 0.003 else extent
    scales = np.empty(len(strongest) + 3)
    scales[:-3] = offsets[peaks[strongest]]
    for k in range(3):
        scales[len(strongest) + k] = offsets[0] + _SPREAD[k] * (extent - offsets[0])
    return np.unique(scales[:count])


def interpolate(profile: NDArray[np.float64], distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read a profile over `OFFSETS` at distances in m, linear in log distance; 0 at +inf."""
    return read_curve(profile, 0.0, curve_positions(distances))


def curve_positions(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where distances in m (any shape) lie on a curve over `OFFSETS`; NaN for +inf. Of use for many curves."""
    return np.asarray(_positions(np.ravel(distances))).reshape(np.shape(distances))


@njit(cache=True, nogil=True)
def _positions(distances):  # type: ignore[no-untyped-def]
    positions = np.empty(len(distances))
    for i in range(len(distances)):
        positions[i] = curve_position(distances[i])
    return positions


@njit(cache=True, nogil=True)
def curve_position(distance):  # type: ignore[no-untyped-def]
    """`curve_positions` of one distance."""
    if not np.isfinite(distance):
        return np.nan
    if distance <= 0.0:
        return 0.0
    return min(max((np.log(distance) - _LOG_NEAREST) / _STEP, 0.0), N_OFFSETS - 1.0)


def read_curve(curve: NDArray[np.float64], absent: float, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read a curve over `OFFSETS` at `curve_positions`; `absent` where a face is absent."""
    return _read_curve(curve, absent, positions.ravel()).reshape(positions.shape)


@njit(cache=True, nogil=True)
def _read_curve(curve, absent, positions):  # type: ignore[no-untyped-def]
    values = np.empty(len(positions))
    for i in range(len(positions)):
        values[i] = read_curve_at(curve, absent, positions[i])
    return values


@njit(cache=True, nogil=True, inline="always")
def read_curve_at(curve, absent, position):  # type: ignore[no-untyped-def]
    """`read_curve` at one position."""
    if not position == position:
        return absent
    low = min(int(position), len(curve) - 2)
    part = position - low
    return (1.0 - part) * curve[low] + part * curve[low + 1]


@njit(cache=True, nogil=True, inline="always")
def _first_from(distance, offsets, first, per_step):  # type: ignore[no-untyped-def]
    """First of the offsets that is not below a distance; one step is tried without a branch."""
    b = np.uint64(first[min(int(max(distance, 0.0) * per_step), len(first) - 1)])
    b += np.uint64(offsets[b] < distance)
    while offsets[b] < distance:  # ends at the last, +inf
        b += np.uint64(1)
    return b


@njit(cache=True, nogil=True, error_model="numpy")
def _profiles(points, agreement, structure, sigma, face_axis, face_sign, offsets, first, step, tolerance):  # type: ignore[no-untyped-def]
    """Support is a triangle over the offsets, violation 1 before the cell and falling off as a parabola across it.

    So both are polynomials between three offsets each. The changes of their coefficients there are added up (v0, v1,
    v2 of violation, s0, s1 of support; a cache line per offset), and only their running sums are evaluated.
    """
    n, endless = len(offsets), np.append(offsets, np.inf)
    change = np.zeros((5, n + 1, 8))
    share, per_step = 1.0 / len(points), 1.0 / step - 1e-6  # a place too early is made good
    for c in range(len(points)):
        if not points[c, 2] == points[c, 2]:
            continue
        width = 2.0 * np.sqrt(sigma[c] ** 2 + tolerance**2)
        per_width = 1.0 / width
        curve = share * per_width * per_width
        for k in range(5):
            axis = face_axis[k]
            offset = face_sign[k] * points[c, axis]
            if offset + width <= offsets[0]:
                continue
            weight = share * agreement[c, axis] * structure[c, k]
            slope = weight * per_width
            v0, v1 = curve * offset * offset, -2.0 * curve * offset
            before, rising = change[k, 0], change[k, _first_from(offset - width, endless, first, per_step)]
            before[0] += share
            rising[0] += v0 - share
            rising[1] += v1
            rising[2] += curve
            rising[3] += weight - slope * offset
            rising[4] += slope
            falling = change[k, _first_from(offset, endless, first, per_step)]
            falling[0] -= v0
            falling[1] -= v1
            falling[2] -= curve
            falling[3] += 2.0 * slope * offset
            falling[4] -= 2.0 * slope
            behind = change[k, _first_from(offset + width, endless, first, per_step)]
            behind[3] -= weight + slope * offset
            behind[4] += slope
    return _evaluate(change, offsets)


@njit(cache=True, nogil=True)
def _evaluate(change, offsets):  # type: ignore[no-untyped-def]
    """Support and violation (5, n) of the running sums of the changes."""
    support, violation = np.empty((5, len(offsets))), np.empty((5, len(offsets)))
    for k in range(5):
        v0 = v1 = v2 = s0 = s1 = 0.0
        for b in range(len(offsets)):
            v0 += change[k, b, 0]
            v1 += change[k, b, 1]
            v2 += change[k, b, 2]
            s0 += change[k, b, 3]
            s1 += change[k, b, 4]
            support[k, b] = s0 + offsets[b] * s1
            violation[k, b] = v0 + offsets[b] * (v1 + offsets[b] * v2)
    return support, violation
