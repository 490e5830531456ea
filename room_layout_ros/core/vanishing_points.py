"""The room's axes from line segments alone: an exhaustive search with known focal length, refined robustly.

A segment and the camera span a plane; the direction d of a 3-D line in it is perpendicular to the plane's normal.
Every segment therefore votes for a great circle of directions. Votes are gathered once on a grid of directions;
then every upright rotation (pitch, roll, yaw) is scored by three look-ups, so nothing is sampled and the same
segments always give the same axes. Method.md section 4; compare Lu et al. WACV 2017 (two-line exhaustive search).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .frame import CameraIntrinsics
from .lines import LineSegments, segment_planes
from .room_axes import angle_between_axes

_GRID = 40
"""Cells per side of each cube face of the direction table: about 2.2 degrees."""
_VOTE_TOLERANCE_DEG = 2.5
_REFINE_TOLERANCE_DEG = 2.0
_STEP_DEG = 2.0
_MAX_SEGMENTS = 150
_ENOUGH_SEGMENTS = 20.0
"""With fewer segments the axes are less sure: one always meets an axis."""
_MAX_LENGTH_PX = 100.0
"""Longer segments vote no more than this length: a single long edge must not decide."""
_ROLL_SIGMA_DEG = 6.0
_TILT_SIGMA_DEG = 25.0
_PRIOR_WEIGHT = 0.01
_GRAVITY_SIGMA_DEG = 1.5
_DISTINCT_DEG = 8.0
_MAX_HYPOTHESES = 4
_REFINE_STEPS = 8


@dataclass(frozen=True, slots=True)
class AxesEstimate:
    """Room axes with their confidence.

    Attributes
    ----------
    confidence : float
        0..1: share of cases like this one in which the axes are right within 5 degrees.
    hypotheses : tuple of (3, 3) float64
        Distinct rotations into the camera frame, best first; the second row is down, the others are not named yet
        (`room_axes.name_axes`).
    """

    confidence: float
    hypotheses: tuple[NDArray[np.float64], ...]


def estimate_axes_from_lines(
    segments: LineSegments,
    camera: CameraIntrinsics,
    config: EstimatorConfig,
    gravity: NDArray[np.float64] | None = None,
) -> AxesEstimate:
    """Find the Manhattan axes that most segments run along.

    Parameters
    ----------
    segments : LineSegments
        Longest first; the 150 longest are used.
    camera : CameraIntrinsics
    config : EstimatorConfig
        `vp_max_tilt_deg` and `vp_max_roll_deg` bound the search.
    gravity : (3,) float64, optional
        Down in the camera frame (from an IMU or TF); None searches around an upright camera.

    Returns
    -------
    AxesEstimate
        Without segments the upright camera itself, with confidence 0.
    """
    segments = LineSegments(segments.points[:_MAX_SEGMENTS])
    normal, middle = segment_planes(segments, camera)
    length = np.minimum(segments.length_px.astype(np.float64), _MAX_LENGTH_PX)
    weight = length / max(length.sum(), 1e-9)
    noise = np.arctan(1.0 / np.maximum(segments.length_px.astype(np.float64), 1.0))
    down = None if gravity is None else gravity / np.linalg.norm(gravity)
    votes = _vote(normal, middle, weight, np.sin(np.deg2rad(_VOTE_TOLERANCE_DEG) + noise), _GRID)
    tilts, rolls = _upright_grid(config, down)
    score, yaw = _score_rotations(votes, tilts, rolls, down is None)
    found: list[tuple[float, NDArray[np.float64]]] = []
    tolerance = np.sin(np.deg2rad(_REFINE_TOLERANCE_DEG) + noise)
    for tilt, roll, turn in _modes(score, tilts, rolls, yaw):
        R, value = _refine(_rotation(tilt, roll, turn), normal, middle, weight, tolerance, down)
        if all(angle_between_axes(R, other) > np.deg2rad(_DISTINCT_DEG / 2) for _, other in found):
            found.append((value, R))
    found.sort(key=lambda pair: -pair[0])
    found = found[:_MAX_HYPOTHESES]
    return AxesEstimate(_confidence(found, len(segments)), tuple(R for _, R in found))


def _upright_grid(
    config: EstimatorConfig, down: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if down is not None:
        return np.array([np.arcsin(np.clip(down[2], -1, 1))]), np.array([np.arctan2(-down[0], down[1])])
    step = np.deg2rad(_STEP_DEG)
    tilt, roll = np.deg2rad(config.vp_max_tilt_deg), np.deg2rad(config.vp_max_roll_deg)
    n_tilt, n_roll = int(tilt / step), int(roll / step)
    return np.arange(-n_tilt, n_tilt + 1) * step, np.arange(-n_roll, n_roll + 1) * step


@njit(cache=True, nogil=True)
def _rotation(tilt, roll, yaw):  # type: ignore[no-untyped-def]
    """Rows X, Y (down), Z of a camera with down = (-cos(tilt) sin(roll), cos(tilt) cos(roll), sin(tilt))."""
    ct, st, cr, sr = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    y = np.array([-ct * sr, ct * cr, st])
    x0 = np.array([cr, sr, 0.0])
    z0 = np.array([st * sr, -st * cr, ct])  # x0 x y
    out = np.empty((3, 3))
    out[0] = np.cos(yaw) * x0 - np.sin(yaw) * z0
    out[1] = y
    out[2] = np.sin(yaw) * x0 + np.cos(yaw) * z0
    return out


@njit(cache=True, nogil=True)
def _vote(normal, middle, weight, tolerance, grid):  # type: ignore[no-untyped-def]
    """(3, grid, grid): votes for the direction through each cell of the three visible faces of a cube."""
    votes = np.zeros((3, grid, grid))
    for face in range(3):
        f1, f2 = (face + 1) % 3, (face + 2) % 3
        for i in range(normal.shape[0]):
            n0, n1, n2 = normal[i, face], normal[i, f1], normal[i, f2]
            m0, m1, m2 = middle[i, face], middle[i, f1], middle[i, f2]
            t2, w = tolerance[i] * tolerance[i], weight[i]
            for a in range(grid):
                p = 2.0 * (a + 0.5) / grid - 1.0
                for b in range(grid):
                    q = 2.0 * (b + 0.5) / grid - 1.0
                    square = 1.0 + p * p + q * q
                    across = n0 + n1 * p + n2 * q
                    across *= across
                    if across < t2 * square:
                        along = m0 + m1 * p + m2 * q
                        share = across / (max(square - along * along, 1e-3) * t2)
                        if share < 1.0:
                            votes[face, a, b] += w * (1.0 - share) ** 2
    return votes


@njit(cache=True, nogil=True)
def _look_up(votes, d0, d1, d2):  # type: ignore[no-untyped-def]
    """Votes of a direction: bilinear within its cube face."""
    a0, a1, a2 = abs(d0), abs(d1), abs(d2)
    if a0 >= a1 and a0 >= a2:
        face, p, q = 0, d1 / d0, d2 / d0
    elif a1 >= a2:
        face, p, q = 1, d2 / d1, d0 / d1
    else:
        face, p, q = 2, d0 / d2, d1 / d2
    grid = votes.shape[1]
    fp = min(max((p + 1.0) * 0.5 * grid - 0.5, 0.0), grid - 1.001)
    fq = min(max((q + 1.0) * 0.5 * grid - 0.5, 0.0), grid - 1.001)
    i, j = int(fp), int(fq)
    u, v = fp - i, fq - j
    top = votes[face, i, j] * (1.0 - v) + votes[face, i, j + 1] * v
    low = votes[face, i + 1, j] * (1.0 - v) + votes[face, i + 1, j + 1] * v
    return top * (1.0 - u) + low * u


@njit(cache=True, nogil=True)
def _score_rotations(votes, tilts, rolls, use_prior):  # type: ignore[no-untyped-def]
    """Best score and yaw for each (tilt, roll)."""
    n_yaw = int(90.0 / _STEP_DEG)
    score = np.empty((tilts.size, rolls.size, n_yaw))
    yaws = np.deg2rad(np.arange(n_yaw) * _STEP_DEG - 45.0)
    cosines, sines = np.cos(yaws), np.sin(yaws)
    for t in range(tilts.size):
        for r in range(rolls.size):
            base = _rotation(tilts[t], rolls[r], 0.0)
            x0, x1, x2 = base[0, 0], base[0, 1], base[0, 2]
            z0, z1, z2 = base[2, 0], base[2, 1], base[2, 2]
            fixed = _look_up(votes, base[1, 0], base[1, 1], base[1, 2])
            if use_prior:
                fixed -= _PRIOR_WEIGHT * _tilt_cost(tilts[t], rolls[r])
            for k in range(n_yaw):
                c, s = cosines[k], sines[k]
                along_x = _look_up(votes, c * x0 - s * z0, c * x1 - s * z1, c * x2 - s * z2)
                along_z = _look_up(votes, s * x0 + c * z0, s * x1 + c * z1, s * x2 + c * z2)
                score[t, r, k] = fixed + along_x + along_z
    return score, yaws


@njit(cache=True, nogil=True)
def _tilt_cost(tilt, roll):  # type: ignore[no-untyped-def]
    return 0.5 * (tilt / np.deg2rad(_TILT_SIGMA_DEG)) ** 2 + 0.5 * (roll / np.deg2rad(_ROLL_SIGMA_DEG)) ** 2


def _modes(
    score: NDArray[np.float64], tilts: NDArray[np.float64], rolls: NDArray[np.float64], yaws: NDArray[np.float64]
) -> list[tuple[float, float, float]]:
    """Pick the highest cells that are `_DISTINCT_DEG` apart."""
    reach = int(_DISTINCT_DEG / _STEP_DEG)
    left = score.copy()
    picked = []
    for _ in range(2 * _MAX_HYPOTHESES):
        t, r, k = np.unravel_index(int(np.argmax(left)), left.shape)
        if not np.isfinite(left[t, r, k]):
            break
        picked.append((float(tilts[t]), float(rolls[r]), float(yaws[k])))
        turned = np.arange(k - reach, k + reach + 1) % left.shape[2]
        left[max(t - reach, 0) : t + reach + 1, max(r - reach, 0) : r + reach + 1, turned] = -np.inf
    return picked


def _refine(
    R: NDArray[np.float64],
    normal: NDArray[np.float64],
    middle: NDArray[np.float64],
    weight: NDArray[np.float64],
    tolerance: NDArray[np.float64],
    down: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], float]:
    pull = np.zeros(3) if down is None else down
    pull_weight = 0.0 if down is None else 1.0 / np.deg2rad(_GRAVITY_SIGMA_DEG) ** 2 / 100.0
    refined = _gauss_newton(R, normal, middle, weight, tolerance, pull, pull_weight)
    value = _support(refined, normal, middle, weight, tolerance)
    if down is None:
        y = refined[1]
        tilt, roll = np.arcsin(np.clip(y[2], -1, 1)), np.arctan2(-y[0], y[1])
        value -= _PRIOR_WEIGHT * _tilt_cost(tilt, roll)
    return refined, float(value)


@njit(cache=True, nogil=True)
def _support(R, normal, middle, weight, tolerance):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(normal.shape[0]):
        best = 0.0
        for k in range(3):
            across = normal[i, 0] * R[k, 0] + normal[i, 1] * R[k, 1] + normal[i, 2] * R[k, 2]
            along = middle[i, 0] * R[k, 0] + middle[i, 1] * R[k, 1] + middle[i, 2] * R[k, 2]
            share = across * across / (max(1.0 - along * along, 1e-3) * tolerance[i] ** 2)
            if share < 1.0:
                best = max(best, (1.0 - share) ** 2)
        total += weight[i] * best
    return total


@njit(cache=True, nogil=True)
def _gauss_newton(R, normal, middle, weight, tolerance, down, down_weight):  # type: ignore[no-untyped-def]
    """Turn R so that segments meet their axes; biweight, tolerance narrowing from twice to once."""
    R = R.copy()
    for step in range(_REFINE_STEPS):
        widen = max(2.0 - step * 0.25, 1.0)
        A = np.eye(3) * 1e-6
        b, j = np.zeros(3), np.zeros(3)
        for i in range(normal.shape[0]):
            best, axis = 1.0, -1
            t2 = (widen * tolerance[i]) ** 2
            for k in range(3):
                across = normal[i, 0] * R[k, 0] + normal[i, 1] * R[k, 1] + normal[i, 2] * R[k, 2]
                along = middle[i, 0] * R[k, 0] + middle[i, 1] * R[k, 1] + middle[i, 2] * R[k, 2]
                share = across * across / (max(1.0 - along * along, 1e-3) * t2)
                if share < best:
                    best, axis = share, k
            if axis < 0:
                continue
            d0, d1, d2 = R[axis, 0], R[axis, 1], R[axis, 2]
            n0, n1, n2 = normal[i, 0], normal[i, 1], normal[i, 2]
            along = middle[i, 0] * d0 + middle[i, 1] * d1 + middle[i, 2] * d2
            w = weight[i] * (1.0 - best) ** 2 / (max(1.0 - along * along, 1e-3) * t2)
            e = n0 * d0 + n1 * d1 + n2 * d2
            # d(n . (d + turn x d)) / d turn = d x n
            j[0], j[1], j[2] = d1 * n2 - d2 * n1, d2 * n0 - d0 * n2, d0 * n1 - d1 * n0
            for p in range(3):
                b[p] -= w * e * j[p]
                for q in range(3):
                    A[p, q] += w * j[p] * j[q]
        if down_weight > 0.0:
            for c in range(3):
                e = R[1, c] - down[c]
                unit = np.zeros(3)
                unit[c] = 1.0
                j[:] = np.cross(R[1], unit)
                for p in range(3):
                    b[p] -= down_weight * e * j[p]
                    for q in range(3):
                        A[p, q] += down_weight * j[p] * j[q]
        turn = np.linalg.solve(A, b)
        size = np.sqrt((turn * turn).sum())
        if size > 0.1:
            turn *= 0.1 / size
        for k in range(3):
            R[k] = R[k] + np.cross(turn, R[k])
        R[1] /= np.sqrt((R[1] * R[1]).sum())
        R[2] -= (R[2] * R[1]).sum() * R[1]
        R[2] /= np.sqrt((R[2] * R[2]).sum())
        R[0] = np.cross(R[1], R[2])
    return R


def _confidence(found: list[tuple[float, NDArray[np.float64]]], count: int) -> float:
    if count == 0:
        return 0.0
    best = found[0][0]
    second = found[1][0] if len(found) > 1 else 0.0
    margin = best - second
    return min(count / _ENOUGH_SEGMENTS, 1.0) / (1.0 + float(np.exp(-(-1.0 + 4.0 * best + 20.0 * margin))))
