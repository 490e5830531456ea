"""Is a stated confidence what comes true? Of frames, and of single faces."""

from __future__ import annotations

import numpy as np

from .measures import Confusion, Reliability, reliability
from .scores import SetScore


def frame_reliability(score: SetScore) -> Reliability | None:
    """Return confidence against the share of layout pixels right; None where the method states none."""
    pairs = [(f.confidence, 1.0 - f.pixels.layout_error) for f in score.frames]
    return _reliability(pairs)


def face_reliability(score: SetScore) -> Reliability | None:
    """Return confidence of each face in the estimate against the face's IoU in the layout."""
    pairs = []
    for frame in score.frames:
        for k, confidence in enumerate(frame.face_confidence):
            face = frame.pixels.wall_names[k + 1]  # the layout's confusion is under the truth's wall names
            if confidence > 0:
                pairs.append((float(confidence), face_iou(frame.pixels.layout_confusion, face)))
    return _reliability(pairs)


def face_iou(counts: Confusion, face: int) -> float:
    """Return the IoU of one face of one layout; 0 where the truth has no such face."""
    union = counts[face].sum() + counts[:, face].sum() - counts[face, face]
    return float(counts[face, face] / union) if union else 0.0


def _reliability(pairs: list[tuple[float, float]]) -> Reliability | None:
    values = np.array(pairs, np.float64).reshape(-1, 2)
    values = values[np.isfinite(values).all(axis=1)]
    return reliability(values[:, 0], values[:, 1]) if len(values) else None
