"""Inference of the joint model in the structured SVM's terms: loss-augmented for learning, plain for validation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.energies import joint_features
from ..core.joint import solve_joint
from ..core.labels import N_LABELS
from ..core.layout_search import RankedLayout
from ..core.wall_naming import NAME_TIE
from ..core.weights import N_FEATURES, SLICES, ModelWeights
from .joint_examples import JointExample
from .losses import JointLoss, augmented, joint_loss, label_overlap
from .oracle import Separation


@dataclass(frozen=True, slots=True)
class JointOracle:
    """Separation by alternating minimisation over labels, layout and scale, under every naming of the axes.

    The alternation is exact in each half step but not jointly; several starts, the truth's layout among them, and the
    truth itself as a candidate keep the answers close to the most violated ones and never below 0.

    Attributes
    ----------
    config : EstimatorConfig. active : (d,) bool, False for blocks that are off in the variant that is learned.
    """

    config: EstimatorConfig
    active: NDArray[np.bool_]

    def __call__(self, weights: NDArray[np.float64], example: JointExample) -> Separation:
        """Return the output of largest loss - w . (phi(y_hat) - phi(y)) found."""
        model = ModelWeights(np.where(self.active, weights, 0.0))
        truth = np.where(self.active, example.truth_features, 0.0)
        best = Separation(np.zeros(N_FEATURES), example.attainable.total)
        most = best.violation(weights)
        for h, (problem, costs) in enumerate(zip(example.problems, example.costs, strict=True)):
            starts = (RankedLayout(example.truth_layout, 0.0),) if h == example.truth_index else ()
            found = solve_joint(problem, model, self.config, extra=augmented(costs), starts=starts, prove=False)
            features = np.where(self.active, joint_features(problem, found.labels, found.layout, found.scale), 0.0)
            loss = joint_loss(problem, costs, found.layout, found.labels).total
            separation = Separation(features - truth, loss)
            if (violation := separation.violation(weights)) > most:
                best, most = separation, violation
        return best


@dataclass(frozen=True, slots=True)
class Judged:
    """How wrong the model's own answer is.

    Attributes
    ----------
    loss : of the answer. overlap : (6, 6) share of the image with a true label (row) and the answer's (column).
    """

    loss: JointLoss
    overlap: NDArray[np.float64]


def judge(weights: ModelWeights, example: JointExample, config: EstimatorConfig) -> Judged:
    """Return how wrong the model's own answer is: the one of least energy over the namings."""
    best, answer = np.inf, Judged(JointLoss(1.0, 1.0), np.zeros((N_LABELS, N_LABELS)))
    for problem, costs in zip(example.problems, example.costs, strict=True):
        found = solve_joint(problem, weights, config, prove=False)
        if found.energy < best - NAME_TIE:
            best = found.energy
            loss = joint_loss(problem, costs, found.layout, found.labels)
            answer = Judged(loss, label_overlap(costs, found.labels))
    return answer


def active_features(blocks_off: tuple[str, ...]) -> NDArray[np.bool_]:
    """(d,) bool, False for the features of the blocks that are switched off."""
    active = np.ones(N_FEATURES, bool)
    for name in blocks_off:
        active[SLICES[name]] = False
    return active
