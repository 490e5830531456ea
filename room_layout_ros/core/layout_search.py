"""Exact search over layouts: the minimum, min-marginals and the M best of a 4-cycle (docs/method.md, section 8).

The cost of a layout (y1, y2, y3, y4) is P13 + P14 + P23 + P24, four pair tables (`integral_geometry.PairTables`, unary
terms added in). For fixed (y1, y2) the best y3 and the best y4 are independent, so
  T(y1, y2) = min_y3 [P13 + P23] + min_y4 [P14 + P24]
is exact, in O(|Y|^3), and its minimum is the global one.
"""

from __future__ import annotations

import heapq
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


def _complete_walls(tables: PairTables) -> NDArray[np.float64]:
    """(n3, n4): the least cost of a layout with each left and right wall."""
    upper, lower = _eliminate(turned(tables[0]), turned(tables[1])), _eliminate(turned(tables[2]), turned(tables[3]))
    return upper + lower


def _least(tables: PairTables, completed: NDArray[np.float64]) -> RankedLayout:
    i1, i2 = divmod(int(completed.argmin()), completed.shape[1])
    j3 = int((tables[0][i1] + tables[2][i2]).argmin())
    j4 = int((tables[1][i1] + tables[3][i2]).argmin())
    return RankedLayout((i1, i2, j3, j4), layout_energy(tables, (i1, i2, j3, j4)))


def min_marginals(tables: PairTables) -> StateCosts:
    """Return, for each state of ceiling, floor, left and right ray, the least cost of a layout that has it."""
    over_walls, over_levels = complete(tables), _complete_walls(tables)
    return over_walls.min(axis=1), over_walls.min(axis=0), over_levels.min(axis=1), over_levels.min(axis=0)


def best_layouts(tables: PairTables, count: int) -> list[RankedLayout]:
    """Return the `count` layouts of least cost in order (fewer where there are fewer), exactly.

    A best-first expansion: each (y1, y2) offers its layouts by rank of y3 and rank of y4.
    """
    table = complete(tables)
    n2 = table.shape[1]
    first = np.argsort(table, axis=None, kind="stable")[:count]  # only these pairs can hold one of the best
    heap: list[tuple[float, int, int, int]] = [(float(table.flat[p]), int(p), 0, 0) for p in first]
    heapq.heapify(heap)
    orders: dict[int, tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]] = {}
    result: list[RankedLayout] = []
    seen: set[tuple[int, int, int]] = set()
    while heap and len(result) < count:
        _, pair, r3, r4 = heapq.heappop(heap)
        if (pair, r3, r4) in seen:
            continue
        seen.add((pair, r3, r4))
        i1, i2 = divmod(pair, n2)
        if pair not in orders:
            c3, c4 = tables[0][i1] + tables[2][i2], tables[1][i1] + tables[3][i2]
            o3, o4 = np.argsort(c3, kind="stable"), np.argsort(c4, kind="stable")
            orders[pair] = (c3[o3], c4[o4], o3, o4)
        s3, s4, o3, o4 = orders[pair]
        layout = (i1, i2, int(o3[r3]), int(o4[r4]))
        result.append(RankedLayout(layout, layout_energy(tables, layout)))
        for n3, n4 in ((r3 + 1, r4), (r3, r4 + 1)):
            if n3 < len(s3) and n4 < len(s4):
                heapq.heappush(heap, (float(s3[n3] + s4[n4]), pair, n3, n4))
    return result


def diverse_layouts(tables: PairTables, count: int, distance: int = 4) -> list[RankedLayout]:
    """Return up to `count` layouts by rising cost that differ by more than `distance` states in some ray.

    The first is the global minimum. The candidates are the best completions of every (y1, y2) and of every (y3, y4), so
    the costs are exact but a layout that is best for neither pair is not offered.
    """
    levels, walls = complete(tables), _complete_walls(tables)
    chosen = [_least(tables, levels)]
    level_open, wall_open = np.ones(levels.shape, bool), np.ones(walls.shape, bool)
    _close(level_open, chosen[0].layout[:2], distance)
    _close(wall_open, chosen[0].layout[2:], distance)
    while len(chosen) < count:
        level_best = np.where(level_open, levels, np.inf)
        wall_best = np.where(wall_open, walls, np.inf)
        if not (level_open.any() or wall_open.any()):
            break
        if level_best.min() <= wall_best.min():
            i1, i2 = (int(v) for v in np.unravel_index(int(level_best.argmin()), levels.shape))
            layout = (
                i1,
                i2,
                int((tables[0][i1] + tables[2][i2]).argmin()),
                int((tables[1][i1] + tables[3][i2]).argmin()),
            )
            _close(level_open, layout[:2], distance)
        else:
            j3, j4 = (int(v) for v in np.unravel_index(int(wall_best.argmin()), walls.shape))
            i1 = int((tables[0][:, j3] + tables[1][:, j4]).argmin())
            i2 = int((tables[2][:, j3] + tables[3][:, j4]).argmin())
            layout = (i1, i2, j3, j4)
            _close(wall_open, layout[2:], distance)
        if all(max(abs(a - b) for a, b in zip(layout, c.layout, strict=True)) > distance for c in chosen):
            chosen.append(RankedLayout(layout, layout_energy(tables, layout)))
    return sorted(chosen, key=lambda ranked: ranked.energy)


def _close(open_: NDArray[np.bool_], centre: tuple[int, ...], distance: int) -> None:
    a, b = centre
    open_[max(0, a - distance) : a + distance + 1, max(0, b - distance) : b + distance + 1] = False


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
