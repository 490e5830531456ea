"""Training of the joint model's weights, end to end: descriptions, out-of-fold context, examples, structured SVM."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.evidence.features import SuperpixelFeatures
from ..core.weights import VARIANTS, ModelWeights, start_weights
from .context import ContextSettings, out_of_fold
from .context_table import TablePart, stack
from .folds import check_folds, frame_numbers
from .frank_wolfe import learn_frank_wolfe
from .joint_examples import FrameDescription
from .joint_oracle import JointOracle, Judged, active_features
from .losses import JointLoss, mean_iou
from .oracle import Separator
from .structured_svm import SvmConfig, SvmProgress, SvmResult, learn_one_slack, problem_key

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


@dataclass(frozen=True, slots=True)
class FrameRows:
    """The rows of one frame in the table of the context classifier: all that the master holds of it.

    Attributes
    ----------
    name : of the frame. features : of its K superpixels.
    labels : (K, 7) float32 pixels per label id. classes : (K, 41) float32 pixels per NYU40 id.
    """

    name: str
    features: SuperpixelFeatures
    labels: NDArray[np.float32]
    classes: NDArray[np.float32]


def rows_of(description: FrameDescription) -> FrameRows:
    """Return the rows of a frame."""
    d = description
    return FrameRows(d.name, d.seen.features, d.label_counts(), d.class_counts())


def out_of_fold_context(
    frames: Sequence[FrameRows], config: TrainConfig, progress: Callable[[str], object] = print
) -> dict[str, NDArray[np.float64]]:
    """Return (K, 6) probabilities by frame name, each by forests that saw neither it nor its neighbours.

    Raises
    ------
    ValueError
        When there is no frame, or there are fewer than folds.
    """
    if not frames:
        raise ValueError("no frame to learn from: none has a fitted room, classes and usable axes")
    check_folds(config.folds, len(frames))
    numbers = frame_numbers([f.name for f in frames])
    table = stack([TablePart(f.features, f.labels, f.classes, k) for f, k in zip(frames, numbers, strict=True)])
    probability = out_of_fold(table, config.context, config.folds, progress)
    ends = np.cumsum([len(f.labels) for f in frames])
    return {f.name: rows for f, rows in zip(frames, np.split(probability, ends[:-1]), strict=True)}


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
        When the algorithm is unknown, there is no example, or the checkpoint is another problem's.
    """
    vector = (start or start_weights()).vector
    if config.algorithm == "one-slack":
        return learn_one_slack(separator, vector, config.svm, progress, checkpoint)
    if config.algorithm == "frank-wolfe":
        return learn_frank_wolfe(separator, vector, config.svm, config.seed, progress, checkpoint)
    raise ValueError(f"algorithm is {config.algorithm!r}; allowed are one-slack, frank-wolfe")


def checkpoint_name(separator: Separator, config: TrainConfig, start: ModelWeights) -> str:
    """Return a file name that only the same problem has: another run neither resumes nor overwrites its checkpoint."""
    problem = problem_key(separator, start.vector, config.svm.C, config.seed)
    return f"{config.algorithm}-{problem[:16]}.npz"


def joint_oracle(estimator: EstimatorConfig) -> JointOracle:
    """Return the oracle for learning, with the blocks of the estimator's variant."""
    quick = replace(estimator, joint_starts=_ORACLE_STARTS, joint_alternations=_ORACLE_ALTERNATIONS)
    off = set(VARIANTS[estimator.joint_variant]) | (set() if estimator.use_depth else set(VARIANTS["rgb"]))
    return JointOracle(quick, active_features(tuple(sorted(off))))


def summary(judged: Sequence[Judged], attainable: Sequence[JointLoss]) -> dict[str, float]:
    """Return means in percent: layout and labelling loss, IoU of the six labels, what the truth itself would have."""
    losses = [one.loss for one in judged]
    return {
        "frames": len(judged),
        "layout": _percent(losses, "layout"),
        "labelling": _percent(losses, "labelling"),
        "mean_iou": round(100.0 * mean_iou(np.sum([one.overlap for one in judged], axis=0)), 3),
        "attainable_layout": _percent(attainable, "layout"),
        "attainable_labelling": _percent(attainable, "labelling"),
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
