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
FRONT = FRONT_WALL - 1


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
    rays = np.stack(np.broadcast_arrays((px - camera.cx)[None, :] / camera.fx, (py - camera.cy)[:, None] / camera.fy, 1.0), -1)
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
    best: ScoredLayout | None = None
    for start in (extent, np.array([c[0] for c in candidates])):
        distances = start.copy()
        score = -np.inf
        for _ in range(sweeps):
            before = score
            for face in range(N_FACES):
                trials = np.tile(distances, (len(candidates[face]) + 1, 1))
                trials[1:, face] = candidates[face]
                scores = _score_layouts(
                    evidence.rays, evidence.points, evidence.agreement, evidence.structure, evidence.sigma, 1.0 / trials, violation_weight
                )
                k = int(np.argmax(scores))
                distances, score = trials[k], float(scores[k])
            if score <= before + 1e-9:
                break
        if best is None or score > best.score:
            best = _drop_unsupported(evidence, R, distances, score, violation_weight)
    assert best is not None
    return best


def _drop_unsupported(
    evidence: LayoutEvidence, R: NDArray[np.float64], distances: NDArray[np.float64], score: float, violation_weight: float
) -> ScoredLayout:
    """Declare slivers absent that nothing supports and nothing needs: a guess at the edge of the data is no observation."""
    support, violation, area = _balance(
        evidence.rays, evidence.points, evidence.agreement, evidence.structure, evidence.sigma, 1.0 / distances
    )
    for face in np.flatnonzero((support < _MIN_SUPPORT) & (area < _SLIVER)):
        if face == FRONT:
            continue
        trial = distances.copy()
        trial[face] = np.inf
        without = float(
            _score_layouts(
                evidence.rays, evidence.points, evidence.agreement, evidence.structure, evidence.sigma, 1.0 / trial[None], violation_weight
            )[0]
        )
        if without > score - _ABSENT_SLACK:
            distances, score = trial, without
    support, violation, _ = _balance(
        evidence.rays, evidence.points, evidence.agreement, evidence.structure, evidence.sigma, 1.0 / distances
    )
    return ScoredLayout(R, distances, score, support, violation)


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
    centre = (histogram[index - 1] * (index - 1) + histogram[index] * index + histogram[index + 1] * (index + 1)) / np.maximum(total, 1e-9)
    return np.asarray((centre + 0.5) * width)


@njit(cache=True, nogil=True)
def _score_layouts(rays, points, agreement, structure, sigma, inverse, violation_weight):  # type: ignore[no-untyped-def]
    """Score of each row of inverse distances (t, 5): mean over cells of support - weight * violation."""
    scores = np.zeros(len(inverse))
    n = len(rays)
    for t in range(len(inverse)):
        total = 0.0
        for i in range(n):
            face, on, beyond = cell_fit(rays[i], points[i], sigma[i], inverse[t])
            if face < 0:
                continue
            axis = 1 if face < 2 else (2 if face == 3 else 0)
            total += on * agreement[i, axis] * structure[i, face] - violation_weight * beyond
        scores[t] = total / n
    return scores


@njit(cache=True, nogil=True)
def _balance(rays, points, agreement, structure, sigma, inverse):  # type: ignore[no-untyped-def]
    """Support and violation of each face as shares of its cells, and its share of all cells."""
    support = np.zeros(5)
    violation = np.zeros(5)
    count = np.zeros(5)
    for i in range(len(rays)):
        face, on, beyond = cell_fit(rays[i], points[i], sigma[i], inverse)
        if face < 0:
            continue
        axis = 1 if face < 2 else (2 if face == 3 else 0)
        count[face] += 1
        support[face] += on * agreement[i, axis] * structure[i, face]
        violation[face] += beyond
    for face in range(5):
        if count[face] > 0:
            support[face] /= count[face]
            violation[face] /= count[face]
    return support, violation, count / len(rays)


@njit(cache=True, nogil=True, inline="always")
def cell_fit(ray, point, sigma, inverse):  # type: ignore[no-untyped-def]
    """(face 0..4 or -1 without depth, 0..1 on the plane, 0..1 beyond it) of one cell."""
    if not point[2] == point[2]:
        return -1, 0.0, 0.0
    best = 0.0
    face = -1
    value = -ray[1] * inverse[0]
    if value > best:
        best, face = value, 0
    value = ray[1] * inverse[1]
    if value > best:
        best, face = value, 1
    value = -ray[0] * inverse[2]
    if value > best:
        best, face = value, 2
    value = ray[2] * inverse[3]
    if value > best:
        best, face = value, 3
    value = ray[0] * inverse[4]
    if value > best:
        best, face = value, 4
    if face < 0:
        return -1, 0.0, 0.0
    if face < 2:
        along = point[1] if face == 1 else -point[1]
    elif face == 3:
        along = point[2]
    else:
        along = point[0] if face == 4 else -point[0]
    gap = 1.0 / inverse[face] - along
    width = 2.0 * sigma + 0.01 / inverse[face]
    on = np.exp(-0.5 * (gap / width) ** 2)
    beyond = 0.0
    if gap < -width:
        beyond = min((-gap - width) / 0.15, 1.0)
    return face, on, beyond
