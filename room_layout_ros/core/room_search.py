"""Search for the cuboid of least cost, its axes held.

Exhaustive over the walls' candidate offsets on a coarse subset of the cells, then coordinate descent over all faces on
all cells (docs/method.md, section 8). A wall beyond the sensor's range has no offset among what was measured: where
depth is missing, the descent tries it farther away too.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .layout import FACE_AXIS, FACE_SIGN
from .room_cells import INTERLEAVED_PARTS
from .room_cost import MIN_DISTANCE_M, CellCosts, FittedRoom, mean_cost

_SWEEPS = 3
_MAX_DISTANCE_M = 15.0
_BIN_M = 0.025
_KERNEL = np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2)
_KERNEL /= _KERNEL.sum()
_MODES, _CLUTTER_MODES = 5, 2
_EXTENTS = (0.98, 0.995)
"""Shares of the points ahead that the last walls enclose."""
_LEAST_MISSING, _FARTHER = 0.01, np.exp(0.04 * np.arange(1, 33))
"""Where more of the cells than the first have no depth, a wall is tried so many times as far as anything was measured
along its normal: up to 3.6 times."""
_FLOOR_GUESSES_M = (0.9, 1.1, 1.3, 1.5)
"""Camera heights to try where no floor is seen: hand-held and robots."""


def search_room(cells: CellCosts, R: NDArray[np.float64]) -> FittedRoom:
    """Best cuboid over the candidate offsets of its planes, axes held."""
    seen = cells.cells
    R = np.ascontiguousarray(R)
    table, sizes = _candidates(seen.rays, seen.inverse_depth, seen.probability, R)
    reach = _reach(seen.rays, seen.inverse_depth, R)
    distances, cost = _search(cells.terms, len(seen.rays), R, table, sizes, reach, cells.costs)
    return FittedRoom(R, distances, float(cost))


@njit(cache=True, nogil=True)
def _candidates(rays, inverse_depth, probability, R):  # type: ignore[no-untyped-def]
    """Distances worth trying per face, and how many there are: modes along the axis of its kind, extents, guesses, and
    out of view.
    """
    along, of_kind, of_clutter, total = _histograms(rays, inverse_depth, probability, R)
    table, sizes = np.full((5, _MODES + _CLUTTER_MODES + len(_EXTENTS) + 1), np.inf), np.zeros(5, np.int64)
    for face in range(5):
        values, n = np.empty(table.shape[1]), 0
        n = _add_modes(values, n, of_kind[face], _MODES)
        if face >= 2:
            n = _add_modes(values, n, of_clutter[face], _CLUTTER_MODES)
            ahead = along[face][along[face] > MIN_DISTANCE_M]
            if len(ahead) > 12:
                first = int(_EXTENTS[0] * (len(ahead) - 1))
                last = np.sort(np.partition(ahead, first)[first:])  # the others are nearer
                for share in _EXTENTS:
                    position = share * (len(ahead) - 1) - first
                    low = min(int(position), len(last) - 2)
                    values[n] = last[low] + (last[low + 1] - last[low]) * (position - low)
                    n += 1
        elif total[face] < 4.0:  # of 3072 cells: none to speak of
            n = 0
            for guess in _FLOOR_GUESSES_M:
                if face == 1:
                    values[n] = guess
                    n += 1
        sizes[face] = _keep_distinct(values[:n], table[face]) + 1
    return table[:, : sizes.max()].copy(), sizes


@njit(cache=True, nogil=True)
def _histograms(rays, inverse_depth, probability, R):  # type: ignore[no-untyped-def]
    """Of the measured cells: distances along the faces' normals (5, n), histograms of structure of the face's kind and
    of clutter over them (5, bins), and the structure in all (5,).
    """
    along, n = np.empty((5, len(rays))), 0
    bins = int(_MAX_DISTANCE_M / _BIN_M) + 1
    of_kind, of_clutter, total = np.zeros((5, bins)), np.zeros((5, bins)), np.zeros(5)
    for i in range(len(rays)):
        w = inverse_depth[i]
        if not w > 0.0:
            continue
        walls = probability[i, 2] + probability[i, 3] + probability[i, 4]
        for face in range(5):
            axis = FACE_AXIS[face]
            toward = rays[i, 0] * R[axis, 0] + rays[i, 1] * R[axis, 1] + rays[i, 2] * R[axis, 2]
            distance = FACE_SIGN[face] * toward / w
            mine = probability[i, face] if face < 2 else walls
            along[face, n] = distance
            total[face] += mine
            if MIN_DISTANCE_M < distance < _MAX_DISTANCE_M:
                at = int(distance / _BIN_M)
                of_kind[face, at] += mine
                of_clutter[face, at] += probability[i, 5]
        n += 1
    return along[:, :n], of_kind, of_clutter, total


@njit(cache=True, nogil=True)
def _add_modes(values, n, histogram, count):  # type: ignore[no-untyped-def]
    """Append up to `count` strongest local maxima of the smoothed histogram, the strongest first; return the number."""
    if histogram.sum() < 2.0:
        return n
    reach, bins = len(_KERNEL) // 2, len(histogram)
    while histogram[bins - 1] == 0.0:
        bins -= 1
    padded = np.zeros(bins + 2 * reach)
    padded[reach : reach + bins] = histogram[:bins]
    smooth = np.zeros(bins + 2)  # nothing before the first; behind the last it falls
    for i in range(bins):
        for k in range(len(_KERNEL)):
            smooth[i + 1] += _KERNEL[k] * padded[i + k]
    first = n
    for i in range(1, len(smooth) - 1):
        if smooth[i] > 0.1 and smooth[i] >= smooth[i - 1] and smooth[i] > smooth[i + 1]:
            place = n  # by strength, among equals the nearer first; `height` of what is there
            while place > first and smooth[i] > smooth[int(values[place - 1] / _BIN_M) + 1]:
                place -= 1
            if place == first + count:
                continue
            n = min(n + 1, first + count)
            for k in range(n - 1, place, -1):
                values[k] = values[k - 1]
            values[place] = (i - 0.5) * _BIN_M
    return n


@njit(cache=True, nogil=True)
def _keep_distinct(values, kept):  # type: ignore[no-untyped-def]
    """Write the values that differ from all earlier ones by 3 cm and 2 %; return their number."""
    n = 0
    for value in values:
        near = value <= MIN_DISTANCE_M
        for other in kept[:n]:
            near = near or abs(value - other) <= 0.03 + 0.02 * other
        if not near:
            kept[n] = value
            n += 1
    return n


@njit(cache=True, nogil=True)
def _reach(rays, inverse_depth, R):  # type: ignore[no-untyped-def]
    """(5,) how far along each wall's normal anything was measured, m; all 0 where little is missing."""
    reach, missing = np.zeros(5), 0
    for i in range(len(rays)):
        w = inverse_depth[i]
        if not w > 0.0:
            missing += 1
            continue
        for face in range(2, 5):
            axis = FACE_AXIS[face]
            toward = rays[i, 0] * R[axis, 0] + rays[i, 1] * R[axis, 1] + rays[i, 2] * R[axis, 2]
            reach[face] = max(reach[face], FACE_SIGN[face] * toward / w)
    return reach if missing >= _LEAST_MISSING * len(rays) else np.zeros(5)


@njit(cache=True, nogil=True)
def _search(terms, count, R, table, sizes, reach, costs):  # type: ignore[no-untyped-def]
    trial = table[:, 0].copy()
    coarse = count // INTERLEAVED_PARTS
    best = np.inf
    distances = trial.copy()
    for i in range(sizes[2]):
        for j in range(sizes[3]):
            for k in range(sizes[4]):
                trial[2], trial[3], trial[4] = table[2, i], table[3, j], table[4, k]
                cost = mean_cost(terms, R, trial, costs, coarse, best)
                if cost < best:
                    best = cost
                    distances[:] = trial
    best = mean_cost(terms, R, distances, costs, count, np.inf)
    for _ in range(_SWEEPS):
        before = best
        for face in (1, 0, 3, 2, 4):
            trial[:] = distances
            farther = len(_FARTHER) if reach[face] > 0.0 else 0
            for i in range(sizes[face] + farther):
                trial[face] = table[face, i] if i < sizes[face] else reach[face] * _FARTHER[i - sizes[face]]
                cost = mean_cost(terms, R, trial, costs, count, best)
                if cost < best:
                    best = cost
                    distances[face] = trial[face]
        if best > before - 1e-6:
            break
    return distances, best
