"""Learning of the joint model: the truth can be said, the oracle finds what violates, the weights get better."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from local_separator import LocalSeparator
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.energies import joint_features
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.weights import N_FEATURES, SLICES, ModelWeights, start_weights
from room_layout_ros.datasets import Sample
from room_layout_ros.datasets.synthetic import NOISES, random_pose, random_scene, render
from room_layout_ros.learning.folds import folds_of, frame_numbers, is_near
from room_layout_ros.learning.joint_examples import FrameDescription, JointExample, build_example, describe
from room_layout_ros.learning.joint_oracle import JointOracle, active_features, judge
from room_layout_ros.learning.losses import joint_loss, label_overlap, mean_iou
from room_layout_ros.learning.structured_svm import SvmConfig
from room_layout_ros.learning.train import TrainConfig, joint_oracle, learn_weights
from room_layout_ros.learning.train_run import choose_names

CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
CONFIG = EstimatorConfig()


@lru_cache(maxsize=16)
def view(seed: int) -> Sample:
    room = random_scene(np.random.default_rng(seed), "cuboid")
    pose = random_pose(room, np.random.default_rng(seed + 50))
    return render(room, CAMERA, pose, NOISES["kinect"], np.random.default_rng(seed), name=f"{seed:04d}")


@lru_cache(maxsize=16)
def description(seed: int, use_depth: bool = True) -> FrameDescription:
    sample = view(seed)
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    assert sample.truth.labels40 is not None
    config = replace(CONFIG, use_depth=use_depth)
    found = describe(sample.frame, sample.truth.cuboid, sample.truth.labels40, config)
    assert found is not None
    return found


def doubtful_context(d: FrameDescription, rng: np.random.Generator) -> NDArray[np.float64]:
    """Right about half of the time: what the other terms have to make up for."""
    share = d.label_counts()[:, 1:] + 1.0
    share /= share.sum(axis=1, keepdims=True)
    guess = rng.dirichlet(np.ones(6), len(share))
    return np.asarray(0.5 * share + 0.5 * guess, np.float64)


@lru_cache(maxsize=16)
def example(seed: int) -> JointExample:
    d = description(seed)
    found = build_example(d, doubtful_context(d, np.random.default_rng(seed)), CONFIG)
    assert found is not None
    return found


SEEDS = (1, 2, 3, 5, 6, 8)


def test_the_truth_can_be_said_in_the_terms_of_the_model() -> None:
    for seed in SEEDS:
        assert example(seed).attainable.layout < 0.03
        assert example(seed).attainable.labelling < 0.06


def test_losses_count_pixels() -> None:
    e = example(1)
    problem, costs = e.problems[e.truth_index], e.costs[e.truth_index]
    all_wrong = (e.truth_labels + 1) % 6
    assert joint_loss(problem, costs, e.truth_layout, e.truth_labels).total == pytest.approx(e.attainable.total)
    labelled = costs.label.max(axis=1).sum()
    assert joint_loss(problem, costs, e.truth_layout, all_wrong).labelling > 0.9 * labelled
    moved = (0, *e.truth_layout[1:]) if e.truth_layout[0] else (1, *e.truth_layout[1:])
    other = joint_loss(problem, costs, moved, e.truth_labels)
    assert other.layout >= e.attainable.layout
    assert other.labelling == pytest.approx(e.attainable.labelling)


def test_overlap_of_labels_agrees_with_the_loss_and_its_iou_with_a_count_of_pixels(rng: np.random.Generator) -> None:
    e = example(1)
    costs = e.costs[e.truth_index]
    labels = np.where(rng.random(len(e.truth_labels)) < 0.7, e.truth_labels, rng.integers(6, size=len(e.truth_labels)))
    overlap = label_overlap(costs, labels)
    wrong = joint_loss(e.problems[e.truth_index], costs, e.truth_layout, labels).labelling
    assert overlap.sum() - np.trace(overlap) == pytest.approx(wrong)
    shares = np.stack([costs.label.sum(axis=1) / 5.0 - costs.label[:, k] for k in range(6)], axis=1)
    both = [shares[labels == k, k].sum() for k in range(6)]
    either = [shares[:, k].sum() + shares[labels == k].sum() - both[k] for k in range(6)]
    expected = [b / u for b, u in zip(both, either, strict=True) if u > 0]
    assert mean_iou(overlap) == pytest.approx(np.mean(expected))
    assert mean_iou(np.diag([0.5, 0.3, 0.0, 0.0, 0.1, 0.0])) == 1.0
    assert np.isnan(mean_iou(np.zeros((6, 6))))


def test_no_random_output_violates_more_than_the_oracles(rng: np.random.Generator) -> None:
    weights = start_weights().vector
    for seed in SEEDS[:3]:
        e = example(seed)
        most = JointOracle(CONFIG, active_features(()))(weights, e).violation(weights)
        assert most >= 0.0
        problem, costs = e.problems[e.truth_index], e.costs[e.truth_index]
        own = float(weights @ e.truth_features)
        for _ in range(60):
            ceiling, floor, left, right = (int(rng.integers(n)) for n in problem.counts.grid.state_counts)
            layout = (ceiling, floor, left, right)
            labels = np.where(rng.random(len(e.truth_labels)) < rng.random(), e.truth_labels, rng.integers(6))
            scale = float(rng.choice(problem.scales))
            energy = float(np.dot(weights, joint_features(problem, labels, layout, scale)))
            loss = joint_loss(problem, costs, layout, labels).total
            assert loss - (energy - own) <= most + 1e-9


def test_blocks_that_are_off_stay_where_they_are() -> None:
    oracle = JointOracle(CONFIG, active_features(("plane_support",)))
    found = oracle(np.zeros(N_FEATURES), example(2))
    assert found.feature_difference.shape == (N_FEATURES,)
    assert not found.feature_difference[SLICES["plane_support"]].any()
    assert found.feature_difference[SLICES["plane_violation"]].any()


@pytest.mark.parametrize(("algorithm", "rounds"), [("frank-wolfe", 5), ("one-slack", 15)])
def test_learning_betters_the_losses_and_repeats_to_the_number(algorithm: str, rounds: int) -> None:
    examples = [example(seed) for seed in SEEDS[:4]]
    start = ModelWeights(np.zeros(N_FEATURES))
    config = TrainConfig(svm=SvmConfig(100.0, 0.01, rounds), algorithm=algorithm)
    separator = LocalSeparator(joint_oracle(CONFIG), examples)
    first = learn_weights(separator, config, start)
    second = learn_weights(separator, config, start)
    np.testing.assert_array_equal(first.weights, second.weights)
    before = np.mean([judge(start, e, CONFIG).loss.total for e in examples])
    after = np.mean([judge(ModelWeights(first.weights), e, CONFIG).loss.total for e in examples])
    assert after < 0.4 * before


def test_a_variant_without_context_learns_from_examples_that_do_not_see_it() -> None:
    d, config = description(2), replace(CONFIG, joint_variant="om_only")
    first, second = (build_example(d, doubtful_context(d, np.random.default_rng(s)), config) for s in (1, 2))
    assert first is not None
    assert second is not None
    for one, other in zip(first.problems, second.problems, strict=True):
        assert np.ptp(one.label_gc) == 0.0
        assert one.profiles is not None
        assert other.profiles is not None
        np.testing.assert_array_equal(one.profiles.support, other.profiles.support)


def test_frames_without_depth_make_examples_too() -> None:
    d = description(3, use_depth=False)
    found = build_example(d, doubtful_context(d, np.random.default_rng(3)), replace(CONFIG, use_depth=False))
    if found is not None:  # axes of lines alone may be too far off to say the truth
        assert found.problems[0].profiles is None
        assert found.truth_scale == 1.0
    assert d.seen.geometry is None


def test_folds_keep_neighbours_apart() -> None:
    names = [f"{i:04d}" for i in range(1, 101)]
    seen = []
    for train, held in folds_of(names, 4):
        assert min(abs(a - b) for a in train for b in held) > 5
        seen += held
    assert sorted(seen) == list(range(100))
    with pytest.raises(ValueError, match="folds"):
        list(folds_of(names, 1))


def test_a_time_is_no_number_of_a_frame() -> None:
    """Names in nanoseconds would have no neighbours, and pass for rendered frames."""
    times = [str(1403636579763555584 + 33_000_000 * i) for i in range(3)]
    assert frame_numbers(["0007", "7", *times, "999999", "1000000", "²", "hall"]) == [7, 7, 2, 3, 4, 999999, 6, 7, 8]


def test_held_out_frames_and_their_neighbours_are_left_out() -> None:
    names = [f"{i:04d}" for i in range(1, 101)]
    chosen = choose_names(names, ["0050"], None)
    assert set(names) - set(chosen) == {f"{i:04d}" for i in range(45, 56)}
    assert len(choose_names(names, ["0050"], 10)) == 10


def test_neighbours_are_told_by_the_number_that_a_name_ends_in() -> None:
    names = ["0001", "0006", "0007", "hall_1", "hall_6", "hall_7", "attic_1", "attic", "kitchen"]
    near = dict(zip(names, is_near(names, ["0001", "hall_01", "kitchen"]), strict=True))
    assert {name for name, one in near.items() if one} == {"0001", "0006", "hall_1", "hall_6", "kitchen"}
    assert choose_names(names, ["kitchen"], None) == names[:-1]
    assert not is_near(names, []).any()
