"""Training of the joint model's weights, end to end: descriptions, out-of-fold context, examples, structured SVM."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.evidence.features import SuperpixelFeatures
from ..core.evidence.geometric_context import compute_geometric_context
from ..core.labels import N_LABELS, STRUCTURE_NYU40
from ..core.weights import VARIANTS, ModelWeights, start_weights
from .context import ContextSettings, grow
from .context_table import ContextTable
from .frank_wolfe import learn_frank_wolfe
from .joint_examples import FrameDescription, JointExample, build_example
from .joint_oracle import JointOracle, active_features, predict_loss
from .losses import JointLoss
from .oracle import LocalSeparator, Separator
from .structured_svm import SvmConfig, SvmProgress, SvmResult, learn_one_slack

MARGIN = 5
"""Frames whose numbers differ by this or less may show the same room (docs/data.md)."""

_ORACLE_STARTS, _ORACLE_ALTERNATIONS = 1, 3
"""Of loss-augmented inference, beside the start from the truth: half the time of the estimator's own settings."""


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """What is learned and how.

    Attributes
    ----------
    svm : of the learning. folds : of the context classifier. algorithm : "one-slack" or "frank-wolfe".
    context : of the forests. seed : of Frank-Wolfe's order.
    """

    svm: SvmConfig = field(default_factory=SvmConfig)
    folds: int = 4
    algorithm: str = "frank-wolfe"
    context: ContextSettings = field(default_factory=ContextSettings)
    seed: int = 0


def context_table(descriptions: Sequence[FrameDescription]) -> ContextTable:
    """Return features and truth of the superpixels of all frames, as the context classifier learns from them.

    Raises
    ------
    ValueError
        When there is no frame.
    """
    if not descriptions:
        raise ValueError("no frame to learn from: none has a fitted room, classes and usable axes")
    structural = np.zeros(41, np.float32)
    structural[list(STRUCTURE_NYU40)] = 1.0
    classes = np.concatenate([d.class_counts() for d in descriptions])
    sizes = [d.superpixels.count for d in descriptions]
    return ContextTable(
        features=np.concatenate([d.features.values for d in descriptions]),
        names=descriptions[0].features.names,
        labels=np.concatenate([d.label_counts() for d in descriptions]),
        structure=classes @ structural,
        classes=classes,
        frame=np.repeat(np.array(frame_numbers([d.name for d in descriptions]), np.int64), sizes),
        variant=np.zeros(sum(sizes), np.int8),
    )


def frame_numbers(names: Sequence[str]) -> list[int]:
    """Return the numbers of frames by which neighbours are told: the names where they are numbers, else the order."""
    return [int(name) if name.isdigit() else i for i, name in enumerate(names)]


def folds_of(names: Sequence[str], folds: int) -> Iterator[tuple[list[int], list[int]]]:
    """Yield (train, validate) positions: blocks of frame numbers with `MARGIN` numbers between them.

    Raises
    ------
    ValueError
        When there are fewer frames than folds or less than two folds.
    """
    if not 2 <= folds <= len(names):
        raise ValueError(f"folds is {folds}; 2 to the number of frames ({len(names)}) are possible")
    numbers = np.array(frame_numbers(names))
    for block in np.array_split(np.unique(numbers), folds):
        held = (numbers >= block[0]) & (numbers <= block[-1])
        near = (numbers >= block[0] - MARGIN) & (numbers <= block[-1] + MARGIN)
        yield np.flatnonzero(~near).tolist(), np.flatnonzero(held).tolist()


def out_of_fold_context(
    descriptions: Sequence[FrameDescription], config: TrainConfig, progress: Callable[[str], object] = print
) -> list[NDArray[np.float64]]:
    """Return (K, 6) probabilities per frame, each by forests that saw neither it nor its neighbours."""
    table = context_table(descriptions)
    starts = np.cumsum([0] + [d.superpixels.count for d in descriptions])
    result: list[NDArray[np.float64]] = [np.full((d.superpixels.count, N_LABELS), 1.0 / N_LABELS) for d in descriptions]
    for number, (train, validate) in enumerate(folds_of([d.name for d in descriptions], config.folds), 1):
        progress(f"context: fold {number} of {config.folds}")
        rows = np.zeros(len(table.frame), bool)
        for i in train:
            rows[starts[i] : starts[i + 1]] = True
        model = grow(table, rows, config.context)
        for i in validate:
            features = SuperpixelFeatures(descriptions[i].features.values, table.names)
            result[i] = compute_geometric_context(features, model)
    return result


def build_examples(
    descriptions: Sequence[FrameDescription], contexts: Sequence[NDArray[np.float64]], config: EstimatorConfig
) -> list[JointExample]:
    """State every frame as a joint problem; those whose truth no naming of the axes can say are left out."""
    built = (build_example(d, c, config) for d, c in zip(descriptions, contexts, strict=True))
    return [example for example in built if example is not None]


def learn_weights(
    separator: Separator,
    config: TrainConfig,
    start: ModelWeights | None = None,
    progress: Callable[[SvmProgress], object] = lambda _row: None,
    checkpoint: Path | None = None,
) -> SvmResult:
    """Run the structured SVM around the start weights.

    Raises
    ------
    ValueError
        When the algorithm is unknown or there is no example.
    """
    vector = (start or start_weights()).vector
    if config.algorithm == "one-slack":
        return learn_one_slack(separator, vector, config.svm, progress, checkpoint)
    if config.algorithm == "frank-wolfe":
        return learn_frank_wolfe(separator, vector, config.svm, config.seed, progress, checkpoint)
    raise ValueError(f"algorithm is {config.algorithm!r}; allowed are one-slack, frank-wolfe")


def local_separator(examples: Sequence[JointExample], estimator: EstimatorConfig) -> LocalSeparator[JointExample]:
    """Return the oracle over examples in memory, with the blocks of the estimator's variant."""
    quick = replace(estimator, joint_starts=_ORACLE_STARTS, joint_alternations=_ORACLE_ALTERNATIONS)
    off = set(VARIANTS[estimator.joint_variant]) | (set() if estimator.use_depth else set(VARIANTS["rgb"]))
    return LocalSeparator(JointOracle(quick, active_features(tuple(sorted(off)))), examples)


def validate(weights: ModelWeights, examples: Sequence[JointExample], config: EstimatorConfig) -> dict[str, float]:
    """Return mean losses in percent: layout, labelling, and what the truth itself would have (attainable)."""
    losses = [predict_loss(weights, example, config) for example in examples]
    return {
        "frames": len(examples),
        "layout": _percent(losses, "layout"),
        "labelling": _percent(losses, "labelling"),
        "attainable_layout": _percent([e.attainable for e in examples], "layout"),
        "attainable_labelling": _percent([e.attainable for e in examples], "labelling"),
    }


def _percent(losses: Sequence[JointLoss], which: str) -> float:
    return round(100.0 * float(np.mean([getattr(loss, which) for loss in losses])), 3)


def card_of(config: TrainConfig, result: SvmResult, facts: dict[str, Any]) -> dict[str, Any]:
    """Return what the model file says about its training."""
    last = result.history[-1]
    return {
        **facts,
        "algorithm": config.algorithm,
        "C": config.svm.C,
        "epsilon": config.svm.epsilon,
        "converged": result.converged,
        "rounds": last.round,
        "objective": round(last.objective, 6),
        "dual": round(last.dual, 6),
        "folds": config.folds,
        "seed": config.seed,
        "context": {name: getattr(config.context, name) for name in config.context.__slots__},
    }
