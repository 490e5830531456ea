"""Training examples of the joint model: the estimator's own stages on labelled frames, and the truth in their terms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.energies import ExtraCosts, joint_features
from ..core.frame import CameraIntrinsics, RgbdFrame
from ..core.hypotheses import gather_hypotheses
from ..core.integral_geometry import pair_tables
from ..core.joint_problem import JointProblem, build_joint_problem
from ..core.labels import FRONT_WALL, WALL_FACES
from ..core.layout import RoomCuboid
from ..core.layout_search import Layout, search_layout
from ..core.observation import Observation
from ..core.room_axes import angle_between_axes
from ..core.weights import uses
from .context_table import look_at
from .losses import JointLoss, joint_loss, loss_costs
from .scene_folds import SceneFolds
from .superpixel_truth import class_histogram, label_histogram, translate_faces, true_labels

_MAX_UNEXPLAINED = 0.10
"""A frame whose true layout cannot be said within this error under any naming (wrong axes) teaches nothing."""


@dataclass(frozen=True, slots=True)
class FrameDescription:
    """What the estimator sees in a frame before any learned part, and what is true there.

    Attributes
    ----------
    name, camera : of the frame. seen : in it, with an honest scene network where one was asked.
    cuboid : the true room. labels40 : (H, W) uint8 NYU40 classes.
    """

    name: str
    camera: CameraIntrinsics
    seen: Observation
    cuboid: RoomCuboid
    labels40: NDArray[np.uint8]

    def class_counts(self) -> NDArray[np.float32]:
        """(K, 41) pixels per NYU40 id."""
        return class_histogram(self.seen.superpixels.index, self.seen.superpixels.count, self.labels40)

    def label_counts(self) -> NDArray[np.float32]:
        """(K, 7) pixels per label id, walls named in the first naming of the axes."""
        truth = true_labels(self.cuboid, self.cuboid.raster(self.camera), self.labels40, self.seen.axes.R_room_camera)
        return label_histogram(self.seen.superpixels.index, self.seen.superpixels.count, truth)


def describe(
    frame: RgbdFrame,
    cuboid: RoomCuboid,
    labels40: NDArray[np.uint8],
    config: EstimatorConfig,
    networks: SceneFolds | None = None,
) -> FrameDescription | None:
    """Describe a frame with what is true there; None where there is nothing to learn from (`look_at`)."""
    seen = look_at(frame, config, networks)
    return None if seen is None else FrameDescription(frame.name, frame.camera, seen, cuboid, labels40)


@dataclass(frozen=True, slots=True)
class JointExample:
    """One frame for the structured SVM.

    Attributes
    ----------
    name : of the frame. problems : one per naming of the axes. costs : the losses as costs, one per naming.
    truth_index : naming in which the truth is stated. truth_labels : (K,) 0..5, -1 where not labelled.
    truth_layout, truth_scale : state indices and metres.
    attainable : loss of the truth itself, so stated (binning, superpixels that straddle, axes).
    """

    name: str
    problems: tuple[JointProblem, ...]
    costs: tuple[ExtraCosts, ...]
    truth_index: int
    truth_labels: NDArray[np.int64]
    truth_layout: Layout
    truth_scale: float
    attainable: JointLoss

    @property
    def truth_features(self) -> NDArray[np.float64]:
        """(d,) phi(x, y) of the truth."""
        problem = self.problems[self.truth_index]
        return joint_features(problem, self.truth_labels, self.truth_layout, self.truth_scale)


def build_example(
    description: FrameDescription, context: NDArray[np.float64], config: EstimatorConfig, hypotheses: int = 3
) -> JointExample | None:
    """State a frame and its truth as joint problems; None where no naming of the axes can say the truth.

    Parameters
    ----------
    description : FrameDescription
    context : (K, 6) float64
        Geometric context under the first naming, from a classifier that has not seen the frame. A variant of the model
        without it does not see it; it only says what unlabelled superpixels are.
    config : EstimatorConfig
    hypotheses : int
        Namings of the axes to offer.
    """
    d, seen = description, description.seen
    seen_context = context if uses(config.joint_variant, "layout_gc") else None
    evidence = gather_hypotheses(seen, seen_context, d.camera, hypotheses)
    true_layout = d.cuboid.raster(d.camera)
    problems, costs, stated = [], [], []
    for one in evidence:
        regions = translate_faces(d.cuboid, one.R_room_camera)[true_layout]
        problem = build_joint_problem(d.camera, seen.superpixels, one, seen.geometry, config, regions)
        shares = _label_shares(d, one.R_room_camera)
        problems.append(problem)
        costs.append(loss_costs(problem, shares))
        stated.append(_state_truth(problem, costs[-1], shares, context))
    losses = [joint_loss(p, c, s[0], s[1]) for p, c, s in zip(problems, costs, stated, strict=True)]
    turned = [angle_between_axes(one.R_room_camera, d.cuboid.R_room_camera) for one in evidence]
    best = min(range(len(evidence)), key=lambda h: (round(losses[h].total, 2), turned[h]))
    if losses[best].layout > _MAX_UNEXPLAINED:
        return None
    layout, labels = stated[best]
    scale = _true_scale(problems[best], d.cuboid, evidence[best].R_room_camera)
    return JointExample(d.name, tuple(problems), tuple(costs), best, labels, layout, scale, losses[best])


def _label_shares(d: FrameDescription, R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 6) share of the image that each superpixel has of each true label."""
    truth = true_labels(d.cuboid, d.cuboid.raster(d.camera), d.labels40, R)
    counts = label_histogram(d.seen.superpixels.index, d.seen.superpixels.count, truth)
    return counts[:, 1:].astype(np.float64) / truth.size


def _state_truth(
    problem: JointProblem, costs: ExtraCosts, shares: NDArray[np.float64], context: NDArray[np.float64]
) -> tuple[Layout, NDArray[np.int64]]:
    """The layout of least loss, and the label of most pixels; unlabelled superpixels are what the context says."""
    tables = pair_tables(problem.counts, costs.face / np.maximum(problem.counts.pixels, 1.0)[:, None])
    layout = search_layout(tables).layout
    labels = shares.argmax(axis=1)
    unknown = shares.sum(axis=1) == 0
    labels[unknown] = context[unknown].argmax(axis=1)
    return layout, labels.astype(np.int64)


def _true_scale(problem: JointProblem, cuboid: RoomCuboid, R: NDArray[np.float64]) -> float:
    """The candidate scale nearest to the true distance of the wall that is called front under R."""
    names = translate_faces(cuboid, R)
    distances = [cuboid.distances[k] for k in WALL_FACES if names[k + 1] == FRONT_WALL]
    known = [d for d in distances if np.isfinite(d)]
    scales = problem.scales
    return float(scales[np.abs(scales - known[0]).argmin()]) if known else float(scales[-1])
