"""The simple depth estimator: the cuboid whose planes the depth supports and does not pass through.

Every cell of the depth image votes for the face it lies on: it *supports* the plane it is on (when its normal agrees)
and *violates* a plane it lies beyond, since nothing can be seen through a wall. The cuboid with the best balance is
found by coordinate descent over candidate offsets per face, from two starts. The named baseline of the joint model,
which reads the same of depth as profiles over the offsets (`depth_profiles`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth_cells import DepthCells
from .labels import FRONT_FACE, N_FACES
from .layout import FACE_AXIS, FACE_SIGN, face_of_ray, plane_rows

VIOLATION_WEIGHT = 1.5
"""What a cell beyond a plane costs, in cells on one."""

_SWEEPS = 4
_CANDIDATES = 40
_MIN_DISTANCE_M = 0.2
_MARGIN_M = 0.05
_MIN_SUPPORT = 0.15
_SLIVER = 0.06
_ABSENT_SLACK = 0.004


@dataclass(frozen=True, slots=True)
class LayoutEvidence:
    """Cells of the frame in room axes: what the scoring kernel reads.

    Attributes
    ----------
    points : (n, 3) float64 mean points in room axes, m; NaN where nothing was measured.
    agreement : (n, 3) float64 0..1, how well the cell's normal agrees with each axis.
    sigma : (n,) float64 depth noise, m.
    """

    points: NDArray[np.float64]
    agreement: NDArray[np.float64]
    sigma: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScoredLayout:
    """A cuboid with its score (higher is better) and the support share per face."""

    R_room_camera: NDArray[np.float64]
    distances: NDArray[np.float64]
    score: float
    support: NDArray[np.float64]
    violation: NDArray[np.float64]


def search_layout(cells: DepthCells, R: NDArray[np.float64]) -> ScoredLayout:
    """Best cuboid for the axes R: coordinate descent over candidate offsets of each face."""
    evidence = LayoutEvidence(*cells.turned(R), cells.sigma)
    candidates, extent = _candidate_offsets(evidence)
    best, best_score = extent, -np.inf
    for start in (extent, np.array([c[0] for c in candidates])):
        distances, score = start.copy(), -np.inf
        for _ in range(_SWEEPS):
            before = score
            for face in range(N_FACES):
                trials = np.append(candidates[face], distances[face])
                scores = score_face(evidence, distances, face, trials)
                k = int(np.argmax(scores))
                distances[face], score = trials[k], float(scores[k])
            if score <= before + 1e-9:
                break
        if score > best_score:
            best, best_score = distances, score
    return _drop_slivers(evidence, R, best, best_score)


def score_face(
    evidence: LayoutEvidence, distances: NDArray[np.float64], face: int, trials: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Score of the cuboid for each trial distance (t,) of one face (0..4), the others held: mean over cells."""
    return np.asarray(_score_face(evidence.points, evidence.agreement, evidence.sigma, distances, face, trials))


def _drop_slivers(
    evidence: LayoutEvidence, R: NDArray[np.float64], distances: NDArray[np.float64], score: float
) -> ScoredLayout:
    """Declare slivers absent that nothing supports or needs: a guess at the edge of the data is no observation."""
    support, violation, area = _balance(evidence, distances)
    for face in np.flatnonzero((support < _MIN_SUPPORT) & (area < _SLIVER)):
        if face == FRONT_FACE:
            continue
        without = float(score_face(evidence, distances, int(face), np.array([np.inf]))[0])
        if without > score - _ABSENT_SLACK:
            distances[face], score = np.inf, without
    support, violation, _ = _balance(evidence, distances)
    return ScoredLayout(R, distances, score, support, violation)


def _balance(
    evidence: LayoutEvidence, distances: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Support and violation of each face as shares of its cells, and its share of all cells."""
    support, violation, count = _sum_faces(evidence.points, evidence.agreement, evidence.sigma, distances)
    cells = np.maximum(count, 1)
    return support / cells, violation / cells, count / len(evidence.points)


def _candidate_offsets(evidence: LayoutEvidence) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Per face: peaks of the support histogram, strongest first, and the extent of the points."""
    candidates = []
    extent = np.empty(N_FACES)
    seen = np.isfinite(evidence.points[:, 2])
    for face in range(N_FACES):
        axis = FACE_AXIS[face]
        offset = FACE_SIGN[face] * evidence.points[seen, axis]
        weight = evidence.agreement[seen, axis]
        extent[face] = max(float(np.percentile(offset, 99.5)) + _MARGIN_M, _MIN_DISTANCE_M)
        peaks = _histogram_peaks(offset, weight)
        candidates.append(np.append(peaks, extent[face]))
    return candidates, extent


def _histogram_peaks(offset: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Local maxima of the smoothed weighted histogram (4 cm bins), strongest first."""
    keep = offset > _MIN_DISTANCE_M
    if not keep.any():
        return np.empty(0)
    width = 0.04
    bins = (offset[keep] / width).astype(int)
    histogram = np.bincount(bins, weight[keep], bins.max() + 3)
    smooth = np.convolve(histogram, [0.25, 0.5, 0.25], mode="same")
    peak = (smooth[1:-1] >= smooth[:-2]) & (smooth[1:-1] > smooth[2:]) & (smooth[1:-1] > 1.0)
    index = np.flatnonzero(peak) + 1
    index = index[np.argsort(-smooth[index])][:_CANDIDATES]
    total = histogram[index - 1] + histogram[index] + histogram[index + 1]
    moment = histogram[index - 1] * (index - 1) + histogram[index] * index + histogram[index + 1] * (index + 1)
    centre = moment / np.maximum(total, 1e-9)
    return np.asarray((centre + 0.5) * width)


@njit(cache=True, nogil=True)
def _score_face(points, agreement, sigma, distances, face, trials):  # type: ignore[no-untyped-def]
    scores = np.zeros(len(trials))
    others = plane_rows(np.eye(3), distances)
    others[face] = 0.0
    axis, sign = FACE_AXIS[face], FACE_SIGN[face]
    constant = 0.0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not z == z:
            continue
        rival, value = face_of_ray(others, x, y, z, 0.0)
        rest = 0.0
        if rival >= 0:
            on, beyond = _plane_fit(points[i], sigma[i], rival, distances[rival])
            rest = on * agreement[i, FACE_AXIS[rival]] - VIOLATION_WEIGHT * beyond
        along = sign * points[i, axis]
        if along <= 0.0:
            constant += rest
            continue
        for t in range(len(trials)):
            if along > value * trials[t]:
                on, beyond = _plane_fit(points[i], sigma[i], face, trials[t])
                scores[t] += on * agreement[i, axis] - VIOLATION_WEIGHT * beyond
            else:
                scores[t] += rest
    return (scores + constant) / len(points)


@njit(cache=True, nogil=True)
def _sum_faces(points, agreement, sigma, distances):  # type: ignore[no-untyped-def]
    """Support, violation and number of the cells on each face."""
    support, violation, count = np.zeros(5), np.zeros(5), np.zeros(5)
    m = plane_rows(np.eye(3), distances)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not z == z:
            continue
        face, _ = face_of_ray(m, x, y, z, 0.0)
        if face < 0:
            continue
        on, beyond = _plane_fit(points[i], sigma[i], face, distances[face])
        count[face] += 1
        support[face] += on * agreement[i, FACE_AXIS[face]]
        violation[face] += beyond
    return support, violation, count


@njit(cache=True, nogil=True)
def _plane_fit(point, sigma, face, distance):  # type: ignore[no-untyped-def]
    """(0..1 on the plane of a face, 0..1 beyond it) of a point in room axes."""
    gap = distance - FACE_SIGN[face] * point[FACE_AXIS[face]]
    width = 2.0 * sigma + 0.01 * distance
    if gap > 4.0 * width:
        return 0.0, 0.0
    on = np.exp(-0.5 * (gap / width) ** 2)
    beyond = min((-gap - width) / 0.15, 1.0) if gap < -width else 0.0
    return on, beyond
