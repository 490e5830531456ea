"""Continuous refinement of a cuboid: pattern search over rotation and offsets, then least squares on the inliers.

The pattern search follows the cost itself, kinks and all; the least squares (Gauss-Newton on the points of structure
that lie on their planes) carries the precision. Beyond the paper (docs/method.md, section 8).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .depth import depth_sigma
from .layout import plane_rows
from .room_axes import nearest_rotation
from .room_cells import INTERLEAVED_PARTS
from .room_cost import MIN_DISTANCE_M, CellCosts, FittedRoom, face_of_point, mean_cost, rate_room

_REFINED_PARTS = 3
"""The pattern search looks at so many of the interleaved parts of the cells; least squares at all."""
_FIRST_TURN_RAD = np.deg2rad(1.0)
_FIRST_SHIFT_M = 0.06
_HALVINGS = 4
_ROUNDS = 4
_POLISH_ROUNDS = 6
_POLISH_SIGMAS = 4.0
_LEAST_STRUCTURE = 0.5


def refine_room(cells: CellCosts, room: FittedRoom, turn: bool = True) -> FittedRoom:
    """Pattern search over rotations and finite distances, halving the steps, then least squares on the inliers.

    `turn` False holds the rotation in the pattern search: without depth, lines know the axes better than regions do.
    """
    R, distances, _ = _refine(cells.terms, len(cells.cells.rays), room.R_room_camera, room.distances, cells.costs, turn)
    R, distances = _polish(cells.cells.rays, cells.cells.inverse_depth, cells.cells.probability, R, distances)
    return rate_room(cells, FittedRoom(np.asarray(nearest_rotation(R)), distances, np.inf))


@njit(cache=True, nogil=True)
def _refine(terms, cells, R, distances, costs, turning):  # type: ignore[no-untyped-def]
    distances = distances.copy()
    count = cells * _REFINED_PARTS // INTERLEAVED_PARTS
    best = mean_cost(terms, R, distances, costs, count, np.inf)
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
                    cost = mean_cost(terms, trial_R, trial, costs, count, best)
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
    cells = _measured_structure(rays, inverse_depth, probability)
    scale = 1.0  # of the residuals, in units of the depth noise; a clean sensor earns a sharper fit
    for _ in range(_POLISH_ROUNDS):
        A, g, spread, total = _normal_equations(cells, R, distances, scale)
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
def _measured_structure(rays, inverse_depth, probability):  # type: ignore[no-untyped-def]
    """(n, 7) of cells that may be on a face: point in m, probability of ceiling, floor and wall, 1 / depth noise."""
    cells, n = np.empty((len(rays), 7)), 0
    for i in range(len(rays)):
        w = inverse_depth[i]
        walls = probability[i, 2] + probability[i, 3] + probability[i, 4]
        if w > 0.0 and max(max(probability[i, 0], probability[i, 1]), walls) >= _LEAST_STRUCTURE:
            cells[n, 0], cells[n, 1], cells[n, 2] = rays[i, 0] / w, rays[i, 1] / w, rays[i, 2] / w
            cells[n, 3], cells[n, 4], cells[n, 5] = probability[i, 0], probability[i, 1], walls
            cells[n, 6] = 1.0 / depth_sigma(1.0 / w)
            n += 1
    return cells[:n]


@njit(cache=True, nogil=True)
def _normal_equations(cells, R, distances, scale):  # type: ignore[no-untyped-def]
    """(A, g) over (turn (3,), offsets (5,)), and sums of weighted residuals in units of the noise, and of weights.

    Residual of a cell on face k: n_k . P - d_k, weighted by its probability and precision (Cauchy). Its row is
    (n_k x P, -1 at k).
    """
    A, g = np.zeros((8, 8)), np.zeros(8)
    spread, total = 0.0, 0.0
    m = plane_rows(R, distances)
    normal = m.copy()
    for k in range(5):
        for j in range(3):
            normal[k, j] = m[k, j] * distances[k] if distances[k] < np.inf else 0.0
    for i in range(len(cells)):
        px, py, pz = cells[i, 0], cells[i, 1], cells[i, 2]
        face, best = face_of_point(m, px, py, pz)
        if face < 0:
            continue
        mine = cells[i, 3 + min(face, 2)]
        residual = distances[face] * (best - 1.0)
        off = abs(residual) * cells[i, 6]  # in units of the noise
        relative = off / scale
        if mine < _LEAST_STRUCTURE or relative > _POLISH_SIGMAS:
            continue
        weight = mine * cells[i, 6] * cells[i, 6] / (1.0 + relative * relative)
        spread += weight * off
        total += weight
        nx, ny, nz = normal[face, 0], normal[face, 1], normal[face, 2]
        a, b, c = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        wa, wb, wc, at = weight * a, weight * b, weight * c, 3 + face
        A[0, 0] += wa * a
        A[0, 1] += wa * b
        A[0, 2] += wa * c
        A[1, 1] += wb * b
        A[1, 2] += wb * c
        A[2, 2] += wc * c
        A[0, at] -= wa
        A[1, at] -= wb
        A[2, at] -= wc
        A[at, at] += weight
        g[0] -= wa * residual
        g[1] -= wb * residual
        g[2] -= wc * residual
        g[at] += weight * residual
    for a in range(8):
        for b in range(a):
            A[a, b] = A[b, a]
    return A, g, spread, total


@njit(cache=True, nogil=True)
def _turn_about(axis, angle):  # type: ignore[no-untyped-def]
    """Rotation about one of the camera's axes."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn
