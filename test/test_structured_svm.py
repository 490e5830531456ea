"""The structured SVM against known solutions: scikit-learn's multiclass SVM, chains by brute force, both solvers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from local_separator import LocalSeparator
from numpy.typing import NDArray

from room_layout_ros.learning.frank_wolfe import learn_frank_wolfe
from room_layout_ros.learning.oracle import Separation
from room_layout_ros.learning.structured_svm import SvmConfig, SvmProgress, SvmResult, learn_one_slack, solve_dual

Point = tuple[NDArray[np.float64], int]
Chain = tuple[NDArray[np.float64], NDArray[np.int64]]

CLASSES, FEATURES = 3, 4
STATES, LENGTH = 3, 5


def multiclass_oracle(weights: NDArray[np.float64], example: Point) -> Separation:
    """Crammer and Singer: energy -w_y . x, loss 1 for a wrong class."""
    x, y = example
    energy = -weights.reshape(CLASSES, FEATURES) @ x
    loss = (np.arange(CLASSES) != y).astype(float)
    worst = int(np.argmax(loss - energy))
    difference = np.zeros((CLASSES, FEATURES))
    difference[worst] -= x
    difference[y] += x
    return Separation(difference.ravel(), float(loss[worst]))


def chain_features(observed: NDArray[np.float64], states: NDArray[np.int64]) -> NDArray[np.float64]:
    unary = -np.eye(STATES)[states].T @ observed
    pair = np.zeros((STATES, STATES))
    np.add.at(pair, (states[:-1], states[1:]), -1.0)
    return np.concatenate([unary.ravel(), pair.ravel()])


def chain_oracle(weights: NDArray[np.float64], example: Chain) -> Separation:
    """Loss-augmented Viterbi: mean Hamming loss."""
    observed, truth = example
    unary = -observed @ weights[: STATES * 2].reshape(STATES, 2).T
    pair = -weights[STATES * 2 :].reshape(STATES, STATES)
    augmented = unary - (np.arange(STATES) != truth[:, None]) / LENGTH
    cost, back = augmented[0], []
    for t in range(1, LENGTH):
        step = cost[:, None] + pair
        back.append(step.argmin(axis=0))
        cost = step.min(axis=0) + augmented[t]
    states = [int(cost.argmin())]
    for pointer in reversed(back):
        states.append(int(pointer[states[-1]]))
    worst = np.array(states[::-1])
    difference = chain_features(observed, worst) - chain_features(observed, truth)
    return Separation(difference, float((worst != truth).mean()))


def brute_force_chain(weights: NDArray[np.float64], example: Chain) -> float:
    observed, truth = example
    own = weights @ chain_features(observed, truth)
    return max(
        float((np.array(y) != truth).mean() - weights @ chain_features(observed, np.array(y)) + own)
        for y in itertools.product(range(STATES), repeat=LENGTH)
    )


@pytest.fixture
def points(rng: np.random.Generator) -> list[Point]:
    centres = rng.normal(0, 1.5, (CLASSES, FEATURES))
    return [(rng.normal(centres[y], 1.0), y) for y in rng.integers(0, CLASSES, 50).tolist()]


@pytest.fixture
def chains(rng: np.random.Generator) -> list[Chain]:
    stay = 0.7 * np.eye(STATES) + 0.1
    means = rng.normal(0, 1, (STATES, 2))
    result = []
    for _ in range(24):
        states = [int(rng.integers(STATES))]
        while len(states) < LENGTH:
            states.append(int(rng.choice(STATES, p=stay[states[-1]] / stay[states[-1]].sum())))
        result.append((rng.normal(means[states], 0.8), np.array(states)))
    return result


def primal(weights: NDArray[np.float64], points: list[Point], C: float) -> float:
    slack = np.mean([max(0.0, multiclass_oracle(weights, p).violation(weights)) for p in points])
    return 0.5 * float(weights @ weights) + C * float(slack)


@pytest.mark.parametrize("C", [1.0, 100.0])
def test_multiclass_svm_is_that_of_scikit_learn(points: list[Point], C: float) -> None:
    svm = pytest.importorskip("sklearn.svm", reason="scikit-learn is in the extra train")
    result = learn_one_slack(LocalSeparator(multiclass_oracle, points), np.zeros(12), SvmConfig(C, 1e-5 / C, 2000))
    reference = svm.LinearSVC(
        C=C / len(points),
        dual=True,
        multi_class="crammer_singer",
        fit_intercept=False,
        tol=1e-8,
        max_iter=200_000,
        random_state=0,
    ).fit(np.array([x for x, _ in points]), [y for _, y in points])
    assert result.converged
    assert primal(result.weights, points, C) == pytest.approx(primal(reference.coef_.ravel(), points, C), rel=1e-4)
    assert result.weights == pytest.approx(reference.coef_.ravel(), abs=0.02 * float(np.abs(reference.coef_).max()))


def test_chain_model_meets_every_constraint_of_brute_force(chains: list[Chain]) -> None:
    C = 10.0
    result = learn_one_slack(LocalSeparator(chain_oracle, chains), np.zeros(15), SvmConfig(C, 1e-4))
    assert result.converged
    slack = np.mean([brute_force_chain(result.weights, c) for c in chains])
    objective = 0.5 * float(result.weights @ result.weights) + C * float(slack)
    assert objective == pytest.approx(result.history[-1].objective, abs=1e-9)
    assert result.history[-1].dual <= objective <= result.history[-1].dual + C * 1e-4


def test_frank_wolfe_and_cutting_planes_find_the_same(chains: list[Chain]) -> None:
    separator = LocalSeparator(chain_oracle, chains)
    planes = learn_one_slack(separator, np.zeros(15), SvmConfig(10.0, 1e-4))
    blocks = learn_frank_wolfe(separator, np.zeros(15), SvmConfig(10.0, 2e-3, 400), seed=1)
    assert blocks.converged
    assert blocks.history[-1].objective == pytest.approx(planes.history[-1].objective, rel=0.01)
    apart = blocks.weights - planes.weights  # 1/2 ||w - w*||^2 <= gap, as the objective is strongly convex
    assert np.linalg.norm(apart) <= np.sqrt(2 * blocks.history[-1].gap) + np.sqrt(2 * planes.history[-1].gap)


def test_batches_of_frank_wolfe_converge_too(chains: list[Chain]) -> None:
    separator = LocalSeparator(chain_oracle, chains)
    result = learn_frank_wolfe(separator, np.zeros(15), SvmConfig(10.0, 5e-3, 600), seed=1, batch=4)
    assert result.converged
    assert result.history[-1].dual <= result.history[-1].objective


def test_bounds_enclose_and_rise(chains: list[Chain]) -> None:
    rows: list[SvmProgress] = []
    learn_one_slack(LocalSeparator(chain_oracle, chains), np.zeros(15), SvmConfig(10.0, 1e-3), rows.append)
    duals = [r.dual for r in rows]
    assert all(a <= b + 1e-6 for a, b in itertools.pairwise(duals))
    assert all(a.objective >= b.objective for a, b in itertools.pairwise(rows))
    assert all(r.dual <= r.objective + 1e-6 for r in rows)


def test_a_weight_no_example_speaks_about_stays_at_its_start(points: list[Point]) -> None:
    def padded(weights: NDArray[np.float64], example: Point) -> Separation:
        found = multiclass_oracle(weights[:12], example)
        return Separation(np.append(found.feature_difference, 0.0), found.loss)

    result = learn_one_slack(LocalSeparator(padded, points), np.append(np.zeros(12), 0.7), SvmConfig(10.0))
    assert result.weights[12] == 0.7
    assert np.abs(result.weights[:12]).max() > 0.1


def test_dual_solution_is_optimal_on_a_known_problem() -> None:
    alpha, value = solve_dual(np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([1.0, 1.0]), 100.0)
    assert alpha == pytest.approx([1.0, 0.25], abs=1e-6)
    assert value == pytest.approx(0.625, abs=1e-8)
    alpha, value = solve_dual(np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([1.0, 1.0]), 0.5)  # twice the same, C binds
    assert alpha.sum() == pytest.approx(0.5, abs=1e-7)
    assert value == pytest.approx(0.375, abs=1e-8)


def test_restart_from_a_checkpoint_ends_at_the_same_weights(chains: list[Chain], tmp_path: Path) -> None:
    separator = LocalSeparator(chain_oracle, chains)
    whole = learn_one_slack(separator, np.zeros(15), SvmConfig(10.0, 1e-4))
    file = tmp_path / "run.npz"
    first = learn_one_slack(separator, np.zeros(15), SvmConfig(10.0, 1e-4, max_rounds=7), checkpoint=file)
    assert not first.converged
    second = learn_one_slack(separator, np.zeros(15), SvmConfig(10.0, 1e-4), checkpoint=file)
    assert len(second.history) == len(whole.history) > 7
    np.testing.assert_array_equal(second.weights, whole.weights)


Learn = Callable[..., SvmResult]
LEARNERS = [learn_one_slack, partial(learn_frank_wolfe, seed=1)]


@pytest.mark.parametrize("learn", LEARNERS)
def test_a_checkpoint_of_another_problem_is_refused(learn: Learn, chains: list[Chain], tmp_path: Path) -> None:
    """Another C, start, oracle, or as many other examples: old weights must not come back under new names."""
    separator, file = LocalSeparator(chain_oracle, chains), tmp_path / "run.npz"
    learn(separator, np.zeros(15), SvmConfig(10.0, 1e-4, max_rounds=2), checkpoint=file)
    moved = [(observed + 1e-9 * (i == 7), states) for i, (observed, states) in enumerate(chains)]
    others: list[tuple[LocalSeparator[Any], NDArray[np.float64], SvmConfig]] = [
        (LocalSeparator(chain_oracle, moved), np.zeros(15), SvmConfig(10.0)),
        (LocalSeparator(chain_oracle, chains[::-1]), np.zeros(15), SvmConfig(10.0)),
        (LocalSeparator(multiclass_oracle, chains), np.zeros(15), SvmConfig(10.0)),
        (separator, np.zeros(15), SvmConfig(20.0)),
        (separator, np.ones(15), SvmConfig(10.0)),
    ]
    for problem in others:
        with pytest.raises(ValueError, match="other examples or settings; remove it"):
            learn(*problem, checkpoint=file)
    file.write_bytes(b"PK\x03\x04 cut")
    with pytest.raises(ValueError, match="no checkpoint"):
        learn(separator, np.zeros(15), SvmConfig(10.0), checkpoint=file)


def test_frank_wolfe_restarts_from_a_checkpoint_to_the_same_weights(chains: list[Chain], tmp_path: Path) -> None:
    separator, file = LocalSeparator(chain_oracle, chains), tmp_path / "run.npz"
    whole = learn_frank_wolfe(separator, np.zeros(15), SvmConfig(10.0, 1e-9, 20), seed=1)
    learn_frank_wolfe(separator, np.zeros(15), SvmConfig(10.0, 1e-9, 10), seed=1, checkpoint=file)
    second = learn_frank_wolfe(separator, np.zeros(15), SvmConfig(10.0, 1e-9, 20), seed=1, checkpoint=file)
    assert [r.round for r in second.history] == [r.round for r in whole.history] == list(range(1, 21))
    np.testing.assert_array_equal(second.weights, whole.weights)
    with pytest.raises(ValueError, match="other examples or settings"):
        learn_frank_wolfe(separator, np.zeros(15), SvmConfig(10.0), seed=2, checkpoint=file)


def test_frank_wolfe_tells_every_pass_and_its_dual_rises(chains: list[Chain]) -> None:
    separator, rows = LocalSeparator(chain_oracle, chains), list[SvmProgress]()
    config = SvmConfig(10.0, 1e-9, 7)
    result = learn_frank_wolfe(separator, np.zeros(15), config, 1, rows.append, gap_every=3)
    assert [row.round for row in rows] == list(range(1, 8))
    assert [math.isinf(row.objective) for row in rows] == [True, True, False, False, False, False, False]
    assert all(a.dual < b.dual for a, b in itertools.pairwise(rows))
    assert all(row.dual <= row.objective and 0 < row.loss <= 1 for row in rows)
    assert result.history == tuple(rows)


def test_frank_wolfe_stopped_before_its_first_measurement_is_measured_on_return(
    chains: list[Chain], tmp_path: Path
) -> None:
    separator, config, file = LocalSeparator(chain_oracle, chains), SvmConfig(10.0, 1e-9, 2), tmp_path / "run.npz"
    whole = learn_frank_wolfe(separator, np.zeros(15), config, 1)

    def stop(row: SvmProgress) -> None:
        if row.round == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learn_frank_wolfe(separator, np.zeros(15), replace(config, max_rounds=9), 1, stop, file)
    again = learn_frank_wolfe(separator, np.zeros(15), config, 1, checkpoint=file)
    np.testing.assert_array_equal(again.weights, whole.weights)


def test_no_example_and_bad_settings_are_refused() -> None:
    empty: LocalSeparator[Chain] = LocalSeparator(chain_oracle, [])
    with pytest.raises(ValueError, match="no example"):
        learn_one_slack(empty, np.zeros(15), SvmConfig())
    with pytest.raises(ValueError, match="no example"):
        learn_frank_wolfe(empty, np.zeros(15), SvmConfig(), seed=1)
    with pytest.raises(ValueError, match="above 0"):
        SvmConfig(C=0.0)
