"""Scores of a frame and of a set of frames by one method."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.labels import FURNITURE_NYU40
from room_layout_ros.datasets import Sample

from . import measures
from .geometry import corner_error
from .prediction import Prediction

Method = Callable[[Sample], Prediction]
FURNITURE_IDS = tuple(FURNITURE_NYU40)
N_FURNITURE = len(FURNITURE_IDS)


@dataclass(frozen=True, slots=True)
class FrameScore:
    """One frame's measures; NaN where the truth or the prediction is missing.

    Attributes
    ----------
    corner_error : in image diagonals. furniture : (6, 2) int64 pixels of (intersection, union) per class.
    """

    name: str
    status: str
    pixels: measures.PixelScore
    corner_error: float
    furniture: NDArray[np.int64]
    confidence: float
    face_confidence: NDArray[np.float64]
    milliseconds: float


@dataclass(frozen=True, slots=True)
class SetScore:
    """All frames of one method, and the numbers of the set. Errors and IoU are shares, 0..1."""

    title: str
    frames: tuple[FrameScore, ...]

    @property
    def without_estimate(self) -> int:
        """Frames for which the method had no answer; they count as wrong in every pixel."""
        return sum(frame.status != "ok" for frame in self.frames)

    @property
    def layout_errors(self) -> NDArray[np.float64]:
        """(n,) wall names permuted to the best fit."""
        return np.array([frame.pixels.layout_error for frame in self.frames])

    @property
    def layout_errors_fixed(self) -> NDArray[np.float64]:
        """(n,) wall names as they are."""
        return np.array([frame.pixels.layout_error_fixed for frame in self.frames])

    @property
    def labelling_errors(self) -> NDArray[np.float64]:
        """(n,) walls permuted as the layout's."""
        return np.array([frame.pixels.labelling_error for frame in self.frames])

    @property
    def corner_errors(self) -> NDArray[np.float64]:
        """(n,) in image diagonals."""
        return np.array([frame.corner_error for frame in self.frames])

    @property
    def confusions(self) -> NDArray[np.int64]:
        """(n, 7, 7) of the labelling."""
        return np.array([frame.pixels.labels_confusion for frame in self.frames])

    @property
    def iou(self) -> NDArray[np.float64]:
        """(6,) per label, summed over the set."""
        return measures.iou_per_class(self.confusions.sum(axis=0))

    @property
    def mean_iou(self) -> float:
        """Mean of `iou`."""
        return measures.mean_iou(self.confusions.sum(axis=0))

    @property
    def furniture_iou(self) -> NDArray[np.float64]:
        """(6,) per furniture class, summed over the set; NaN for classes that never occur."""
        both, either = np.sum([frame.furniture for frame in self.frames], axis=0).T
        return np.asarray(np.divide(both, either, out=np.full(N_FURNITURE, np.nan), where=either > 0))

    def intervals(self, rng: np.random.Generator) -> dict[str, tuple[float, float]]:
        """Return the 95 % bootstrap intervals over the frames: layout, labelling, iou."""
        return {
            "layout": measures.bootstrap_interval(self.layout_errors, _mean, rng),
            "labelling": measures.bootstrap_interval(self.labelling_errors, _mean, rng),
            "iou": measures.bootstrap_interval(self.confusions, lambda c: measures.mean_iou(c.sum(axis=0)), rng),
        }


def score_frame(sample: Sample, prediction: Prediction) -> FrameScore:
    """Compare a prediction with the sample's truth.

    Raises
    ------
    ValueError
        When the sample has no true layout, or shapes differ.
    """
    truth = sample.truth
    if truth is None or truth.layout is None:
        raise ValueError(f"frame {sample.name} has no true layout; only frames with layout/NAME.png can be scored")
    return FrameScore(
        name=sample.name,
        status=prediction.status,
        pixels=measures.score_pixels(truth.layout, prediction.layout, truth.labels, prediction.labels),
        corner_error=corner_error(truth.layout, prediction.layout),
        furniture=_furniture(truth.furniture, truth.labels40, prediction.furniture),
        confidence=prediction.confidence,
        face_confidence=prediction.face_confidence,
        milliseconds=prediction.milliseconds,
    )


def run(title: str, method: Method, samples: Iterable[Sample]) -> SetScore:
    """Apply a method to every sample and score it; the time of each call is taken where it gives none."""
    scores = []
    for sample in samples:
        start = time.perf_counter()
        prediction = method(sample)
        if np.isnan(prediction.milliseconds):
            prediction = replace(prediction, milliseconds=1e3 * (time.perf_counter() - start))
        scores.append(score_frame(sample, prediction))
    return SetScore(title, tuple(scores))


def _furniture(
    truth: NDArray[np.uint8] | None, labels40: NDArray[np.uint8] | None, estimate: NDArray[np.uint8] | None
) -> NDArray[np.int64]:
    counts = np.zeros((N_FURNITURE, 2), np.int64)
    if truth is None or labels40 is None or estimate is None:
        return counts
    labelled = labels40 > 0
    for k, label in enumerate(FURNITURE_IDS):
        a, b = (truth == label) & labelled, (estimate == label) & labelled
        counts[k] = np.count_nonzero(a & b), np.count_nonzero(a | b)
    return counts


def _mean(values: NDArray[np.float64]) -> float:
    return float(np.nanmean(values))
