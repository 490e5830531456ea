"""Losses of the joint model: pixel-wise layout error plus area-weighted labelling error, each a share of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.energies import ExtraCosts
from ..core.integral_geometry import face_counts
from ..core.joint_problem import JointProblem
from ..core.labels import N_FACES, N_LABELS
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


def loss_costs(problem: JointProblem, label_truth: NDArray[np.float64], layout_share: float = 1.0) -> ExtraCosts:
    """Return the pixel-wise losses of labelling and layout as costs; their negatives augment inference in learning.

    Parameters
    ----------
    problem : JointProblem
        Built with the true layout as `regions`.
    label_truth : (K, 6) float64
        Share of the image that each superpixel has of each true label; pixels without truth in none.
    layout_share : float
        Weight of the layout loss against the labelling loss.
    """
    labelled = label_truth.sum(axis=1, keepdims=True)
    wrong = (problem.atom_region[:, None] != np.arange(1, N_FACES + 1)) & (problem.atom_region[:, None] > 0)
    return ExtraCosts(
        face=layout_share * wrong * (problem.counts.pixels / problem.pixels)[:, None],
        label=labelled - label_truth,
    )


def joint_loss(problem: JointProblem, costs: ExtraCosts, layout: Layout, labels: NDArray[np.int64]) -> JointLoss:
    """Return the losses of an output.

    Parameters
    ----------
    problem : JointProblem
    costs : ExtraCosts
        Of `loss_costs`.
    layout : state indices. labels : (K,) int64, 0..5.
    """
    share = face_counts(problem.counts, layout) / np.maximum(problem.counts.pixels, 1.0)[:, None]
    of_labels = costs.label[np.arange(len(labels)), labels].sum()
    return JointLoss(float((share * costs.face).sum()), float(of_labels))


def augmented(costs: ExtraCosts) -> ExtraCosts:
    """Return the costs that make inference look for outputs of low energy and high loss."""
    return ExtraCosts(-costs.face, -costs.label)


def label_overlap(costs: ExtraCosts, labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the (6, 6) share of the image by true label (row) and given label (column), from the losses as costs.

    Parameters
    ----------
    costs : ExtraCosts
        Of `joint_problem.loss_costs`: a label costs what of the superpixel is labelled otherwise.
    labels : (K,) int64, 0..5.
    """
    labelled = costs.label.sum(axis=1, keepdims=True) / (N_LABELS - 1)
    overlap = np.zeros((N_LABELS, N_LABELS))
    np.add.at(overlap.T, labels, labelled - costs.label)
    return overlap


def mean_iou(overlap: NDArray[np.float64]) -> float:
    """Return the mean intersection over union of the labels that occur, from summed overlaps; NaN when none does."""
    hit = np.diagonal(overlap)
    union = overlap.sum(axis=0) + overlap.sum(axis=1) - hit
    occurs = union > 1e-12
    return float((hit[occurs] / union[occurs]).mean()) if occurs.any() else float("nan")
