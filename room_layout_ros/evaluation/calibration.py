"""Is a stated confidence what comes true? Of frames, and of single faces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .measures import Confusion, Reliability, reliability

if TYPE_CHECKING:
    from .scores import SetScore

Pairs = NDArray[np.float64]
"""(n, k, 2) of n frames: k stated confidences with what came true; NaN where none is stated."""


def frame_pairs(score: SetScore) -> Pairs:
    """Return (n, 1, 2): confidence of each frame with its share of layout pixels right."""
    return np.array([[[f.confidence, 1.0 - f.pixels.layout_error]] for f in score.frames], np.float64)


def face_pairs(score: SetScore) -> Pairs:
    """Return (n, 5, 2): confidence of each face in the estimate with the face's IoU in the layout."""
    pairs = np.full((len(score.frames), 5, 2), np.nan)
    for row, frame in zip(pairs, score.frames, strict=True):
        for k, confidence in enumerate(frame.face_confidence):
            face = frame.pixels.wall_names[k + 1]  # the layout's confusion is under the truth's wall names
            if confidence > 0:
                row[k] = confidence, face_iou(frame.pixels.layout_confusion, face)
    return pairs


def pairs_reliability(pairs: Pairs) -> Reliability | None:
    """Return the reliability over all stated confidences; None where none is."""
    values = pairs.reshape(-1, 2)
    values = values[np.isfinite(values).all(axis=1)]
    return reliability(values[:, 0], values[:, 1]) if len(values) else None


def calibration_error(pairs: Pairs) -> float:
    """Return the expected calibration error over all stated confidences; NaN where none is."""
    found = pairs_reliability(pairs)
    return float("nan") if found is None else found.ece


def frame_reliability(score: SetScore) -> Reliability | None:
    """Return confidence against the share of layout pixels right; None where the method states none."""
    return pairs_reliability(frame_pairs(score))


def face_reliability(score: SetScore) -> Reliability | None:
    """Return confidence of each face in the estimate against the face's IoU in the layout."""
    return pairs_reliability(face_pairs(score))


def face_iou(counts: Confusion, face: int) -> float:
    """Return the IoU of one face of one layout; 0 where the truth has no such face."""
    union = counts[face].sum() + counts[:, face].sum() - counts[face, face]
    return float(counts[face, face] / union) if union else 0.0
