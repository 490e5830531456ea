"""Message passing against the truth: brute force, linear and integer programs."""

from __future__ import annotations

import numpy as np
import pytest
from naive_labelling import linear_program, naive_minimum
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from room_layout_ros.core.labelling import Labelling, LabelProblem, LabelSolver


def solve(problem: LabelProblem, sweeps: int = 20, start: Labelling | None = None) -> Labelling:
    return LabelSolver(problem).solve(problem.unary, sweeps, start)


def with_labels(unary: NDArray[np.float64], edges: NDArray[np.int32], pairwise: NDArray[np.float64]) -> LabelProblem:
    """A problem of fewer than six labels: the others cost more than any labelling."""
    missing = 6 - unary.shape[1]
    worst = 1.0 + 2.0 * (np.abs(unary).sum() + np.abs(pairwise).sum())
    return LabelProblem(
        np.pad(unary, ((0, 0), (0, missing)), constant_values=worst),
        edges,
        np.pad(pairwise, ((0, 0), (0, missing), (0, missing))),
    )


def planar_problem(rng: np.random.Generator, nodes: int, strength: float, labels: int = 6) -> LabelProblem:
    """Random costs on a triangulation, penalties on a quarter of the label pairs: not submodular."""
    triangles = Delaunay(rng.uniform(size=(nodes, 2))).simplices
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]])
    edges = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int32)
    shape = (len(edges), labels, labels)
    penalty = rng.uniform(size=shape) * (rng.uniform(size=shape) < 0.25) + 0.3 * (1.0 - np.eye(labels))
    return with_labels(rng.uniform(size=(nodes, labels)), edges, strength * penalty)


def test_bound_and_energy_enclose_the_optimum_of_small_problems(rng: np.random.Generator) -> None:
    optimal = 0
    for _ in range(100):
        problem = planar_problem(rng, 7, 0.8, labels=3)
        truth = naive_minimum(problem, labels=3)
        found = solve(problem, sweeps=50)
        assert found.bound <= truth + 1e-9
        assert found.energy >= truth - 1e-9
        assert found.energy == pytest.approx(problem.energy(found.labels), abs=1e-12)
        optimal += found.energy <= truth + 1e-9
    assert optimal >= 90


@pytest.mark.parametrize("strength", (0.05, 0.1))
def test_bound_equals_the_linear_program_where_that_is_tight(rng: np.random.Generator, strength: float) -> None:
    problem = planar_problem(rng, 50, strength)
    relaxed, exact = linear_program(problem, integral=False), linear_program(problem, integral=True)
    assert relaxed == pytest.approx(exact, abs=1e-6)  # the regime of the joint model: unary evidence dominates
    found = solve(problem, sweeps=300)
    assert found.bound == pytest.approx(relaxed, abs=1e-3)
    assert found.bound <= relaxed + 1e-6
    assert found.energy == pytest.approx(exact, abs=1e-6)


def test_bound_never_passes_the_linear_program_where_that_is_loose(rng: np.random.Generator) -> None:
    problem = planar_problem(rng, 40, 1.5, labels=4)
    found = solve(problem, sweeps=100)
    assert found.bound <= linear_program(problem, integral=False) + 1e-6
    assert found.bound <= found.energy


def test_a_tree_is_solved_exactly(rng: np.random.Generator) -> None:
    edges = np.array([[int(rng.integers(i)), i] for i in range(1, 9)], dtype=np.int32)
    problem = with_labels(rng.normal(size=(9, 3)), edges, rng.normal(size=(8, 3, 3)))
    found = solve(problem, sweeps=100)
    assert found.energy == pytest.approx(naive_minimum(problem, labels=3), abs=1e-9)
    assert found.bound == pytest.approx(found.energy, abs=1e-6)


def test_more_sweeps_never_lower_the_bound(rng: np.random.Generator) -> None:
    problem = planar_problem(rng, 80, 1.0)
    bounds = [solve(problem, sweeps=n).bound for n in (1, 2, 4, 8, 16, 32)]
    assert bounds == sorted(bounds)


def test_a_warm_start_costs_no_more_than_its_labels(rng: np.random.Generator) -> None:
    problem = planar_problem(rng, 80, 1.0)
    first = solve(problem, sweeps=20)
    changed = LabelProblem(problem.unary + rng.normal(0, 0.2, problem.unary.shape), problem.edges, problem.pairwise)
    warm = solve(changed, sweeps=1, start=first)
    assert warm.energy <= changed.energy(first.labels) + 1e-12
    assert warm.bound <= solve(changed, sweeps=200).energy + 1e-9


def test_a_problem_without_edges_is_solved_per_node(rng: np.random.Generator) -> None:
    unary = rng.normal(size=(5, 6))
    found = solve(LabelProblem(unary, np.empty((0, 2), np.int32), np.empty((0, 6, 6))))
    assert found.labels.tolist() == unary.argmin(axis=1).tolist()
    assert found.bound == pytest.approx(found.energy)


def test_same_input_gives_the_same_bytes(rng: np.random.Generator) -> None:
    problem = planar_problem(rng, 80, 1.0)
    a, b = solve(problem), solve(problem)
    assert a.labels.tobytes() == b.labels.tobytes()
    assert a.messages.tobytes() == b.messages.tobytes()


def test_malformed_problems_are_refused() -> None:
    edge, cost = np.array([[0, 1]], np.int32), np.zeros((1, 6, 6))
    with pytest.raises(ValueError, match=r"an edge is not \(i, j\) with 0 <= i < j < 2"):
        LabelProblem(np.zeros((2, 6)), edge[:, ::-1].copy(), cost)
    with pytest.raises(ValueError, match=r"unary costs are \(2, 3\); \(K, 6\) is needed"):
        LabelProblem(np.zeros((2, 3)), edge, cost)
    with pytest.raises(ValueError, match=r"\(E, 2\) and \(E, 6, 6\) are needed"):
        LabelProblem(np.zeros((2, 6)), edge, np.zeros((1, 3, 3)))
    with pytest.raises(ValueError, match="a labelling cost is not finite; all must be"):
        LabelProblem(np.full((2, 6), np.nan), edge, cost)
