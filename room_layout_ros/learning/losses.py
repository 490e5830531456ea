"""Losses of the joint model: pixel-wise layout error plus area-weighted labelling error, each a share of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.energies import ExtraCosts, JointProblem
from ..core.integral_geometry import face_counts
from ..core.layout_search import Layout


@dataclass(frozen=True, slots=True)
class JointLoss:
    """How wrong an output is; 0 to 1 each.

    Attributes
    ----------
    layout : share of the pixels with a true face that lie in another. labelling : share of the image that is
        labelled and labelled otherwise.
    """

    layout: float
    labelling: float

    @property
    def total(self) -> float:
        """What the learning bounds."""
        return self.layout + self.labelling


def joint_loss(problem: JointProblem, costs: ExtraCosts, layout: Layout, labels: NDArray[np.int64]) -> JointLoss:
    """Return the losses of an output.

    Parameters
    ----------
    problem : JointProblem
    costs : ExtraCosts
        Of `joint_problem.loss_costs`.
    layout : state indices. labels : (K,) int64, 0..5.
    """
    share = face_counts(problem.counts, layout) / np.maximum(problem.counts.pixels, 1.0)[:, None]
    of_labels = costs.label[np.arange(len(labels)), labels].sum()
    return JointLoss(float((share * costs.face).sum()), float(of_labels))


def augmented(costs: ExtraCosts) -> ExtraCosts:
    """Return the costs that make inference look for outputs of low energy and high loss."""
    return ExtraCosts(-costs.face, -costs.label)
