"""The simple depth estimator: the cuboid whose planes the depth supports and does not pass through.

Every cell of the depth image votes for the face it lies on: it *supports* the plane it is on (when its normal agrees)
and *violates* a plane it lies beyond, since nothing can be seen through a wall. The cuboid with the best balance is
found by coordinate descent over candidate offsets per face, from several starts and front axes. The named baseline
of the joint model, and its source of metric planes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import CELL_PX, NOISE_FLOOR_M, NOISE_QUADRATIC, DepthGeometry, depth_sigma, fit_cell_planes
from .labels import FRONT_WALL, N_FACES
from .layout import FACE_AXIS, FACE_SIGN

_CANDIDATES = 40
_NO_NORMAL = 0.3
_NORMAL_RAD = np.deg2rad(6.0)
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
    rays : (n, 3) float64 rays (z = 1 in the camera) turned into room axes.
    points : (n, 3) float64 mean points in room axes, m; NaN where nothing was measured.
    agreement : (n, 3) float64 0..1, how well the cell's normal agrees with each axis.
    structure : (n, 5) float64 0..1 prior that the cell belongs to the structure of each face (1: nothing known).
    sigma : (n,) float64 depth noise, m.
    """

    rays: NDArray[np.float64]
    points: NDArray[np.float64]
    agreement: NDArray[np.float64]
    structure: NDArray[np.float64]
    sigma: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScoredLayout:
    """A cuboid with its score (higher is better) and the support share per face."""

    R_room_camera: NDArray[np.float64]
    distances: NDArray[np.float64]
    score: float
    support: NDArray[np.float64]
    violation: NDArray[np.float64]


def gather_evidence(
    geometry: DepthGeometry, R: NDArray[np.float64], structure: NDArray[np.float64] | None = None
) -> LayoutEvidence:
    """Collect the cells' points, normals and noise in the axes R."""
    moments = geometry.moments
    rows, cols, _ = moments.shape
    camera = geometry.camera
    px = np.arange(cols) * CELL_PX + (CELL_PX - 1) / 2
    py = np.arange(rows) * CELL_PX + (CELL_PX - 1) / 2
    x, y = (px - camera.cx)[None, :] / camera.fx, (py - camera.cy)[:, None] / camera.fy
    rays = np.stack(np.broadcast_arrays(x, y, 1.0), -1)
    n = moments[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(n >= CELL_PX * CELL_PX * 0.3, n / moments[..., 3], np.nan)
    points = rays * z[..., None]
    agreement = np.full((rows, cols, 3), _NO_NORMAL)
    for radius in (1, 2):
        planes = fit_cell_planes(geometry, radius)
        cosine = np.abs(planes.normal @ R.T)
        spread = 2.0 * (_NORMAL_RAD**2 + planes.sigma**2)
        fit = np.exp(-2.0 * (1.0 - cosine) / spread[:, None])
        agreement[planes.cell[:, 0], planes.cell[:, 1]] = fit
    flat = points.reshape(-1, 3)
    sigma = depth_sigma_array(np.nan_to_num(flat[:, 2], nan=1.0))
    prior = np.ones((rows * cols, N_FACES)) if structure is None else structure
    return LayoutEvidence(rays.reshape(-1, 3) @ R.T, flat @ R.T, agreement.reshape(-1, 3), prior, sigma)


def depth_sigma_array(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth noise in m for depths in m."""
    return np.asarray(depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC))


def search_layout(
    evidence: LayoutEvidence, R: NDArray[np.float64], violation_weight: float = 1.5, sweeps: int = 4
) -> ScoredLayout:
    """Best cuboid for the axes R: coordinate descent over candidate offsets of each face."""
    candidates, extent = _candidate_offsets(evidence)
    best, best_score = extent, -np.inf
    for start in (extent, np.array([c[0] for c in candidates])):
        distances, score = start.copy(), -np.inf
        for _ in range(sweeps):
            before = score
            for face in range(N_FACES):
                trials = np.append(candidates[face], distances[face])
                scores = score_face(evidence, distances, face, trials, violation_weight)
                k = int(np.argmax(scores))
                distances[face], score = trials[k], float(scores[k])
            if score <= before + 1e-9:
                break
        if score > best_score:
            best, best_score = distances, score
    return _drop_slivers(evidence, R, best, best_score, violation_weight)


def score_face(
    evidence: LayoutEvidence,
    distances: NDArray[np.float64],
    face: int,
    trials: NDArray[np.float64],
    violation_weight: float,
) -> NDArray[np.float64]:
    """Score of the cuboid for each trial distance (t,) of one face (0..4), the others held: mean over cells."""
    e = evidence
    return np.asarray(
        _score_face(
            e.rays, e.points, e.agreement, e.structure, e.sigma, 1.0 / distances, face, trials, violation_weight
        )
    )


def _drop_slivers(
    evidence: LayoutEvidence,
    R: NDArray[np.float64],
    distances: NDArray[np.float64],
    score: float,
    violation_weight: float,
) -> ScoredLayout:
    """Declare slivers absent that nothing supports or needs: a guess at the edge of the data is no observation."""
    support, violation, area = _balance(evidence, distances)
    for face in np.flatnonzero((support < _MIN_SUPPORT) & (area < _SLIVER)):
        if face == FRONT_WALL - 1:
            continue
        without = float(score_face(evidence, distances, int(face), np.array([np.inf]), violation_weight)[0])
        if without > score - _ABSENT_SLACK:
            distances[face], score = np.inf, without
    support, violation, _ = _balance(evidence, distances)
    return ScoredLayout(R, distances, score, support, violation)


def _balance(
    evidence: LayoutEvidence, distances: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Support and violation of each face as shares of its cells, and its share of all cells."""
    e = evidence
    support, violation, count = _sum_faces(e.rays, e.points, e.agreement, e.structure, e.sigma, 1.0 / distances)
    cells = np.maximum(count, 1)
    return support / cells, violation / cells, count / len(e.rays)


def _candidate_offsets(evidence: LayoutEvidence) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Per face: peaks of the support histogram, strongest first, and the extent of the points."""
    candidates = []
    extent = np.empty(N_FACES)
    seen = np.isfinite(evidence.points[:, 2])
    for face in range(N_FACES):
        axis = FACE_AXIS[face]
        offset = FACE_SIGN[face] * evidence.points[seen, axis]
        weight = evidence.agreement[seen, axis] * evidence.structure[seen, face]
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
def _score_face(rays, points, agreement, structure, sigma, inverse, face, trials, violation_weight):  # type: ignore[no-untyped-def]
    scores = np.zeros(len(trials))
    n = len(rays)
    others = inverse.copy()
    others[face] = 0.0
    axis = _axis_of(face)
    sign = -1.0 if face == 0 or face == 2 else 1.0
    constant = 0.0
    for i in range(n):
        if not points[i, 2] == points[i, 2]:
            continue
        rival, value = face_of_ray(rays[i], others)
        rest = 0.0
        if rival >= 0:
            on, beyond = plane_fit(points[i], sigma[i], rival, 1.0 / others[rival])
            rest = on * agreement[i, _axis_of(rival)] * structure[i, rival] - violation_weight * beyond
        along_ray = sign * rays[i, axis]
        if along_ray <= 0.0:
            constant += rest
            continue
        weight = agreement[i, axis] * structure[i, face]
        for t in range(len(trials)):
            if along_ray > value * trials[t]:
                on, beyond = plane_fit(points[i], sigma[i], face, trials[t])
                scores[t] += on * weight - violation_weight * beyond
            else:
                scores[t] += rest
    return (scores + constant) / n


@njit(cache=True, nogil=True)
def _sum_faces(rays, points, agreement, structure, sigma, inverse):  # type: ignore[no-untyped-def]
    support = np.zeros(5)
    violation = np.zeros(5)
    count = np.zeros(5)
    for i in range(len(rays)):
        if not points[i, 2] == points[i, 2]:
            continue
        face, _ = face_of_ray(rays[i], inverse)
        if face < 0:
            continue
        on, beyond = plane_fit(points[i], sigma[i], face, 1.0 / inverse[face])
        count[face] += 1
        support[face] += on * agreement[i, _axis_of(face)] * structure[i, face]
        violation[face] += beyond
    return support, violation, count


@njit(cache=True, nogil=True, inline="always")
def _axis_of(face):  # type: ignore[no-untyped-def]
    return 1 if face < 2 else (2 if face == 3 else 0)


@njit(cache=True, nogil=True)
def face_of_ray(ray, inverse):  # type: ignore[no-untyped-def]
    """(face 0..4 that a ray in room axes hits, or -1; its 1 / range)."""
    best = 0.0
    face = -1
    for k in range(5):
        value = ray[_axis_of(k)] * inverse[k]
        if k == 0 or k == 2:
            value = -value
        if value > best:
            best, face = value, k
    return face, best


@njit(cache=True, nogil=True)
def plane_fit(point, sigma, face, distance):  # type: ignore[no-untyped-def]
    """(0..1 on the plane of a face, 0..1 beyond it) of a point in room axes."""
    along = point[_axis_of(face)]
    if face == 0 or face == 2:
        along = -along
    gap = distance - along
    width = 2.0 * sigma + 0.01 * distance
    if gap > 4.0 * width:
        return 0.0, 0.0
    on = np.exp(-0.5 * (gap / width) ** 2)
    beyond = min((-gap - width) / 0.15, 1.0) if gap < -width else 0.0
    return on, beyond
