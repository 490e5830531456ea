"""Search for the cuboid of least cost, its axes held.

Exhaustive over the walls' candidate offsets on a coarse subset of the cells, then coordinate descent over all faces on
all cells (docs/method.md, section 8).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .layout import FACE_AXIS, FACE_SIGN
from .room_cells import INTERLEAVED_PARTS, RoomCells
from .room_cost import COSTS, MIN_DISTANCE_M, FittedRoom, mean_cost

_SWEEPS = 3
_MAX_DISTANCE_M = 15.0
_BIN_M = 0.025
_FLOOR_GUESSES_M = (0.9, 1.1, 1.3, 1.5)
"""Camera heights to try where no floor is seen: hand-held and robots."""


def search_room(cells: RoomCells, R: NDArray[np.float64]) -> FittedRoom:
    """Best cuboid over the candidate offsets of its planes, axes held."""
    candidates = _candidates(cells, R)
    sizes = np.array([len(c) for c in candidates])
    table = np.full((5, sizes.max()), np.inf)
    for face, values in enumerate(candidates):
        table[face, : len(values)] = values
    distances, cost = _search(cells.rays, cells.inverse_depth, cells.probability, cells.behind, R, table, sizes, COSTS)
    return FittedRoom(R, distances, float(cost))


def _candidates(cells: RoomCells, R: NDArray[np.float64]) -> list[list[float]]:
    """Distances worth trying per face: modes along the axis of its kind, extents, guesses, and out of view."""
    seen = cells.inverse_depth > 0
    points = (cells.rays[seen] / cells.inverse_depth[seen, None]) @ R.T
    probability = cells.probability[seen]
    result = []
    for face in range(5):
        along = FACE_SIGN[face] * points[:, FACE_AXIS[face]]
        mine = probability[:, face] if face < 2 else probability[:, 2:5].sum(axis=1)
        values = _modes(along, mine, 5)
        if face >= 2:
            values += _modes(along, probability[:, 5], 2)
            if (along > MIN_DISTANCE_M).sum() > 12:
                values += [float(v) for v in np.quantile(along[along > MIN_DISTANCE_M], (0.98, 0.995))]
        elif mine.sum() < 4.0:  # of 3072 cells: none to speak of
            values = list(_FLOOR_GUESSES_M) if face == 1 else []
        result.append(_distinct(values))
    return result


def _distinct(values: list[float]) -> list[float]:
    """Values that differ from all earlier ones by 3 cm and 2 %, then out of view."""
    kept: list[float] = []
    for value in values:
        if value > MIN_DISTANCE_M and all(abs(value - other) > 0.03 + 0.02 * other for other in kept):
            kept.append(value)
    return [*kept, np.inf]


def _modes(along: NDArray[np.float64], weight: NDArray[np.float64], count: int) -> list[float]:
    """Up to `count` strongest local maxima of the smoothed, weighted histogram."""
    keep = (along > MIN_DISTANCE_M) & (along < _MAX_DISTANCE_M)
    if weight[keep].sum() < 2.0:
        return []
    histogram = np.bincount((along[keep] / _BIN_M).astype(int), weight[keep], minlength=14)
    kernel = np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2)
    smooth = np.convolve(histogram, kernel / kernel.sum(), mode="same")
    padded = np.concatenate([[0.0], smooth, [0.0]])
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]) & (smooth > 0.1))
    strongest = peaks[np.argsort(-smooth[peaks], kind="stable")][:count]
    return [float((i + 0.5) * _BIN_M) for i in strongest]


@njit(cache=True, nogil=True)
def _search(rays, inverse_depth, probability, behind, R, table, sizes, costs):  # type: ignore[no-untyped-def]
    trial = table[:, 0].copy()
    coarse = len(rays) // INTERLEAVED_PARTS
    best = np.inf
    distances = trial.copy()
    for i in range(sizes[2]):
        for j in range(sizes[3]):
            for k in range(sizes[4]):
                trial[2], trial[3], trial[4] = table[2, i], table[3, j], table[4, k]
                cost = mean_cost(rays, inverse_depth, probability, behind, R, trial, costs, coarse, best)
                if cost < best:
                    best = cost
                    distances[:] = trial
    best = mean_cost(rays, inverse_depth, probability, behind, R, distances, costs, len(rays), np.inf)
    for _ in range(_SWEEPS):
        before = best
        for face in (1, 0, 3, 2, 4):
            trial[:] = distances
            for i in range(sizes[face]):
                trial[face] = table[face, i]
                cost = mean_cost(rays, inverse_depth, probability, behind, R, trial, costs, len(rays), best)
                if cost < best:
                    best = cost
                    distances[face] = trial[face]
        if best > before - 1e-6:
            break
    return distances, best
