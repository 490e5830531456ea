"""The cuboid that explains what each part of the image is and how far: search and continuous refinement.

Cells of the image carry a depth and the probability to be ceiling, floor, wall or clutter. A cuboid costs what these
say against it: structure on a face of another kind, structure off its plane, clutter behind a wall, clutter far in
front of one (weakly: things stand at walls). The search is exhaustive over the walls' candidate offsets on a coarse
subset of the cells, then coordinate descent on all; the refinement turns the axes and moves the planes by a pattern
search. Both are beyond the paper (docs/method.md, section 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import CELL_PX, NOISE_FLOOR_M, NOISE_QUADRATIC, DepthGeometry, depth_sigma
from .layout import FACE_AXIS, FACE_SIGN

_COSTS = np.array([1.5, 0.8, 0.12, 0.004, 0.10, 0.025, 0.7, 0.0])
"""Wrong kind of face (also: no face), clutter beyond, clutter apart per metre (to 1 m), each face in use, tolerance
in m and per metre, factor for wall beyond (windows, doors and mirrors show what is behind), wall of another name (depth
decides better). Unit: a wall cell that is off its plane."""

_COARSE = 7
_REFINED_PARTS = 3
"""The pattern search looks at so many of the `_COARSE` interleaved parts of the cells; least squares at all."""
_SWEEPS = 3
_FIRST_TURN_RAD = np.deg2rad(1.0)
_FIRST_SHIFT_M = 0.06
_HALVINGS = 4
_ROUNDS = 4
_POLISH_ROUNDS = 6
_POLISH_SIGMAS = 4.0
_MIN_DISTANCE_M = 0.05
_MAX_DISTANCE_M = 15.0
_BIN_M = 0.025
_FLOOR_GUESSES_M = (0.9, 1.1, 1.3, 1.5)
"""Camera heights to try where no floor is seen: hand-held and robots."""


@dataclass(frozen=True, slots=True)
class RoomCells:
    """Cells of an image, flat, in an interleaved order: any first part of them is spread over the whole image.

    Attributes
    ----------
    rays : (n, 3) float64, K^-1 (x, y, 1) of their centres. inverse_depth : (n,) float64, 1/m, 0 not measured.
    probability : (n, 6) float64 of the labels; rows may sum to less than 1 (nothing known).
    """

    rays: NDArray[np.float64]
    inverse_depth: NDArray[np.float64]
    probability: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FittedRoom:
    """A cuboid and its mean cost per cell (0 perfect, above 0.5 no room)."""

    R_room_camera: NDArray[np.float64]
    distances: NDArray[np.float64]
    cost: float


def room_cells(geometry: DepthGeometry, probability: NDArray[np.float64], superpixels: NDArray[np.int32]) -> RoomCells:
    """Cells of the depth image with the probabilities of the superpixels under them.

    Parameters
    ----------
    probability : (K, 6) of the six labels. superpixels : (H, W) int32 index.
    """
    camera, moments = geometry.camera, geometry.moments
    rows, cols, _ = moments.shape
    count = moments[..., 0]
    w = np.where(count >= 0.3 * CELL_PX**2, moments[..., 3] / np.maximum(count, 1.0), 0.0)
    x = np.arange(cols) * CELL_PX + (CELL_PX - 1) / 2
    y = np.arange(rows) * CELL_PX + (CELL_PX - 1) / 2
    right, down = ((x - camera.cx) / camera.fx)[None, :], ((y - camera.cy) / camera.fy)[:, None]
    rays = np.stack(np.broadcast_arrays(right, down, 1.0), -1)
    order = _interleaved(rows * cols)
    probabilities = _cell_means(superpixels, probability, rows, cols, CELL_PX)
    return RoomCells(rays.reshape(-1, 3)[order], w.ravel()[order], probabilities[order])


@cache
def _interleaved(count: int) -> NDArray[np.intp]:
    return np.concatenate([np.arange(start, count, _COARSE) for start in (3, 0, 5, 1, 6, 2, 4)])


def fit_room(cells: RoomCells, hypotheses: tuple[NDArray[np.float64], ...]) -> FittedRoom:
    """Search under each axes hypothesis, refine the best two, return the better."""
    found = sorted((search_room(cells, R) for R in hypotheses), key=lambda room: room.cost)
    return min((refine_room(cells, room) for room in found[:2]), key=lambda room: room.cost)


def search_room(cells: RoomCells, R: NDArray[np.float64]) -> FittedRoom:
    """Best cuboid over the candidate offsets of its planes, axes held."""
    candidates = _candidates(cells, R)
    sizes = np.array([len(c) for c in candidates])
    table = np.full((5, sizes.max()), np.inf)
    for face, values in enumerate(candidates):
        table[face, : len(values)] = values
    distances, cost = _search(cells.rays, cells.inverse_depth, cells.probability, R, table, sizes, _COSTS)
    return FittedRoom(R, distances, float(cost))


def refine_room(cells: RoomCells, room: FittedRoom) -> FittedRoom:
    """Pattern search over rotations and finite distances, halving the steps, then least squares on the inliers."""
    R, distances, _ = _refine(
        cells.rays, cells.inverse_depth, cells.probability, room.R_room_camera, room.distances, _COSTS
    )
    R, distances = _polish(cells.rays, cells.inverse_depth, cells.probability, R, distances)
    u, _, vt = np.linalg.svd(R)
    R = np.asarray(u @ vt)
    cost = mean_cost(cells.rays, cells.inverse_depth, cells.probability, R, distances, _COSTS, len(cells.rays), np.inf)
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
            if (along > _MIN_DISTANCE_M).sum() > 12:
                values += [float(v) for v in np.quantile(along[along > _MIN_DISTANCE_M], (0.98, 0.995))]
        elif mine.sum() < 4.0:  # of 3072 cells: none to speak of
            values = list(_FLOOR_GUESSES_M) if face == 1 else []
        result.append(_distinct(values))
    return result


def _distinct(values: list[float]) -> list[float]:
    """Values that differ from all earlier ones by 3 cm and 2 %, then out of view."""
    kept: list[float] = []
    for value in values:
        if value > _MIN_DISTANCE_M and all(abs(value - other) > 0.03 + 0.02 * other for other in kept):
            kept.append(value)
    return [*kept, np.inf]


def _modes(along: NDArray[np.float64], weight: NDArray[np.float64], count: int) -> list[float]:
    """Up to `count` strongest local maxima of the smoothed, weighted histogram."""
    keep = (along > _MIN_DISTANCE_M) & (along < _MAX_DISTANCE_M)
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
def _cell_means(index, values, rows, cols, size):  # type: ignore[no-untyped-def]
    """Mean over each cell's pixels (every second one) of the values of the superpixels they are in."""
    means = np.zeros((rows * cols, values.shape[1]))
    share = 1.0 / ((size + 1) // 2) ** 2
    for row in range(rows):
        for col in range(cols):
            cell = means[row * cols + col]
            for y in range(row * size, (row + 1) * size, 2):
                for x in range(col * size, (col + 1) * size, 2):
                    value = values[index[y, x]]
                    for k in range(values.shape[1]):
                        cell[k] += share * value[k]
    return means


@njit(cache=True, nogil=True)
def _plane_rows(R, distances):  # type: ignore[no-untyped-def]
    """n_k / d_k of the five faces."""
    m = np.empty((5, 3))
    for j in range(3):
        m[0, j] = -R[1, j] / distances[0]
        m[1, j] = R[1, j] / distances[1]
        m[2, j] = -R[0, j] / distances[2]
        m[3, j] = R[2, j] / distances[3]
        m[4, j] = R[0, j] / distances[4]
    return m


@njit(cache=True, nogil=True)
def mean_cost(rays, inverse_depth, probability, R, distances, costs, count, limit):  # type: ignore[no-untyped-def]
    """Mean cost of a cuboid over the first `count` cells, see `_COSTS`; inf as soon as it must be above `limit`."""
    m = _plane_rows(R, distances)
    total = 0.0
    stop = limit * count
    for i in range(count):
        best, face = 1e-3, -1  # a face more than a kilometre away is no face
        for k in range(5):
            value = m[k, 0] * rays[i, 0] + m[k, 1] * rays[i, 1] + m[k, 2] * rays[i, 2]
            if value > best:
                best, face = value, k
        walls = probability[i, 2] + probability[i, 3] + probability[i, 4]
        structure = probability[i, 0] + probability[i, 1] + walls
        clutter = probability[i, 5]
        if face < 0:
            total += costs[0] * structure + costs[1] * clutter
            continue
        mine = probability[i, face] if face < 2 else walls
        total += costs[0] * (structure - mine)
        if face >= 2:
            total += costs[7] * (walls - probability[i, face])
        w = inverse_depth[i]
        if w > 0.0:
            offset = distances[face] * (best / w - 1.0)  # of the point beyond the plane
            off = min(abs(offset) / (costs[4] + costs[5] / w), 1.0) ** 2
            if offset > 0.0:
                total += off * (mine * (costs[6] if face >= 2 else 1.0) + clutter * costs[1])
            else:
                total += off * mine + clutter * costs[2] * min(-offset, 1.0)
        if i % 64 == 63 and total > stop:
            return np.inf
    faces = 0
    for k in range(5):
        if distances[k] < np.inf:
            faces += 1
    return total / max(count, 1) + costs[3] * faces


@njit(cache=True, nogil=True)
def _search(rays, inverse_depth, probability, R, table, sizes, costs):  # type: ignore[no-untyped-def]
    trial = table[:, 0].copy()
    coarse = len(rays) // _COARSE
    best = np.inf
    distances = trial.copy()
    for i in range(sizes[2]):
        for j in range(sizes[3]):
            for k in range(sizes[4]):
                trial[2], trial[3], trial[4] = table[2, i], table[3, j], table[4, k]
                cost = mean_cost(rays, inverse_depth, probability, R, trial, costs, coarse, best)
                if cost < best:
                    best = cost
                    distances[:] = trial
    best = mean_cost(rays, inverse_depth, probability, R, distances, costs, len(rays), np.inf)
    for _ in range(_SWEEPS):
        before = best
        for face in (1, 0, 3, 2, 4):
            trial[:] = distances
            for i in range(sizes[face]):
                trial[face] = table[face, i]
                cost = mean_cost(rays, inverse_depth, probability, R, trial, costs, len(rays), best)
                if cost < best:
                    best = cost
                    distances[face] = trial[face]
        if best > before - 1e-6:
            break
    return distances, best


@njit(cache=True, nogil=True)
def _refine(rays, inverse_depth, probability, R, distances, costs):  # type: ignore[no-untyped-def]
    distances = distances.copy()
    count = len(rays) * _REFINED_PARTS // _COARSE
    best = mean_cost(rays, inverse_depth, probability, R, distances, costs, count, np.inf)
    turn, shift = _FIRST_TURN_RAD, _FIRST_SHIFT_M
    for _ in range(_HALVINGS):
        for _ in range(_ROUNDS):
            improved = False
            for k in range(8):
                if k >= 3 and distances[k - 3] == np.inf:
                    continue
                for sign in (-1.0, 1.0):
                    trial_R, trial = R, distances
                    if k < 3:
                        trial_R = R @ _turn_about(k, sign * turn)
                    else:
                        trial = distances.copy()
                        trial[k - 3] = max(trial[k - 3] + sign * shift, _MIN_DISTANCE_M)
                    cost = mean_cost(rays, inverse_depth, probability, trial_R, trial, costs, count, best)
                    if cost < best - 1e-7:
                        best, improved = cost, True
                        R, distances = trial_R, trial
            if not improved:
                break
        turn /= 2.0
        shift /= 2.0
    return R, distances, best


@njit(cache=True, nogil=True)
def _polish(rays, inverse_depth, probability, R, distances):  # type: ignore[no-untyped-def]
    """Least squares of rotation and offsets on the cells of structure that lie on their planes (Gauss-Newton).

    Residual of a cell on face k: n_k . P - d_k, weighted by its probability and precision. A weak prior holds the
    rotation, and the offset of a face that hardly any cell lies on, where they are.
    """
    distances = distances.copy()
    scale = 1.0  # of the residuals, in units of the depth noise; a clean sensor earns a sharper fit
    for _ in range(_POLISH_ROUNDS):
        spread = 0.0
        total = 0.0
        A = np.zeros((8, 8))
        g = np.zeros(8)
        m = _plane_rows(R, distances)
        row = np.zeros(8)
        for i in range(len(rays)):
            w = inverse_depth[i]
            if w <= 0.0:
                continue
            best, face = 1e-3, -1
            for k in range(5):
                value = m[k, 0] * rays[i, 0] + m[k, 1] * rays[i, 1] + m[k, 2] * rays[i, 2]
                if value > best:
                    best, face = value, k
            if face < 0:
                continue
            mine = probability[i, face] if face < 2 else probability[i, 2] + probability[i, 3] + probability[i, 4]
            if mine < 0.5:
                continue
            sigma = depth_sigma(1.0 / w, NOISE_FLOOR_M, NOISE_QUADRATIC)
            residual = distances[face] * (best / w - 1.0)
            relative = abs(residual) / (sigma * scale)
            if relative > _POLISH_SIGMAS:
                continue
            weight = mine / (sigma * sigma * (1.0 + relative * relative))
            spread += weight * abs(residual) / sigma
            total += weight
            nx, ny, nz = m[face] * distances[face]
            px, py, pz = rays[i, 0] / w, rays[i, 1] / w, 1.0 / w
            row[:] = 0.0
            row[0], row[1], row[2] = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px  # (n x P) . turn
            row[3 + face] = -1.0
            for a in range(8):
                g[a] -= weight * row[a] * residual
                for b in range(8):
                    A[a, b] += weight * row[a] * row[b]
        for a in range(8):
            A[a, a] += 1e3 if a >= 3 else 1e4
        if total > 0.0:
            scale = min(max(3.0 * spread / total, 0.05), scale)
        step = np.linalg.solve(A, g)
        turn = _turn_about(0, step[0]) @ _turn_about(1, step[1]) @ _turn_about(2, step[2])
        R = R @ turn.T
        for k in range(5):
            if distances[k] < np.inf:
                distances[k] = max(distances[k] + step[3 + k], _MIN_DISTANCE_M)
    return R, distances


@njit(cache=True, nogil=True)
def _turn_about(axis, angle):  # type: ignore[no-untyped-def]
    """Rotation about one of the camera's axes."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn
