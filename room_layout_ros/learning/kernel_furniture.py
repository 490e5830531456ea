"""Training of furniture by kernel descriptors: linear classifiers chosen by cross-validation (docs/learning.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from ..core.config import EstimatorConfig
from ..core.evidence.kernel_descriptors import DESCRIPTORS
from ..core.evidence.match_kernels import Floats
from ..core.furniture import group_furniture
from ..core.kernel_furniture import (
    SETS,
    KernelFurnitureModel,
    LinearClassifier,
    columns_of,
    save_kernel_furniture,
)
from ..core.labels import N_CLUTTER_CLASSES, N_FURNITURE
from ..datasets.folder import FramesFolder
from ..datasets.sample import good_samples
from .folds import MARGIN, folds_of, is_near
from .kernel_rows import ClutterRows, WordSettings, collect_rows, learn_words
from .linear_svm import fit_one_vs_rest

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class KernelSettings:
    """How the classifiers are learned.

    Attributes
    ----------
    words : how visual words are made. word_frames : from how many frames.
    degraded_every : every how many-th frame is learned from again with degraded depth.
    C, balance, scale, other : what the cross-validation tries (`Choice`), C and balance for superpixels with colour
    and depth only; the other classifiers take them over. folds : of it.
    passes : of the optimiser. seed : of the degraded depth.
    """

    words: WordSettings = field(default_factory=WordSettings)
    word_frames: int = 100
    degraded_every: int = 6
    C: tuple[float, ...] = (30.0, 100.0, 300.0)
    balance: tuple[float, ...] = (0.25, 0.5, 0.75)
    scale: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0)
    other: tuple[float, ...] = (-1.0, -0.5, 0.0, 0.5)
    folds: int = 3
    passes: int = 80
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Choice:
    """What cross-validation chooses.

    Attributes
    ----------
    C : weight of the loss. balance : power by which rare classes weigh more, 0 not at all, 1 as much as common ones.
    scale : of the scores before the softmax. other : what the score of "other" gets besides.
    """

    C: float
    balance: float
    scale: float = 1.0
    other: float = 0.0


def train_kernel_furniture(
    source: FramesFolder,
    out: Path,
    held_out: Sequence[str] = (),
    settings: KernelSettings | None = None,
    facts: Mapping[str, Any] | None = None,
    say: Say = lambda _: None,
) -> KernelFurnitureModel:
    """Learn words and classifiers from a folder of labelled frames and write the model.

    The same data, arguments and libraries give the same bytes.

    Parameters
    ----------
    source : frames with colour, depth and NYU40 labels.
    out : file to write (.npz).
    held_out : names of frames to keep out, with their neighbours (`folds.is_near`).
    settings : by default those that ship.
    facts : more for the card (command, date).
    """
    settings = settings or KernelSettings()
    about = asdict(settings)
    names = tuple(n for n, near in zip(source.names, is_near(source.names, held_out), strict=True) if not near)
    say(f"{len(names)} frames; words from {min(len(names), settings.word_frames)}")
    some = names[:: max(1, len(names) // settings.word_frames)]
    descriptors = learn_words(good_samples(source.subset(some)), settings.words)
    classifiers, tables = dict[str, LinearClassifier](), dict[str, Any]()
    shares = np.ones(N_CLUTTER_CLASSES)
    for with_depth, sets in ((True, ("color_depth", "depth")), (False, ("color",))):
        say(f"describing them {'with' if with_depth else 'without'} depth")
        config = EstimatorConfig(use_depth=with_depth)
        samples = good_samples(source.subset(names))
        rows = collect_rows(samples, descriptors, config, settings.degraded_every, settings.seed)
        for name in sets:
            columns = columns_of(descriptors, SETS[name])
            choice, tables[name] = choose(rows, columns, settings)
            settings = replace(settings, C=(choice.C,), balance=(choice.balance,))
            say(f"{name}: {choice}, of {tables[name]}")
            classifiers[name] = fit(rows, columns, choice, settings.passes)
        if with_depth:
            shares += sum(frame.counts.sum(axis=0, dtype=np.float64) for frame in rows if not frame.degraded)
    card = {
        "frames": len(names),
        "source": source.path.name,
        "held_out": list(held_out),
        "margin": MARGIN,
        "settings": about,
        "cross_validation": tables,
        **(facts or {}),
    }
    model = KernelFurnitureModel(descriptors, classifiers, (shares / shares.sum()).astype(np.float32), card)
    save_kernel_furniture(model, out)
    return model


def choose(
    rows: Sequence[ClutterRows], columns: NDArray[np.intp], settings: KernelSettings
) -> tuple[Choice, list[dict[str, Any]]]:
    """Choose by mean IoU over frames that a classifier has not seen, neighbours neither; true clutter is given.

    Returns
    -------
    Choice
    list of dict
        The table: for each C and balance the best scale and prior of "other", and IoU in percent.
    """
    table: list[dict[str, Any]] = []
    best, best_mean = Choice(settings.C[0], settings.balance[0]), -1.0
    for C, balance in product(settings.C, settings.balance):
        judged = list(_out_of_fold(rows, columns, Choice(C, balance), settings))
        found = [(*so, _ious(judged, *so)) for so in product(settings.scale, settings.other)]
        scale, other, ious = max(found, key=lambda row: float(np.nanmean(row[2])))
        mean = round(float(np.nanmean(ious)), 2)
        per_class = [None if np.isnan(x) else round(float(x), 1) for x in ious]
        table.append({"C": C, "balance": balance, "scale": scale, "other": other, "mean": mean, "iou": per_class})
        if mean > best_mean:
            best, best_mean = Choice(C, balance, scale, other), mean
    return best, table


def _out_of_fold(
    rows: Sequence[ClutterRows], columns: NDArray[np.intp], choice: Choice, settings: KernelSettings
) -> Iterator[tuple[ClutterRows, Floats]]:
    """Frames as recorded, with scores (K, 7) of classifiers that saw no neighbour; NaN where nothing is known."""
    for learned, held in folds_of([frame.name for frame in rows], settings.folds):
        one = fit([rows[i] for i in learned], columns, choice, settings.passes)
        for frame in (rows[i] for i in held if not rows[i].degraded):
            yield frame, frame.features[:, columns] @ one.weights.T + one.intercepts


def _ious(judged: Sequence[tuple[ClutterRows, Floats]], scale: float, other: float) -> NDArray[np.float64]:
    """(6,) IoU in percent of each class after grouping; NaN where it is in no frame."""
    both, either = np.zeros(N_CLUTTER_CLASSES), np.zeros(N_CLUTTER_CLASSES)
    for frame, scores in judged:
        raised = np.nan_to_num(scale * scores.astype(np.float64)) + np.append(np.zeros(N_FURNITURE), other)
        probability = group_furniture(frame.superpixels, frame.clutter, np.asarray(softmax(raised, axis=1)))
        chosen = probability.argmax(axis=1)[:, None] == np.arange(N_CLUTTER_CLASSES)
        both += (frame.counts * chosen).sum(axis=0)
        either += frame.counts.sum(axis=0) + (frame.counts.sum(axis=1)[:, None] * chosen).sum(axis=0)
    either -= both
    return 100.0 * np.divide(both, either, out=np.full(N_CLUTTER_CLASSES, np.nan), where=either > 0)[:-1]


def fit(rows: Sequence[ClutterRows], columns: NDArray[np.intp], choice: Choice, passes: int) -> LinearClassifier:
    """Fit the classifier to all superpixels of which these columns are known.

    A superpixel has the class of most of its pixels and weighs as much as it has pixels. Columns are brought to the
    same variance; that, `scale` and `other` go into the weights.

    Raises
    ------
    ValueError
        When no superpixel has all columns.
    """
    features = np.concatenate([frame.features[:, columns] for frame in rows])
    counts = np.concatenate([frame.counts for frame in rows])
    known = np.isfinite(features).all(axis=1) & (counts.sum(axis=1) > 0)
    if not known.any():
        raise ValueError(f"of {len(rows)} frames no clutter can be described; frames with colour and depth are needed")
    features, counts = features[known], counts[known]
    mean, spread = features.mean(axis=0, dtype=np.float64), features.std(axis=0, dtype=np.float64)
    spread = np.maximum(spread, 1e-6) * np.sqrt(len(columns) / len(DESCRIPTORS))
    classes, weight = counts.argmax(axis=1), counts.sum(axis=1, dtype=np.float64)
    total = np.bincount(classes, weight, N_CLUTTER_CLASSES)
    weight *= (weight.sum() / np.maximum(total, 1.0))[classes] ** choice.balance
    even = ((features - mean) / spread).astype(np.float32)
    weights, intercepts = fit_one_vs_rest(even, classes, N_CLUTTER_CLASSES, weight / weight.sum(), choice.C, passes)
    scaled = choice.scale * weights / spread
    shifted = choice.scale * intercepts - scaled @ mean
    shifted[-1] += choice.other
    return LinearClassifier(scaled.astype(np.float32), shifted.astype(np.float32))
