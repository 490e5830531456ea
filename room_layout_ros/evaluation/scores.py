"""Scores of a frame and of a set of frames by one method."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.labels import FURNITURE_IDS, LABEL_NAMES, N_FURNITURE
from room_layout_ros.datasets import Sample

from . import calibration, measures
from .geometry import corner_error
from .prediction import Prediction
from .room_scores import RoomScore, score_room

Method = Callable[[Sample], Prediction]
LABELS = LABEL_NAMES[1:]
BOOTSTRAP_SEED = 2013
"""The same draws of frames for every method and figure."""


@dataclass(frozen=True, slots=True)
class FrameScore:
    """One frame's measures; NaN where the truth or the prediction is missing.

    Attributes
    ----------
    corner_error : in image diagonals. room : in metres and degrees.
    furniture : (6, 2) int64 pixels of (intersection, union) per class; 0 where the method says nothing of furniture.
    """

    name: str
    status: str
    pixels: measures.PixelScore
    corner_error: float
    room: RoomScore
    furniture: NDArray[np.int64]
    confidence: float
    face_confidence: NDArray[np.float64]
    milliseconds: float


PER_FRAME: Mapping[str, Callable[[FrameScore], float]] = {
    "layout_error": lambda frame: frame.pixels.layout_error,
    "layout_error_fixed_names": lambda frame: frame.pixels.layout_error_fixed,
    "labelling_error": lambda frame: frame.pixels.labelling_error,
    "labelling_error_fixed_names": lambda frame: frame.pixels.labelling_error_fixed,
    "corner_error": lambda frame: frame.corner_error,
    "plane_offset_m": lambda frame: frame.room.plane_offset_m,
    "plane_angle_deg": lambda frame: frame.room.plane_angle_deg,
    "planes_found": lambda frame: frame.room.planes_found,
    "axes_error_deg": lambda frame: frame.room.axes_error_deg,
    "room_iou": lambda frame: frame.room.room_iou,
    "free_space_iou": lambda frame: frame.room.free_space_iou,
}
"""What a frame has one number of; the figure of a set is its mean over the frames that have it."""

FIXED = "_fixed_names"
"""End of the name of a figure with the wall names as they are; those without it have them permuted to the best fit."""

ROOM_FIGURES = tuple(PER_FRAME)[5:]
"""Those in three dimensions."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A number of the set with the ends of its 95 % bootstrap interval over the frames; all NaN where there is none."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class SetScore:
    """All frames of one method, and the numbers of the set. Errors and IoU are shares, 0..1."""

    title: str
    frames: tuple[FrameScore, ...]

    @property
    def without_estimate(self) -> int:
        """Frames for which the method had no answer; they count as wrong in every pixel."""
        return sum(frame.status != "ok" for frame in self.frames)

    def per_frame(self, name: str) -> NDArray[np.float64]:
        """Return (n,) one of `PER_FRAME`."""
        return np.array([PER_FRAME[name](frame) for frame in self.frames], np.float64)

    @property
    def layout_errors(self) -> NDArray[np.float64]:
        """(n,) wall names permuted to the best fit."""
        return self.per_frame("layout_error")

    @property
    def labelling_errors(self) -> NDArray[np.float64]:
        """(n,) walls permuted as the layout's."""
        return self.per_frame("labelling_error")

    @property
    def confusions(self) -> NDArray[np.int64]:
        """(n, 7, 7) of the labelling, walls permuted as the layout's."""
        return np.array([frame.pixels.labels_confusion for frame in self.frames])

    @property
    def confusions_fixed(self) -> NDArray[np.int64]:
        """(n, 7, 7) of the labelling, wall names as they are."""
        return np.array([frame.pixels.labels_confusion_fixed for frame in self.frames])

    @property
    def milliseconds(self) -> float:
        """Median over the frames that have a time."""
        known = [f.milliseconds for f in self.frames if np.isfinite(f.milliseconds)]
        return float(np.median(known)) if known else float("nan")

    @cached_property
    def figures(self) -> Mapping[str, Figure]:
        """Every number of the set by name.

        `PER_FRAME`; mean_iou and iou.LABEL as PASCAL, walls permuted; mean_iou_fixed_names and
        iou_fixed_names.LABEL with the names as they are; mean_furniture_iou and furniture_iou.NYU40 likewise;
        frame_ece and face_ece, the calibration errors.
        """
        found = {name: mean_figure(self.per_frame(name)) for name in PER_FRAME}
        for confusions, end in ((self.confusions, ""), (self.confusions_fixed, FIXED)):
            found |= _figures(confusions, _ious, (f"mean_iou{end}", *(f"iou{end}.{label}" for label in LABELS)))
        furniture = np.array([frame.furniture for frame in self.frames])
        names = ("mean_furniture_iou", *(f"furniture_iou.{k}" for k in FURNITURE_IDS))
        found |= _figures(furniture, _furniture_ious, names)
        found |= _figures(calibration.frame_pairs(self), calibration.calibration_error, ("frame_ece",))
        return found | _figures(calibration.face_pairs(self), calibration.calibration_error, ("face_ece",))


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
    pixels = measures.score_pixels(truth.layout, prediction.layout, truth.labels, prediction.labels)
    return FrameScore(
        name=sample.name,
        status=prediction.status,
        pixels=pixels,
        corner_error=corner_error(truth.layout, prediction.layout),
        room=score_room(sample, prediction),
        furniture=_furniture(truth.furniture, truth.labels40, prediction.furniture),
        confidence=prediction.confidence,
        face_confidence=prediction.face_confidence,
        milliseconds=math.nan if prediction.milliseconds is None else prediction.milliseconds,
    )


def run(title: str, method: Method, samples: Iterable[Sample]) -> SetScore:
    """Apply a method to every sample and score it; the time of each call is taken where it gives none."""
    scores = []
    for sample in samples:
        start = time.perf_counter()
        prediction = method(sample)
        if prediction.milliseconds is None:
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


def mean_figure(values: NDArray[np.float64]) -> Figure:
    """Return the mean of (n,) values of frames; those that are NaN are left out."""
    known = values[np.isfinite(values)]
    return _figures(known, lambda v: float(v.mean()), ("mean",))["mean"] if len(known) else Figure(*3 * [np.nan])


def _figures(
    per_frame: NDArray[measures.N],
    statistic: Callable[[NDArray[measures.N]], float | NDArray[np.float64]],
    names: tuple[str, ...],
) -> dict[str, Figure]:
    low, high = measures.bootstrap_interval(per_frame, statistic, np.random.default_rng(BOOTSTRAP_SEED))
    rows = zip(names, np.ravel(statistic(per_frame)), low.ravel(), high.ravel(), strict=True)
    return {name: Figure(float(value), float(a), float(b)) for name, value, a, b in rows}


def _ious(confusions: NDArray[np.int64]) -> NDArray[np.float64]:
    counts = confusions.sum(axis=0)
    return np.append(measures.mean_iou(counts), measures.iou_per_class(counts))


def _furniture_ious(furniture: NDArray[np.int64]) -> NDArray[np.float64]:
    both, either = furniture.sum(axis=0).T.astype(np.float64)
    values = np.divide(both, either, out=np.full(N_FURNITURE, np.nan), where=either > 0)
    return np.append(np.nanmean(values) if np.isfinite(values).any() else np.nan, values)
