"""Oracles of core/labelling.py: every labelling, the local-polytope LP and the MILP (SciPy's HiGHS)."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.optimize import LinearConstraint, milp
from scipy.sparse import coo_matrix

from room_layout_ros.core.labelling import LabelProblem


def naive_minimum(problem: LabelProblem, labels: int) -> float:
    """Least energy over all labellings with the first of the labels."""
    return min(problem.energy(np.array(x)) for x in itertools.product(range(labels), repeat=len(problem.unary)))


def linear_program(problem: LabelProblem, integral: bool) -> float:
    """Optimum of the standard relaxation: indicators per node and per edge that agree on their marginals."""
    nodes, labels = problem.unary.shape
    edges = len(problem.edges)
    n_node, n_edge = nodes * labels, edges * labels * labels
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    right: list[float] = []
    row = 0
    for i in range(nodes):
        for a in range(labels):
            rows.append(row)
            columns.append(i * labels + a)
            values.append(1.0)
        right.append(1.0)
        row += 1
    for e, (i, j) in enumerate(problem.edges):
        base = n_node + e * labels * labels
        for a in range(labels):
            for node, cells in (
                (i, range(base + a * labels, base + (a + 1) * labels)),
                (j, range(base + a, base + labels * labels, labels)),
            ):
                rows.extend([row] * (labels + 1))
                columns.extend([*cells, int(node) * labels + a])
                values.extend([1.0] * labels + [-1.0])
                right.append(0.0)
                row += 1
    matrix = coo_matrix((values, (rows, columns)), shape=(row, n_node + n_edge)).tocsr()
    cost = np.concatenate([problem.unary.ravel(), problem.pairwise.ravel()])
    whole = np.concatenate([np.full(n_node, int(integral)), np.zeros(n_edge)])
    result = milp(cost, constraints=LinearConstraint(matrix, right, right), integrality=whole, bounds=(0, 1))
    assert result.success, result.message
    return float(result.fun)
