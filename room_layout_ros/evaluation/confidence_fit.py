"""Calibration of the confidences on frames with known layouts (`room-layout calibrate`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.confidence import ConfidenceModel, Signs, face_rows, logistic
from ..core.estimate import RoomEstimate
from .calibration import face_iou
from .measures import score_pixels

_RIDGE = 1.0
LEAST_FRAMES = 30


@dataclass(frozen=True, slots=True)
class JudgedSigns:
    """The signs of one estimate, and what came true.

    Attributes
    ----------
    right : share of the layout's pixels right, wall names permuted to the best fit.
    in_view : (5,) bool faces of the estimate. iou : (5,) IoU of each with the truth.
    """

    signs: Signs
    right: float
    in_view: NDArray[np.bool_]
    iou: NDArray[np.float64]


def judge_signs(estimate: RoomEstimate, layout: NDArray[np.uint8]) -> JudgedSigns | None:
    """Compare an estimate with the true layout (H, W); None where it has no signs."""
    if estimate.signs is None:
        return None
    score = score_pixels(layout, estimate.layout)
    iou = np.array([face_iou(score.layout_confusion, score.wall_names[k]) for k in range(1, 6)])
    return JudgedSigns(estimate.signs, 1.0 - score.layout_error, np.isin(np.arange(1, 6), estimate.layout), iou)


def fit_confidence(judged: Sequence[JudgedSigns], card: Mapping[str, Any]) -> ConfidenceModel:
    """Fit both logistic functions: of the frame to the share of pixels right, of the faces to their IoU.

    Raises
    ------
    ValueError
        When there are fewer than 30 frames, or one of them says nothing that is right or wrong.
    """
    if len(judged) < LEAST_FRAMES:
        raise ValueError(f"{len(judged)} frames with estimate and layout are given; at least {LEAST_FRAMES} are needed")
    if unknown := sum(not np.isfinite(j.right) for j in judged):
        raise ValueError(f"{unknown} of {len(judged)} layouts have no annotated pixel; each needs one at least")
    frame = _fit(np.array([j.signs.frame for j in judged]), np.array([j.right for j in judged]))
    rows, iou = [], []
    for j in judged:
        table = face_rows(j.signs, float(logistic(j.signs.frame[None], frame)[0]))
        rows.append(table[j.in_view])
        iou.append(j.iou[j.in_view])
    return ConfidenceModel(frame, _fit(np.concatenate(rows), np.concatenate(iou)), card)


def _fit(rows: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logistic regression to targets in 0..1 by Newton's method; ridge on standardised columns."""
    mean, spread = rows.mean(axis=0), rows.std(axis=0)
    spread[spread < 1e-9] = np.inf  # a sign that never changes says nothing
    X = np.column_stack([(rows - mean) / spread, np.ones(len(rows))])
    ridge = np.diag([_RIDGE] * rows.shape[1] + [0.0])
    w = np.zeros(X.shape[1])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-(X @ w)))
        gradient = X.T @ (p - target) + ridge @ w
        hessian = (X * (p * (1.0 - p) + 1e-9)[:, None]).T @ X + ridge
        w -= np.linalg.solve(hessian, gradient)
    slope = w[:-1] / spread
    return np.append(slope, w[-1] - float(slope @ np.where(np.isfinite(spread), mean, 0.0)))
