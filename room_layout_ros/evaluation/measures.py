"""How wrong is an estimate: pixel measures, wall names, PASCAL IoU, calibration, bootstrap (docs/method.md, 11)."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.labels import LABEL_NAMES, N_LABELS, WALL_IDS

N_IDS = len(LABEL_NAMES)

N = TypeVar("N", np.float64, np.int64)

Confusion = NDArray[np.int64]
"""(7, 7) pixel counts; rows are the true id, columns the estimated one. Row 0 (no truth) is always empty."""


def confusion(truth: NDArray[np.uint8], estimate: NDArray[np.uint8]) -> Confusion:
    """Count pixels by (true id, estimated id); pixels without truth (0) are ignored.

    Raises
    ------
    ValueError
        When the shapes differ or an id is above 6.
    """
    _check_same_shape("true image", truth, "estimated image", estimate)
    for what, image in (("true", truth), ("estimated", estimate)):
        if image.size and image.max() >= N_IDS:
            raise ValueError(f"the {what} image holds id {image.max()}; allowed is 0 to {N_IDS - 1}")
    pairs = truth.ravel().astype(np.intp) * N_IDS + estimate.ravel()
    counts = np.bincount(pairs, minlength=N_IDS * N_IDS).reshape(N_IDS, N_IDS)
    counts[0] = 0
    return counts.astype(np.int64)


def error(counts: Confusion) -> float:
    """Return the share of wrong pixels, 0..1 (NaN without a pixel of truth). An estimate of 0 is wrong."""
    total = counts.sum()
    return float(1.0 - np.trace(counts) / total) if total else float("nan")


def wall_permutations() -> list[tuple[int, ...]]:
    """Return the six renamings of the walls as tables new_id = table[id]; the identity comes first."""
    tables = []
    for names in itertools.permutations(WALL_IDS):
        table = list(range(N_IDS))
        for wall, name in zip(WALL_IDS, names, strict=True):
            table[wall] = name
        tables.append(tuple(table))
    return sorted(tables, key=lambda table: sum(a != b for a, b in enumerate(table)))


def rename(counts: Confusion, table: tuple[int, ...]) -> Confusion:
    """Return the confusion after the estimate's ids were renamed by `table`."""
    old_of_new = np.argsort(table)
    return np.asarray(counts[:, old_of_new])


def best_wall_names(counts: Confusion) -> tuple[int, ...]:
    """Return the renaming of the estimate's walls with the least error; the fewest changes among equals.

    Which of two visible walls is "front" is the annotator's guess, so a layout is scored up to these names.
    """
    return min(wall_permutations(), key=lambda table: error(rename(counts, table)))


@dataclass(frozen=True, slots=True)
class PixelScore:
    """Pixel measures of one frame.

    Attributes
    ----------
    layout_error_fixed, layout_error : share of wrong layout pixels with the wall names as they are, and
        permuted to the best fit.
    labelling_error_fixed, labelling_error : the same of the labelled pixels, walls permuted as the layout's.
        NaN without a true labelling.
    layout_confusion, labels_confusion : (7, 7) counts after the renaming. labels_confusion_fixed : before it.
    wall_names : the renaming.
    """

    layout_error_fixed: float
    layout_error: float
    labelling_error_fixed: float
    labelling_error: float
    layout_confusion: Confusion
    labels_confusion: Confusion
    labels_confusion_fixed: Confusion
    wall_names: tuple[int, ...]


def score_pixels(
    true_layout: NDArray[np.uint8],
    layout: NDArray[np.uint8],
    true_labels: NDArray[np.uint8] | None = None,
    labels: NDArray[np.uint8] | None = None,
) -> PixelScore:
    """Compare one frame's layout (and label image) with the truth.

    Raises
    ------
    ValueError
        When shapes differ or ids are out of range.
    """
    layout_counts = confusion(true_layout, layout)
    label_counts = np.zeros_like(layout_counts)
    if true_labels is not None and labels is not None:
        label_counts = confusion(true_labels, labels)
    names = best_wall_names(layout_counts)
    layout_named, labels_named = rename(layout_counts, names), rename(label_counts, names)
    return PixelScore(
        layout_error_fixed=error(layout_counts),
        layout_error=error(layout_named),
        labelling_error_fixed=error(label_counts),
        labelling_error=error(labels_named),
        layout_confusion=layout_named,
        labels_confusion=labels_named,
        labels_confusion_fixed=label_counts,
        wall_names=names,
    )


def iou_per_class(counts: Confusion) -> NDArray[np.float64]:
    """Return (6,) intersection over union of ids 1..6 from summed counts, as PASCAL; NaN for an absent class."""
    hit = np.diagonal(counts)[1 : N_LABELS + 1].astype(np.float64)
    union = counts.sum(axis=0)[1:] + counts.sum(axis=1)[1:] - hit
    return np.asarray(np.divide(hit, union, out=np.full(N_LABELS, np.nan), where=union > 0))


def mean_iou(counts: Confusion) -> float:
    """Return the mean of `iou_per_class` over the classes that occur (NaN when none does)."""
    values = iou_per_class(counts)
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


@dataclass(frozen=True, slots=True)
class Reliability:
    """Confidence against what came true, in equal-width bins.

    Attributes
    ----------
    edges : (B + 1,). count, confidence, accuracy : (B,) per bin; NaN means in empty bins.
    ece : expected calibration error, sum over bins of share * |accuracy - confidence|.
    """

    edges: NDArray[np.float64]
    count: NDArray[np.int64]
    confidence: NDArray[np.float64]
    accuracy: NDArray[np.float64]
    ece: float


def reliability(confidence: NDArray[np.float64], correct: NDArray[np.float64], bins: int = 10) -> Reliability:
    """Compare stated confidence with correctness.

    Parameters
    ----------
    confidence : (n,) float64 array
        0..1.
    correct : (n,) float64 array
        1 right, 0 wrong, or a share between them (of a frame's pixels, say).
    bins : int
        Equal-width bins over 0..1; a value of 1 falls into the last.

    Raises
    ------
    ValueError
        When there is no value, shapes differ, or a value is outside 0..1 or NaN.
    """
    confidence, correct = np.asarray(confidence, np.float64), np.asarray(correct, np.float64)
    _check_same_shape("confidence", confidence, "correctness", correct)
    if not confidence.size:
        raise ValueError("calibration of 0 values was asked for; at least one is needed")
    for what, values in (("confidence", confidence), ("correctness", correct)):
        if not ((values >= 0) & (values <= 1)).all():
            raise ValueError(f"{what} spans {values.min()} to {values.max()}; allowed is 0 to 1")
    index = np.minimum((confidence * bins).astype(np.intp), bins - 1)
    count = np.bincount(index, minlength=bins)
    empty = np.full(bins, np.nan)
    mean_confidence = np.divide(np.bincount(index, confidence, bins), count, out=empty.copy(), where=count > 0)
    accuracy = np.divide(np.bincount(index, correct, bins), count, out=empty.copy(), where=count > 0)
    ece = float(np.nansum(count * np.abs(accuracy - mean_confidence)) / count.sum())
    return Reliability(np.linspace(0, 1, bins + 1), count.astype(np.int64), mean_confidence, accuracy, ece)


def bootstrap_interval(
    per_frame: NDArray[N],
    statistic: Callable[[NDArray[N]], float | NDArray[np.float64]],
    rng: np.random.Generator,
    level: float = 0.95,
    draws: int = 1000,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ends of the percentile bootstrap interval of a statistic of the set, in the statistic's shape.

    Parameters
    ----------
    per_frame : (n, ...) array
        One entry a frame (an error, a confusion matrix); frames are drawn with replacement.
    statistic : callable
        Maps (n, ...) to a number, or to several at once; draws in which it is NaN are left out.
    rng : numpy.random.Generator
        Source of the draws.

    Raises
    ------
    ValueError
        When there is no frame.
    """
    if not len(per_frame):
        raise ValueError("a bootstrap of 0 frames was asked for; at least one is needed")
    picks = rng.integers(0, len(per_frame), size=(draws, len(per_frame)))
    values = np.array([statistic(per_frame[pick]) for pick in picks], np.float64)
    columns = values.reshape(draws, -1)
    ends = np.full((2, columns.shape[1]), np.nan)
    known = np.isfinite(columns).any(axis=0)
    ends[:, known] = np.nanquantile(columns[:, known], [(1 - level) / 2, (1 + level) / 2], axis=0)
    low, high = ends.reshape(2, *values.shape[1:])
    return np.asarray(low), np.asarray(high)


def _check_same_shape(name: str, a: NDArray[np.generic], other: str, b: NDArray[np.generic]) -> None:
    if a.shape != b.shape:
        raise ValueError(f"{name} has shape {a.shape} and {other} {b.shape}; they must be the same")
