"""Exact search over layouts and metric scales together (docs/method.md, section 8).

At a given scale the planes' offsets are known, so depth adds a cost per state of each ray and a constant. With the
best completion T(y1, y2) of every ceiling and floor from the tables alone, T + ceiling + floor + least left + least
right bounds every layout at that scale from below: scales, and within one the ceilings, are left out whose bound is not
below the best layout so far.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from .integral_geometry import PairTables
from .layout_search import Layout, complete, layout_energy, min_plus, turned
from .plane_costs import PlaneCosts

_TIE = 1e-12


@dataclass(frozen=True, slots=True)
class PlacedLayout:
    """A layout, the number of its scale and its energy under the tables it was found with."""

    layout: Layout
    scale: int
    energy: float


def best_layout(tables: PairTables, planes: PlaneCosts, known: tuple[Layout, int] | None = None) -> PlacedLayout:
    """Return the exact minimum over layouts and scales.

    `known`, the layout before, is kept unless another is better; of equal scales the one of the lower bound wins.
    """
    best = None
    if known is not None:
        best = PlacedLayout(*known, layout_energy(tables, known[0]) + planes.of(*known))
    lower = turned(tables[2]), turned(tables[3])
    alone = complete(tables)
    bounds = _bounds(alone, planes.sides, planes.starts, planes.constant)
    for c in np.argsort(bounds, kind="stable").tolist():
        limit = np.inf if best is None else best.energy - _TIE
        if bounds[c] >= limit:
            break
        energy, *layout = _search(
            tables[0], tables[1], *lower, alone, *planes.unaries(c), limit - float(planes.constant[c])
        )
        if layout[0] >= 0:
            ceiling, floor, left, right = layout
            best = PlacedLayout((ceiling, floor, left, right), c, energy + float(planes.constant[c]))
    if best is None:
        raise AssertionError("no scale to search")
    return best


@njit(cache=True, nogil=True)
def _bounds(alone, sides, starts, constant):  # type: ignore[no-untyped-def]
    """(C,) lower bounds over all layouts."""
    bounds = np.empty(len(constant))
    for c in range(len(constant)):
        side = sides[c]
        least = np.inf
        for i in range(alone.shape[0]):
            for j in range(alone.shape[1]):
                cost = alone[i, j] + side[i] + side[starts[1] + j]
                least = cost if cost < least else least
        bounds[c] = least + side[starts[2] : starts[3]].min() + side[starts[3] : starts[4]].min() + constant[c]
    return bounds


@njit(cache=True, nogil=True)
def _search(upper_left, upper_right, lower_left, lower_right, alone, ceiling, floor, left, right, limit):  # type: ignore[no-untyped-def]
    """Least energy below `limit` and its four states, the lower tables turned; states of -1 where there is none."""
    rest = left.min() + right.min()
    bound = np.empty(len(ceiling))
    for i in range(len(ceiling)):
        bound[i] = (alone[i] + floor).min() + ceiling[i] + rest
    best, at, under = limit, -1, -1
    of_left, of_right = np.empty((1, len(floor))), np.empty((1, len(floor)))
    for i in np.argsort(bound):
        if bound[i] >= best:
            break
        min_plus((upper_left[i] + left).reshape(1, -1), lower_left, of_left)
        min_plus((upper_right[i] + right).reshape(1, -1), lower_right, of_right)
        for j in range(len(floor)):
            energy = of_left[0, j] + of_right[0, j] + ceiling[i] + floor[j]
            if energy < best:
                best, at, under = energy, i, j
    if at < 0:
        return best, -1, -1, -1, -1
    j3 = (upper_left[at] + left + lower_left[:, under]).argmin()
    j4 = (upper_right[at] + right + lower_right[:, under]).argmin()
    return best, at, under, j3, j4
