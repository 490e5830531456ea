"""What the offsets of a layout's planes cost at every metric scale (docs/method.md, section 6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth_profiles import curve_position, read_curve_at
from .joint_problem import JointProblem
from .labels import FRONT_FACE
from .layout_search import Layout, StateCosts
from .ray_grid import SIDE_FACE
from .weights import ModelWeights

_SIDE_FACE = np.array(SIDE_FACE) - 1


@dataclass(frozen=True, slots=True)
class PlaneCosts:
    """Costs of the planes' offsets at every candidate scale.

    Attributes
    ----------
    sides : (C, S) float64 costs per scale and state; the states of ceiling, floor, left and right one after another.
    starts : (5,) int64, where the states of each side start.
    constant : (C,) float64 cost of the front wall and of what depends on no ray.
    positions, front_positions : (C, S), (C,) where the planes lie on curves over the offsets; NaN for an absent one.
    """

    sides: NDArray[np.float64]
    starts: NDArray[np.int64]
    constant: NDArray[np.float64]
    positions: NDArray[np.float64]
    front_positions: NDArray[np.float64]

    def of(self, layout: Layout, c: int) -> float:
        """Return the cost of one layout at scale number c."""
        row, starts = self.sides[c], self.starts
        return float(self.constant[c] + sum(row[starts[side] + state] for side, state in enumerate(layout)))

    def unaries(self, c: int) -> StateCosts:
        """Return the costs of the four sides' states at scale number c."""
        ceiling, floor, left, right = (self.sides[c, a:b] for a, b in zip(self.starts, self.starts[1:], strict=False))
        return ceiling, floor, left, right


def plane_costs(problem: JointProblem, weights: ModelWeights) -> PlaneCosts:
    """Return support, violation and absence of the planes, and the cost of the front axis (`with_fit` adds more)."""
    grid, scales = problem.counts.grid, problem.scales
    front = float(weights.block("front_axis")[0]) * problem.front_axis
    alone = PlaneCosts(*_alone(grid.states, grid.state_counts, scales, weights.block("face_absent"), front))
    if problem.profiles is None:
        return alone
    support, violation = weights.block("plane_support"), weights.block("plane_violation")
    curves = support[:, None] * problem.profiles.support + violation[:, None] * problem.profiles.violation
    return _with_curves(alone, curves, np.zeros(len(curves)))


@njit(cache=True, nogil=True)
def _alone(states, counts, scales, absent, front):  # type: ignore[no-untyped-def]
    """Costs that depend on no depth, and where the planes lie."""
    starts = np.zeros(5, np.int64)
    starts[1:] = np.cumsum(counts)
    sides, positions = np.zeros((len(scales), starts[4])), np.empty((len(scales), starts[4]))
    constant, front_positions = np.full(len(scales), front), np.empty(len(scales))
    for c in range(len(scales)):
        front_positions[c] = curve_position(scales[c])
        for side in range(4):
            for s in range(counts[side]):
                positions[c, starts[side] + s] = curve_position(states[side, s] * scales[c])
            sides[c, starts[side + 1] - 1] = absent[side]  # the last state of a side
    return sides, starts, constant, positions, front_positions


def with_fit(
    planes: PlaneCosts,
    problem: JointProblem,
    weights: ModelWeights,
    labels: NDArray[np.int64],
    area: NDArray[np.float64] | None = None,
) -> PlaneCosts:
    """Return the costs of the planes with the fit of labels (K,) added; `area` is the problem's, if at hand."""
    if problem.fit is None:
        return planes
    area = problem.area if area is None else area
    return _with_curves(planes, *problem.fit.curves(labels, area, weights.block("plane_fit")))


def _with_curves(planes: PlaneCosts, curves: NDArray[np.float64], absent: NDArray[np.float64]) -> PlaneCosts:
    """Add a cost per face and offset (5, n), and per absent face (5,)."""
    sides, constant = planes.sides.copy(), planes.constant.copy()
    _add_curves(sides, constant, planes.starts, planes.positions, planes.front_positions, curves, absent)
    return replace(planes, sides=sides, constant=constant)


@njit(cache=True, nogil=True)
def _add_curves(sides, constant, starts, positions, front_positions, curves, absent):  # type: ignore[no-untyped-def]
    for c in range(len(constant)):
        constant[c] += read_curve_at(curves[FRONT_FACE], absent[FRONT_FACE], front_positions[c])
        for side in range(4):
            face = _SIDE_FACE[side]
            for s in range(starts[side], starts[side + 1]):
                sides[c, s] += read_curve_at(curves[face], absent[face], positions[c, s])
