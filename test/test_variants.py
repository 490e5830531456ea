"""A variant of the model reads the evidence that it names and nothing else, by whatever way it might come in."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF

from room_layout_ros.core import hypotheses
from room_layout_ros.core.config import JOINT_VARIANTS, EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.evidence import orientation_map
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.weights import VARIANTS
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource


@pytest.fixture(scope="module")
def frame() -> RgbdFrame:
    source = replace(SyntheticSource(1, 31, noise="clean", walk=False), camera=HALF)
    return next(iter(good_samples(source))).frame


def random_context(features: Any, model: Any) -> NDArray[np.float64]:
    return np.random.default_rng(1).dirichlet(np.full(6, 0.3), len(features.values))


def random_orientation(segments: Any, line_class: Any, R: Any, camera: Any) -> NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 6, (camera.height, camera.width)).astype(np.uint8)


def spoil(monkeypatch: pytest.MonkeyPatch, evidence: str) -> None:
    if evidence == "context":
        monkeypatch.setattr(hypotheses, "compute_geometric_context", random_context)
    else:
        monkeypatch.setattr(orientation_map, "compute_orientation_map", random_orientation)


def same(a: RoomEstimate, b: RoomEstimate) -> bool:
    assert a.cuboid is not None
    assert b.cuboid is not None
    planes = a.cuboid.distances.tobytes() == b.cuboid.distances.tobytes()
    return planes and a.layout.tobytes() == b.layout.tobytes() and a.labels.tobytes() == b.labels.tobytes()


@pytest.mark.parametrize("with_depth", (True, False))
@pytest.mark.parametrize(("variant", "unread"), (("om_only", "context"), ("gc_only", "orientation")))
def test_evidence_that_a_variant_leaves_out_changes_no_byte(
    frame: RgbdFrame, variant: str, unread: str, with_depth: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = frame if with_depth else frame.without_depth()
    estimator, full = LayoutEstimator(EstimatorConfig(joint_variant=variant)), LayoutEstimator()
    before, whole = estimator.estimate(seen), full.estimate(seen)
    assert before.status is Status.OK
    spoil(monkeypatch, unread)
    assert same(before, estimator.estimate(seen))
    assert not same(whole, full.estimate(seen)), "the spoilt evidence would be noticed"


def test_every_variant_of_the_weights_can_be_chosen_but_that_without_the_network_which_is_another_parameter() -> None:
    assert (*JOINT_VARIANTS, "no_scene") == tuple(VARIANTS)
    models = LayoutEstimator(EstimatorConfig(scene_network=False)).models
    for way in ((True, False), (False, False)):
        joint = models[way].joint
        np.testing.assert_array_equal(joint.variant("no_scene").vector, joint.vector)


@pytest.mark.parametrize("variant", ("om_only", "gc_only", "paper"))
def test_variants_of_the_paper_do_not_ask_the_scene_network(variant: str) -> None:
    assert LayoutEstimator(EstimatorConfig(joint_variant=variant, scene_network=True)).network is None
