"""Continuous refinement of a cuboid: pattern search over rotation and offsets, then least squares on the inliers.

The pattern search follows the cost itself, kinks and all; the least squares (Gauss-Newton on the points of structure
that lie on their planes) carries the precision. Beyond the paper (docs/method.md, section 8).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import NOISE_FLOOR_M, NOISE_QUADRATIC, depth_sigma
from .room_cells import INTERLEAVED_PARTS, RoomCells
from .room_cost import COSTS, MIN_DISTANCE_M, FittedRoom, face_of_ray, mean_cost, plane_rows, rate_room

_REFINED_PARTS = 3
"""The pattern search looks at so many of the interleaved parts of the cells; least squares at all."""
_FIRST_TURN_RAD = np.deg2rad(1.0)
_FIRST_SHIFT_M = 0.06
_HALVINGS = 4
_ROUNDS = 4
_POLISH_ROUNDS = 6
_POLISH_SIGMAS = 4.0


def refine_room(
    cells: RoomCells, room: FittedRoom, costs: NDArray[np.float64] = COSTS, turn: bool = True
) -> FittedRoom:
    """Pattern search over rotations and finite distances, halving the steps, then least squares on the inliers.

    `turn` False holds the rotation in the pattern search: without depth, lines know the axes better than regions do.
    """
    seen = cells.rays, cells.inverse_depth, cells.probability
    R, distances, _ = _refine(*seen, cells.behind, room.R_room_camera, room.distances, costs, turn)
    R, distances = _polish(*seen, R, distances)
    u, _, vt = np.linalg.svd(R)
    return rate_room(cells, FittedRoom(np.asarray(u @ vt), distances, np.inf), costs)


@njit(cache=True, nogil=True)
def _refine(rays, inverse_depth, probability, behind, R, distances, costs, turning):  # type: ignore[no-untyped-def]
    distances = distances.copy()
    count = len(rays) * _REFINED_PARTS // INTERLEAVED_PARTS
    best = mean_cost(rays, inverse_depth, probability, behind, R, distances, costs, count, np.inf)
    turn, shift = _FIRST_TURN_RAD, _FIRST_SHIFT_M
    for _ in range(_HALVINGS):
        for _ in range(_ROUNDS):
            improved = False
            for k in range(0 if turning else 3, 8):
                if k >= 3 and distances[k - 3] == np.inf:
                    continue
                for sign in (-1.0, 1.0):
                    trial_R, trial = R, distances
                    if k < 3:
                        trial_R = R @ _turn_about(k, sign * turn)
                    else:
                        trial = distances.copy()
                        trial[k - 3] = max(trial[k - 3] + sign * shift, MIN_DISTANCE_M)
                    cost = mean_cost(rays, inverse_depth, probability, behind, trial_R, trial, costs, count, best)
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

    A weak prior holds the rotation, and the offset of a face that hardly any cell lies on, where they are.
    """
    distances = distances.copy()
    scale = 1.0  # of the residuals, in units of the depth noise; a clean sensor earns a sharper fit
    for _ in range(_POLISH_ROUNDS):
        A, g, spread, total = _normal_equations(rays, inverse_depth, probability, R, distances, scale)
        for a in range(8):
            A[a, a] += 1e3 if a >= 3 else 1e4
        if total > 0.0:
            scale = min(max(3.0 * spread / total, 0.05), scale)
        step = np.linalg.solve(A, g)
        turn = _turn_about(0, step[0]) @ _turn_about(1, step[1]) @ _turn_about(2, step[2])
        R = R @ turn.T
        for k in range(5):
            if distances[k] < np.inf:
                distances[k] = max(distances[k] + step[3 + k], MIN_DISTANCE_M)
    return R, distances


@njit(cache=True, nogil=True)
def _normal_equations(rays, inverse_depth, probability, R, distances, scale):  # type: ignore[no-untyped-def]
    """(A, g) over (turn (3,), offsets (5,)), and sums of weighted residuals in units of the noise, and of weights.

    Residual of a cell on face k: n_k . P - d_k, weighted by its probability and precision (Cauchy).
    """
    A = np.zeros((8, 8))
    g = np.zeros(8)
    spread = 0.0
    total = 0.0
    m = plane_rows(R, distances)
    row = np.zeros(8)
    for i in range(len(rays)):
        w = inverse_depth[i]
        if w <= 0.0:
            continue
        face, best = face_of_ray(m, rays[i])
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
    return A, g, spread, total


@njit(cache=True, nogil=True)
def _turn_about(axis, angle):  # type: ignore[no-untyped-def]
    """Rotation about one of the camera's axes."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn
