"""The cuboid that explains the class labels and the depth of a frame: layouts to learn from (docs/learning.md)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import RgbdFrame, RoomCuboid
from ..core.labels import CEILING_FACE, FLOOR_FACE, FRONT_FACE, LEFT_FACE, RIGHT_FACE
from ..core.layout import FACE_AXIS, FACE_SIGN
from .fit_axes import axis_hypotheses, rotation_from_vector
from .fit_objective import FitCosts, fit_cost
from .fit_observation import FitClass, FitObservation, observe

STRUCTURE = (FitClass.WALL, FitClass.FLOOR, FitClass.CEILING, FitClass.OPENING)
_MIN_DISTANCE_M = 0.05
_COARSE = 7


@dataclass(frozen=True, slots=True)
class LayoutFit:
    """A room fitted to a labelled frame.

    Attributes
    ----------
    cuboid : the room; distances inf where a face is out of view.
    layout : (H, W) uint8 its raster, 1..5.
    cost : mean cost per pixel (`fit_objective.FitCosts`).
    quality : 0..1, share of structural pixels (walls, floor, ceiling) that lie on a face of their kind.
    """

    cuboid: RoomCuboid
    layout: NDArray[np.uint8]
    cost: float
    quality: float


def fit_layout(
    frame: RgbdFrame, labels40: NDArray[np.uint8], costs: FitCosts | None = None, min_structure: float = 0.05
) -> LayoutFit | None:
    """Fit a room cuboid to a frame with NYU40 labels; None where too little structure is in view.

    Parameters
    ----------
    labels40 : (H, W) uint8 NYU40 ids, 0 unlabelled.
    min_structure : least share of pixels labelled wall, floor or ceiling (openings included).

    Raises
    ------
    ValueError
        When the frame has no depth or the labels are not of its size.
    """
    costs = costs or FitCosts()
    seen = observe(frame, labels40)
    structural = np.isin(seen.kind, STRUCTURE)
    if structural.mean() < min_structure:
        return None
    found = [_search(seen, R, costs) for R in axis_hypotheses(seen)]
    found.sort(key=lambda entry: entry[0])
    refined = [_refine(seen, R, distances, costs) for _, R, distances in found[:2]]
    cost, R, distances = min(refined, key=lambda entry: entry[0])
    return _as_fit(frame, seen, R, distances, cost)


def _search(
    seen: FitObservation, R: NDArray[np.float64], costs: FitCosts
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Best of the candidate distances: all combinations of walls on a coarse grid, then coordinate descent."""
    candidates = _candidates(seen, R)
    start = np.array([c[0] for c in candidates])
    best, distances = np.inf, start
    for left, front, right in itertools.product(*(candidates[k] for k in (LEFT_FACE, FRONT_FACE, RIGHT_FACE))):
        trial = np.array([start[0], start[1], left, front, right])
        cost = fit_cost(seen, R, trial, costs, stride=_COARSE)
        if cost < best:
            best, distances = cost, trial
    best = fit_cost(seen, R, distances, costs)
    for _ in range(3):
        before = best
        for k in (FLOOR_FACE, CEILING_FACE, FRONT_FACE, LEFT_FACE, RIGHT_FACE):
            for value in candidates[k]:
                trial = distances.copy()
                trial[k] = value
                cost = fit_cost(seen, R, trial, costs)
                if cost < best:
                    best, distances = cost, trial
        if best > before - 1e-6:
            break
    return best, R, distances


def _candidates(seen: FitObservation, R: NDArray[np.float64]) -> list[list[float]]:
    """Distances worth trying per face: modes of the coordinates along the axis, extents, and out of view."""
    measured = seen.inverse_depth > 0
    kind = seen.kind[measured]
    points = seen.rays[measured] / seen.inverse_depth[measured][:, None] @ R.T
    kinds = {CEILING_FACE: (FitClass.CEILING,), FLOOR_FACE: (FitClass.FLOOR,)}
    result = []
    for face in range(5):
        along = FACE_SIGN[face] * points[:, FACE_AXIS[face]]
        mine = np.isin(kind, kinds.get(face, (FitClass.WALL, FitClass.OPENING)))
        values = _modes(along[mine], 4)
        if face >= LEFT_FACE or not values:
            if face >= LEFT_FACE:
                values += _modes(along[kind == FitClass.FITTED], 2) + _modes(along[kind == FitClass.CLUTTER], 2)
            if (along > _MIN_DISTANCE_M).sum() > 50:
                values += [float(v) for v in np.quantile(along[along > _MIN_DISTANCE_M], (0.98, 0.995))]
        if face == FLOOR_FACE and not mine.sum() > 50:
            values += [0.9, 1.1, 1.3, 1.5]
        if face == CEILING_FACE and mine.sum() < 20:
            values = []
        result.append([v for v in values if v > _MIN_DISTANCE_M] + [np.inf])
    return result


def _modes(along: NDArray[np.float64], count: int, bin_m: float = 0.025) -> list[float]:
    """Up to `count` strongest local maxima of the smoothed histogram of positive coordinates."""
    along = along[(along > _MIN_DISTANCE_M) & (along < 15.0)]
    if len(along) < 20:
        return []
    histogram = np.bincount((along / bin_m).astype(int), minlength=8).astype(float)
    kernel = np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2)
    smooth = np.convolve(histogram, kernel / kernel.sum(), mode="same")
    padded = np.concatenate([[0.0], smooth, [0.0]])
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]) & (smooth > 2.0))
    strongest = peaks[np.argsort(-smooth[peaks], kind="stable")][:count]
    return [float((i + 0.5) * bin_m) for i in strongest]


def _refine(
    seen: FitObservation, R: NDArray[np.float64], distances: NDArray[np.float64], costs: FitCosts
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Pattern search over three rotations and the finite distances, halving the steps."""
    best = fit_cost(seen, R, distances, costs)
    turn, shift = np.deg2rad(1.0), 0.06
    for _ in range(6):
        improved = True
        rounds = 0
        while improved and rounds < 4:
            improved, rounds = False, rounds + 1
            for k, sign in itertools.product(range(8), (-1.0, 1.0)):
                trial_R, trial = R, distances
                if k < 3:
                    trial_R = R @ rotation_from_vector(sign * turn * np.eye(3)[k])
                elif np.isfinite(distances[k - 3]):
                    trial = distances.copy()
                    trial[k - 3] = max(trial[k - 3] + sign * shift, _MIN_DISTANCE_M)
                else:
                    continue
                cost = fit_cost(seen, trial_R, trial, costs)
                if cost < best - 1e-7:
                    best, R, distances, improved = cost, trial_R, trial, True
        turn, shift = turn / 2, shift / 2
    return best, R, distances


def _as_fit(
    frame: RgbdFrame, seen: FitObservation, R: NDArray[np.float64], distances: NDArray[np.float64], cost: float
) -> LayoutFit:
    """Drop faces out of view and name the walls: front is the visible wall that faces the camera most."""
    U, _, Vt = np.linalg.svd(R)
    R = U @ Vt
    visible = np.isin(np.arange(1, 6), RoomCuboid(R, distances).raster(frame.camera))
    distances = np.where(visible, distances, np.inf)
    facing = np.where(visible, FACE_SIGN * R[FACE_AXIS, 2], -np.inf)[LEFT_FACE:]
    front = LEFT_FACE + int(facing.argmax())
    opposite = {LEFT_FACE: RIGHT_FACE, RIGHT_FACE: LEFT_FACE}
    if front in opposite and not visible[opposite[front]]:
        R, distances = _turned(R, distances, to_left=front == LEFT_FACE)
    cuboid = RoomCuboid(R, distances)
    return LayoutFit(cuboid, cuboid.raster(frame.camera), cost, _quality(seen, cuboid))


def _turned(
    R: NDArray[np.float64], distances: NDArray[np.float64], to_left: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same room with its left (or right) wall called front."""
    x, y, z = R
    ceiling, floor, left, front, right = distances
    if to_left:
        return np.stack([z, y, -x]), np.array([ceiling, floor, np.inf, left, front])
    return np.stack([-z, y, x]), np.array([ceiling, floor, front, right, np.inf])


def _quality(seen: FitObservation, cuboid: RoomCuboid, tolerance_m: float = 0.12) -> float:
    """Share of structural pixels on a face of their kind and within the tolerance of its plane."""
    value = seen.rays @ cuboid.inverse_normals.T
    face, inverse = value.argmax(axis=1), value.max(axis=1)
    kind = seen.kind
    structural = np.isin(kind, STRUCTURE)
    same = np.select(
        [kind == FitClass.FLOOR, kind == FitClass.CEILING],
        [face == FLOOR_FACE, face == CEILING_FACE],
        face >= LEFT_FACE,
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = cuboid.distances[face] * (inverse / seen.inverse_depth - 1.0)
        on_plane = np.abs(offset) < tolerance_m + 0.03 / seen.inverse_depth
    on_plane |= (kind == FitClass.OPENING) & (offset > 0)
    return float((same & on_plane)[structural].mean())
