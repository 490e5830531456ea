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
from .layout_search import Layout, layout_energy, min_plus
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
    limit = np.inf if known is None else layout_energy(tables, known[0]) + planes.of(*known)
    energy, c, *states = _search_scales(*tables, planes.sides, planes.starts, planes.constant, limit - _TIE)
    if c >= 0:
        ceiling, floor, left, right = states
        return PlacedLayout((ceiling, floor, left, right), c, energy)
    if known is None:
        raise AssertionError("no scale to search")
    return PlacedLayout(*known, limit)


@njit(cache=True, nogil=True)
def _search_scales(upper_left, upper_right, lower_left, lower_right, sides, starts, constant, limit):  # type: ignore[no-untyped-def]
    """Least energy below `limit`, its scale and its four states; a scale of -1 where there is none."""
    lower_left, lower_right = np.ascontiguousarray(lower_left.T), np.ascontiguousarray(lower_right.T)
    alone = np.empty((len(upper_left), lower_left.shape[1]))
    over_right = np.empty_like(alone)
    min_plus(upper_left, lower_left, alone)
    min_plus(upper_right, lower_right, over_right)
    alone += over_right
    bounds = _bounds(alone, sides, starts, constant)
    energy, scale, states = np.inf, -1, (-1, -1, -1, -1)
    for c in np.argsort(bounds, kind="mergesort"):
        if bounds[c] >= limit:
            break
        side = sides[c]
        least, i, j, j3, j4 = _search(
            upper_left, upper_right, lower_left, lower_right, alone,
            side[: starts[1]], side[starts[1] : starts[2]], side[starts[2] : starts[3]], side[starts[3] :],
            limit - constant[c],
        )  # fmt: skip
        if i >= 0:
            energy, scale, states = least + constant[c], c, (i, j, j3, j4)
            limit = energy - _TIE
    return energy, scale, states[0], states[1], states[2], states[3]


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
