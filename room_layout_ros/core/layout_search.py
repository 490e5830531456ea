"""Exact search over layouts: the minimum, min-marginals and good starts of a 4-cycle (docs/method.md, section 8).

The cost of a layout (y1, y2, y3, y4) is P13 + P14 + P23 + P24, four pair tables (`integral_geometry.PairTables`, unary
terms added in). For fixed (y1, y2) the best y3 and the best y4 are independent, so
  T(y1, y2) = min_y3 [P13 + P23] + min_y4 [P14 + P24]
is exact, in O(|Y|^3), and its minimum is the global one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .integral_geometry import PairTables

Layout = tuple[int, int, int, int]
"""State indices of ceiling, floor, left and right ray."""

StateCosts = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""A value per state of the ceiling, floor, left and right ray."""


@dataclass(frozen=True, slots=True)
class RankedLayout:
    """One layout and its cost."""

    layout: Layout
    energy: float


def layout_energy(tables: PairTables, layout: Layout) -> float:
    """Return the cost of one layout."""
    i1, i2, j3, j4 = layout
    return float(tables[0][i1, j3] + tables[1][i1, j4] + tables[2][i2, j3] + tables[3][i2, j4])


def add_unaries(tables: PairTables, unaries: StateCosts) -> PairTables:
    """Return the tables with a cost per state of ceiling, floor, left and right ray added (each once)."""
    ceiling, floor, left, right = unaries
    return (
        tables[0] + (ceiling[:, None] + left),
        tables[1] + right,
        tables[2] + floor[:, None],
        tables[3],
    )


def search_layout(tables: PairTables) -> RankedLayout:
    """Return the layout of least cost; of equal ones the first in the order of states.

    Parameters
    ----------
    tables : PairTables
        float64 costs without NaN.
    """
    return _least(tables, complete(tables))


def complete(tables: PairTables) -> NDArray[np.float64]:
    """(n1, n2): the least cost of a layout with each ceiling and floor."""
    return _eliminate(tables[0], tables[2]) + _eliminate(tables[1], tables[3])


def _least(tables: PairTables, completed: NDArray[np.float64]) -> RankedLayout:
    i1, i2 = divmod(int(completed.argmin()), completed.shape[1])
    j3 = int((tables[0][i1] + tables[2][i2]).argmin())
    j4 = int((tables[1][i1] + tables[3][i2]).argmin())
    return RankedLayout((i1, i2, j3, j4), layout_energy(tables, (i1, i2, j3, j4)))


def min_marginals(tables: PairTables) -> StateCosts:
    """Return, for each state of ceiling, floor, left and right ray, the least cost of a layout that has it."""
    over_walls, over_levels = _completed(*tables)
    return over_walls.min(axis=1), over_walls.min(axis=0), over_levels.min(axis=1), over_levels.min(axis=0)


def diverse_layouts(tables: PairTables, count: int, distance: int = 4) -> list[RankedLayout]:
    """Return up to `count` layouts by rising cost that differ by more than `distance` states in some ray.

    The first is the global minimum. The candidates are the best completions of every (y1, y2) and of every (y3, y4), so
    the costs are exact but a layout that is best for neither pair is not offered.
    """
    layouts, energies = _diverse(*tables, count, distance)
    chosen = [RankedLayout(tuple(layout), e) for layout, e in zip(layouts.tolist(), energies.tolist(), strict=True)]
    return sorted(chosen, key=lambda ranked: ranked.energy)


@njit(cache=True, nogil=True)
def _completed(upper_left, upper_right, lower_left, lower_right):  # type: ignore[no-untyped-def]
    """Least cost of a layout with each ceiling and floor (n1, n2), and with each left and right wall (n3, n4)."""
    levels = np.empty((len(upper_left), len(lower_left)))
    part = np.empty_like(levels)
    min_plus(upper_left, np.ascontiguousarray(lower_left.T), levels)
    min_plus(upper_right, np.ascontiguousarray(lower_right.T), part)
    levels += part
    walls = np.empty((upper_left.shape[1], upper_right.shape[1]))
    rest = np.empty_like(walls)
    min_plus(np.ascontiguousarray(upper_left.T), upper_right, walls)
    min_plus(np.ascontiguousarray(lower_left.T), lower_right, rest)
    walls += rest
    return levels, walls


@njit(cache=True, nogil=True)
def _diverse(upper_left, upper_right, lower_left, lower_right, count, distance):  # type: ignore[no-untyped-def]
    """(n, 4) layouts in the order found, and their energies."""
    levels, walls = _completed(upper_left, upper_right, lower_left, lower_right)
    layouts, energies, n = np.empty((count, 4), np.int64), np.empty(count), 0
    while n < count:
        level, wall = levels.argmin(), walls.argmin()
        least_level, least_wall = levels.flat[level], walls.flat[wall]
        if min(least_level, least_wall) == np.inf:  # all are near a chosen one
            break
        if n == 0 or least_level <= least_wall:
            i1, i2 = level // levels.shape[1], level % levels.shape[1]
            j3, j4 = (upper_left[i1] + lower_left[i2]).argmin(), (upper_right[i1] + lower_right[i2]).argmin()
        else:
            j3, j4 = wall // walls.shape[1], wall % walls.shape[1]
            i1 = (upper_left[:, j3] + upper_right[:, j4]).argmin()
            i2 = (lower_left[:, j3] + lower_right[:, j4]).argmin()
        if n == 0 or least_level <= least_wall:
            _close(levels, i1, i2, distance)
        if n == 0 or not least_level <= least_wall:
            _close(walls, j3, j4, distance)
        layouts[n, 0], layouts[n, 1], layouts[n, 2], layouts[n, 3] = i1, i2, j3, j4
        energies[n] = upper_left[i1, j3] + upper_right[i1, j4] + lower_left[i2, j3] + lower_right[i2, j4]
        far = True
        for c in range(n):
            far = far and np.abs(layouts[n] - layouts[c]).max() > distance
        n += int(far)
    return layouts[:n], energies[:n]


@njit(cache=True, nogil=True)
def _close(costs, a, b, distance):  # type: ignore[no-untyped-def]
    """Leave out what is near a pair of states."""
    costs[max(0, a - distance) : a + distance + 1, max(0, b - distance) : b + distance + 1] = np.inf


def turned(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transpose, contiguous."""
    return np.ascontiguousarray(table.T)


def _eliminate(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, m) min over k of first[n, k] + second[m, k]."""
    result = np.empty((len(first), len(second)))
    min_plus(np.ascontiguousarray(first), turned(second), result)
    return result


@njit(cache=True, nogil=True)
def min_plus(first, second, result):  # type: ignore[no-untyped-def]
    """result[n, m] = min over k of first[n, k] + second[k, m]; four k at a time, so that a row is read less often."""
    n, depth = first.shape
    whole = depth - depth % 4
    for i in range(n):
        row = result[i]
        row[:] = np.inf
        for k in range(0, whole, 4):
            a, b, c, d = first[i, k], first[i, k + 1], first[i, k + 2], first[i, k + 3]
            for j in range(second.shape[1]):  # the innermost loop runs over a row, so that it can be vectorised
                one = min(a + second[k, j], b + second[k + 1, j])
                two = min(c + second[k + 2, j], d + second[k + 3, j])
                row[j] = min(row[j], min(one, two))
        for k in range(whole, depth):
            for j in range(second.shape[1]):
                row[j] = min(row[j], first[i, k] + second[k, j])
