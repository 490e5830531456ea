"""The joint energy is what its features say, and the alternation lowers it towards a proved bound."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from joint_problems import CAMERA, random_problem, random_weights
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.energies import (
    ExtraCosts,
    compatibility_costs,
    couple,
    joint_features,
    label_problem,
    layout_costs,
    reversed_relation,
    superpixel_faces,
    violations,
)
from room_layout_ros.core.integral_geometry import face_counts, pair_tables
from room_layout_ros.core.joint import _Alternation, _State, solve_joint
from room_layout_ros.core.joint_problem import JointProblem
from room_layout_ros.core.layout_search import Layout, RankedLayout, layout_energy
from room_layout_ros.core.plane_costs import plane_costs, with_fit
from room_layout_ros.core.weights import (
    BLOCKS,
    SLICES,
    VARIANTS,
    ModelWeights,
    pack_blocks,
    physical_table,
)
from room_layout_ros.learning.losses import loss_costs

CONFIG = EstimatorConfig(joint_starts=3, labelling_sweeps=50)


def energy_of_inference(
    problem: JointProblem, weights: ModelWeights, labels: NDArray[np.int64], layout: Layout, c: int
) -> float:
    """E(x, y) from the tables that the minimisation reads."""
    planes = with_fit(plane_costs(problem, weights), problem, weights, labels).of(layout, c)
    cost = layout_costs(problem, weights) + compatibility_costs(problem, weights, labels)
    return (
        label_problem(problem, weights).energy(labels)
        + layout_energy(pair_tables(problem.counts, cost), layout)
        + planes
    )


def random_layout(rng: np.random.Generator, problem: JointProblem) -> Layout:
    a, b, c, d = (int(rng.integers(n)) for n in problem.counts.grid.state_counts)
    return a, b, c, d


@pytest.mark.parametrize("with_depth", (True, False))
def test_weights_times_features_are_the_energy_that_inference_minimises(
    rng: np.random.Generator, with_depth: bool
) -> None:
    problem, weights = random_problem(rng, with_depth=with_depth), random_weights(rng)
    for _ in range(25):
        labels = rng.integers(0, 6, 48)
        layout, c = random_layout(rng, problem), int(rng.integers(len(problem.scales)))
        phi = joint_features(problem, labels, layout, float(problem.scales[c]))
        assert weights.vector @ phi == pytest.approx(energy_of_inference(problem, weights, labels, layout, c), abs=1e-9)


@pytest.mark.parametrize("name", tuple(BLOCKS))
def test_each_block_alone_is_counted_once(rng: np.random.Generator, name: str) -> None:
    problem = random_problem(rng)
    weights = ModelWeights(pack_blocks({name: rng.normal(size=BLOCKS[name])}))
    labels, layout = rng.integers(0, 6, 48), random_layout(rng, problem)
    phi = joint_features(problem, labels, layout, float(problem.scales[1]))
    expected = energy_of_inference(problem, weights, labels, layout, 1)
    assert weights.vector @ phi == pytest.approx(expected, abs=1e-10)
    assert np.abs(phi[SLICES[name]]).sum() > 0 or name == "face_absent"


def test_compatibility_features_count_pixels_per_face_and_label(rng: np.random.Generator) -> None:
    problem = random_problem(rng)
    labels, layout = rng.integers(0, 6, 48), random_layout(rng, problem)
    counted = joint_features(problem, labels, layout, 1.0)[SLICES["compatibility"]].reshape(5, 6)
    raster = problem.counts.grid.cuboid(layout).raster(CAMERA)
    index = (np.arange(48)[:, None] // 8 * 8 + np.arange(64) // 8).astype(int)
    truth = np.array([[((raster == a + 1) & (labels[index] == g)).mean() for g in range(6)] for a in range(5)])
    assert np.abs(counted - truth).max() < 0.004  # a small image with coarse angle bins
    assert counted.sum() == pytest.approx(truth.sum(), abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_energy_never_rises_and_ends_as_its_features_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem, weights = random_problem(rng), random_weights(rng)
    found = solve_joint(problem, weights, CONFIG)
    assert all(b <= a + 1e-9 for a, b in itertools.pairwise(found.energies)), found.energies
    assert found.energies[-1] == pytest.approx(found.energy)
    assert weights.vector @ joint_features(problem, found.labels, found.layout, found.scale) == pytest.approx(
        found.energy, abs=1e-9
    )
    assert found.bound <= found.energy + 1e-9
    assert found.finished


@pytest.mark.parametrize("seed", range(10))
def test_bound_and_energy_enclose_the_minimum_over_all_labels_and_layouts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem, weights = random_problem(rng, 2, 2, rays=2), random_weights(rng)
    check_enclosed(problem, weights)


def test_they_enclose_it_where_rays_point_away_from_the_front_wall() -> None:
    """A ray behind the front plane may hit no face; what was moved to the labels for it then has to be paid back."""
    rng, solved = np.random.default_rng(5), 0
    while solved < 40:
        problem = random_problem(rng, 2, 2, rays=2, with_depth=False, turned_deg=(100.0, 88.0, 5.0))
        states = problem.counts.grid.state_counts
        if problem.counts.hidden[:, 2].sum() < 0.2 * problem.pixels or np.prod(states) > 300:
            continue
        parts = {"compatibility": 2.0 + 2.0 * rng.normal(size=(5, 6)), "layout_gc": 2.0 * rng.normal(size=(5, 6))}
        absent, bias = rng.normal(size=4), 2.0 * rng.normal(size=6)
        weights = ModelWeights(pack_blocks({**parts, "face_absent": absent, "label_bias": bias}))
        truth = check_enclosed(problem, weights)
        solver = _Alternation(problem, weights, CONFIG, lambda: False, None)
        for layout in [random_layout(rng, problem) for _ in range(4)]:  # where a worse search might have ended
            state = _State(layout, 0, solver.label(layout, 0, None), (np.inf,))
            assert solver.bound(state) <= truth + 1e-9
        solved += 1


def check_enclosed(problem: JointProblem, weights: ModelWeights) -> float:
    """Return the least energy of all labels and layouts."""
    truth = exhaustive_minimum(problem, weights)
    found = solve_joint(problem, weights, CONFIG)
    assert found.bound <= truth + 1e-9
    assert found.energy >= truth - 1e-9
    return truth


def exhaustive_minimum(problem: JointProblem, weights: ModelWeights) -> float:
    alone = label_problem(problem, weights)
    labellings = np.array(list(itertools.product(range(6), repeat=4)))
    of_labels = np.array([alone.energy(x) for x in labellings])
    tables, planes = pair_tables(problem.counts, layout_costs(problem, weights)), plane_costs(problem, weights)
    best = np.inf
    a, b, c, d = (range(int(n)) for n in problem.counts.grid.state_counts)
    for layout in itertools.product(a, b, c, d):
        for number, scale in enumerate(problem.scales):
            faces = superpixel_faces(problem, layout)
            coupled = couple(problem, weights, faces, problem.area, layout, float(scale))
            joint = of_labels + coupled[np.arange(4), labellings].sum(axis=1)
            best = min(best, float(joint.min()) + layout_energy(tables, layout) + planes.of(layout, number))
    return best


def test_more_starts_never_cost_more(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng), random_weights(rng)
    energies = [solve_joint(problem, weights, replace(CONFIG, joint_starts=n)).energy for n in (1, 2, 4, 8)]
    assert all(b <= a + 1e-12 for a, b in itertools.pairwise(energies))


def test_a_given_start_is_used(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng), random_weights(rng)
    alone = solve_joint(problem, weights, replace(CONFIG, joint_starts=1))
    good = solve_joint(problem, weights, replace(CONFIG, joint_starts=8))
    assert good.energy <= alone.energy
    warm = solve_joint(problem, weights, replace(CONFIG, joint_starts=1), starts=(RankedLayout(good.layout, 0.0),))
    assert warm.energy <= alone.energy + 1e-12


def test_same_input_gives_the_same_bytes(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng), random_weights(rng)
    a, b = solve_joint(problem, weights, CONFIG), solve_joint(problem, weights, CONFIG)
    assert (a.layout, a.scale, a.energy, a.bound, a.energies) == (b.layout, b.scale, b.energy, b.bound, b.energies)
    assert a.labels.tobytes() == b.labels.tobytes()
    assert a.face_confidence.tobytes() == b.face_confidence.tobytes()


def test_a_passed_deadline_still_gives_labels_and_layout(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng), random_weights(rng)
    found = solve_joint(problem, weights, CONFIG, expired=lambda: True)
    assert not found.finished
    assert found.bound == -np.inf
    assert len(found.energies) == 1
    phi = joint_features(problem, found.labels, found.layout, found.scale)
    assert weights.vector @ phi == pytest.approx(found.energy, abs=1e-9)


@pytest.mark.parametrize("after", (1, 2, 3, 4, 5))
def test_a_deadline_between_half_steps_leaves_a_consistent_state(after: int) -> None:
    rng = np.random.default_rng(3)
    problem, weights = random_problem(rng), random_weights(rng)
    asked = itertools.count()
    found = solve_joint(problem, weights, CONFIG, expired=lambda: next(asked) >= after)
    phi = joint_features(problem, found.labels, found.layout, found.scale)
    assert weights.vector @ phi == pytest.approx(found.energy, abs=1e-9)


def test_loss_augmented_inference_minimises_energy_minus_both_losses(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng, 2, 2, rays=2), random_weights(rng, 0.1)
    truth = rng.dirichlet(np.ones(6), 4) * problem.area[:, None]
    loss = loss_costs(problem, truth)
    found = solve_joint(problem, weights, CONFIG, extra=ExtraCosts(-loss.face, -loss.label))
    faces = face_counts(problem.counts, found.layout) / problem.pixels
    region = problem.atom_region
    layout_loss = sum(faces[(region > 0) & (region != k + 1), k].sum() for k in range(5))
    label_loss = float((problem.area - truth[np.arange(4), found.labels]).sum())
    energy = weights.vector @ joint_features(problem, found.labels, found.layout, found.scale)
    assert found.energy == pytest.approx(energy - layout_loss - label_loss, abs=1e-9)
    plain = solve_joint(problem, weights, CONFIG)
    assert found.energy <= plain.energy  # the loss is never negative
    assert found.bound <= found.energy + 1e-9


def test_with_the_loss_alone_the_least_cost_is_the_true_labels(rng: np.random.Generator) -> None:
    problem = random_problem(rng)
    truth = np.eye(6)[rng.integers(0, 6, 48)] * problem.area[:, None]
    found = solve_joint(problem, ModelWeights(pack_blocks({})), CONFIG, extra=loss_costs(problem, truth))
    assert (found.labels == truth.argmax(axis=1)).all()


def test_every_superpixel_is_shared_among_the_faces(rng: np.random.Generator) -> None:
    problem = random_problem(rng)
    faces = superpixel_faces(problem, random_layout(rng, problem))
    np.testing.assert_allclose(faces.sum(axis=1), problem.area, atol=1e-12)
    assert (faces >= -1e-12).all()


def test_the_physical_table_says_the_same_seen_from_both_sides() -> None:
    table = physical_table()
    mirrored = reversed_relation(table.reshape(36, 6).astype(np.float64)).reshape(6, 6, 6).transpose(1, 0, 2)
    np.testing.assert_array_equal(table, mirrored.astype(bool))
    assert not table[np.arange(6), np.arange(6)].any()


@pytest.mark.parametrize(
    ("a", "relation", "b", "forbidden"),
    (
        ("floor", "above", "left", True),
        ("ceiling", "below", "front", True),
        ("left", "right of", "clutter", True),
        ("right", "left of", "floor", True),
        ("front", "behind", "clutter", True),  # the front wall nearer than what stands before it
        ("clutter", "in front of", "front", True),  # clutter beyond the front wall
        ("clutter", "above", "floor", False),
        ("left", "left of", "floor", False),
        ("front", "in front of", "floor", False),
        ("left", "behind", "front", False),
    ),
)
def test_the_physical_table_makes_sense_in_a_room(a: str, relation: str, b: str, forbidden: bool) -> None:
    labels = ("ceiling", "floor", "left", "front", "right", "clutter")
    relations = ("above", "below", "right of", "left of", "in front of", "behind")
    one = np.zeros((1, 6))
    one[0, relations.index(relation)] = 1.0
    assert bool(violations(one)[0, labels.index(a), labels.index(b)]) is forbidden


def test_without_depth_no_depth_weight_is_read(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng, with_depth=False), random_weights(rng)
    a, b = solve_joint(problem, weights, CONFIG), solve_joint(problem, weights.variant("rgb"), CONFIG)
    assert a.energy == b.energy
    assert a.scale == 1.0


@pytest.mark.parametrize("name", tuple(VARIANTS))
def test_variants_switch_off_their_blocks_only(name: str, rng: np.random.Generator) -> None:
    weights = random_weights(rng)
    variant = weights.variant(name)
    for block in BLOCKS:
        same = (variant.block(block) == weights.block(block)).all()
        assert same == (block not in VARIANTS[name])
    assert solve_joint(random_problem(rng), variant, CONFIG).finished


def test_without_compatibility_both_tasks_are_solved_alone(rng: np.random.Generator) -> None:
    problem, weights = random_problem(rng), random_weights(rng).variant("no_compatibility")
    found = solve_joint(problem, weights, CONFIG)
    assert len(found.energies) == 2
    assert found.energies[0] == pytest.approx(found.energies[1])


def test_confidence_is_a_share_and_zero_where_nothing_is_seen(rng: np.random.Generator) -> None:
    for _ in range(5):
        problem = random_problem(rng)
        found = solve_joint(problem, random_weights(rng), CONFIG)
        seen = superpixel_faces(problem, found.layout).sum(axis=0) > 1e-3
        assert ((found.face_confidence >= 0) & (found.face_confidence <= 1)).all()
        assert (found.face_confidence[~seen] == 0).all()


def test_a_problem_that_does_not_fit_is_refused(rng: np.random.Generator) -> None:
    problem = random_problem(rng)
    with pytest.raises(ValueError, match=r"label_gc of the joint problem has shape \(48, 5\); \(48, 6\) is needed"):
        replace(problem, label_gc=problem.label_gc[:, :5])
    with pytest.raises(ValueError, match="contact of the joint problem holds a value that is not finite"):
        replace(problem, contact=np.full(len(problem.edges), np.nan))
