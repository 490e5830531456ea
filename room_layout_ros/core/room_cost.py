"""What a cuboid costs against the cells of a frame.

Cells of the image carry a depth and the probability to be ceiling, floor, wall or clutter. A cuboid costs what these
say against it: structure on a face of another kind, structure off its plane, clutter behind a wall, clutter far in
front of one (weakly: things stand at walls). Beyond the paper (docs/method.md, section 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .labels import N_FACES
from .layout import face_of_ray, plane_rows
from .room_cells import RoomCells

COSTS = np.array([1.5, 0.8, 0.12, 0.004, 0.10, 0.025, 0.7, 0.0, 0.15, 0.05])
"""Wrong kind of face (also: no face), clutter beyond, clutter apart per metre (to 1 m), each face in use, tolerance
in m and per metre, factor for wall beyond (windows, doors and mirrors show what is behind), wall of another name (depth
decides better); by the scene network's layout: another kind of face, wall of another name. Unit: a wall cell that is
off its plane."""

IMAGE_COSTS = np.concatenate([COSTS[:7], [0.5, 0.5, 0.1]])
"""The same for cells without depth, where the name is all that tells one wall from the next."""

MIN_DISTANCE_M = 0.05
"""No face is nearer to the camera."""


_X, _Y, _DEPTH, _STEEP, _CLUTTER, _ON, _KIND = 0, 1, 2, 3, 4, 5, 8
_N_TERMS = _KIND + N_FACES + 1
_PADDING = 8
"""Rows a power of two apart would push each other out of the cache."""
_FARTHEST = 1e-3
"""A face more than a kilometre away is no face."""
_BLOCK = 64
"""A cuboid that costs too much is left after so many cells."""


@dataclass(frozen=True, slots=True)
class FittedRoom:
    """A cuboid and its mean cost per cell (0 perfect, above 0.5 no room)."""

    R_room_camera: NDArray[np.float64]
    distances: NDArray[np.float64]
    cost: float


@dataclass(frozen=True, slots=True)
class CellCosts:
    """What each cell costs on each face, as far as that depends on no cuboid.

    Attributes
    ----------
    cells : RoomCells. costs : (10,) float64, see `COSTS`.
    terms : (14, n + padding) float64: x and y of the ray at z = 1; depth in m, 0 where not measured; 1 / tolerance;
        probability of clutter; of ceiling, floor and wall, which is what a cell off its plane costs (these 0 where not
        measured); cost by kind and name on each face (5) and on none.
    """

    cells: RoomCells
    costs: NDArray[np.float64]
    terms: NDArray[np.float64]


def cell_costs(cells: RoomCells, costs: NDArray[np.float64] = COSTS) -> CellCosts:
    """Prepare cells for the search of a cuboid."""
    terms = _gather_terms(cells.rays, cells.inverse_depth, cells.probability, cells.behind, costs)
    return CellCosts(cells, costs, terms)


def rate_room(cells: CellCosts, room: FittedRoom) -> FittedRoom:
    """Return the room with its cost."""
    R, distances = room.R_room_camera, room.distances
    cost = mean_cost(cells.terms, R, distances, cells.costs, len(cells.cells.rays), np.inf)
    return FittedRoom(R, distances, float(cost))


@njit(cache=True, nogil=True)
def _gather_terms(rays, inverse_depth, probability, behind, costs):  # type: ignore[no-untyped-def]
    terms = np.zeros((_N_TERMS, len(rays) + _PADDING))
    for i in range(len(rays)):
        p, q, w, z = probability[i], behind[i], inverse_depth[i], rays[i, 2]
        walls, walls_behind = p[2] + p[3] + p[4], q[2] + q[3] + q[4]
        structure, known = p[0] + p[1] + walls, q[0] + q[1] + walls_behind
        terms[_X, i], terms[_Y, i] = rays[i, 0] / z, rays[i, 1] / z
        for face in range(2):
            terms[_KIND + face, i] = costs[8] * (known - q[face]) + costs[0] * (structure - p[face])
        for face in range(2, N_FACES):
            kind = costs[8] * (known - walls_behind) + costs[0] * (structure - walls)
            terms[_KIND + face, i] = kind + costs[9] * (walls_behind - q[face]) + costs[7] * (walls - p[face])
        terms[_KIND + N_FACES, i] = costs[0] * structure + costs[1] * p[5] + costs[8] * known
        if w > 0.0:
            terms[_DEPTH, i], terms[_STEEP, i] = z / w, 1.0 / (costs[4] + costs[5] / w)
            terms[_CLUTTER, i], terms[_ON, i], terms[_ON + 1, i], terms[_ON + 2, i] = p[5], p[0], p[1], walls
    return terms


@njit(cache=True, nogil=True, inline="always")
def face_of_point(m, x, y, z):  # type: ignore[no-untyped-def]
    """`layout.face_of_ray` of the ray through a point P = (x, y, z), none where its face is too far; m . P of it."""
    return face_of_ray(m, x, y, z, _FARTHEST * z)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _sum_costs(terms, m, distances, costs, first, last):  # type: ignore[no-untyped-def]
    """Cost of the cells `first` to `last` for a cuboid of rows m = n_k / d_k.

    Written out for each face and with what is read apart from what is chosen, so that the compiler vectorises it: six
    times as fast as a loop with branches.
    """
    x, y, depth, steep, clutter = (
        terms[_X, first:last], terms[_Y, first:last], terms[_DEPTH, first:last], terms[_STEEP, first:last],
        terms[_CLUTTER, first:last],
    )  # fmt: skip
    ceiling, floor, wall = terms[_ON, first:last], terms[_ON + 1, first:last], terms[_ON + 2, first:last]
    kind0, kind1, kind2, kind3, kind4, kind5 = (
        terms[_KIND, first:last], terms[_KIND + 1, first:last], terms[_KIND + 2, first:last],
        terms[_KIND + 3, first:last], terms[_KIND + 4, first:last], terms[_KIND + 5, first:last],
    )  # fmt: skip
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = _row(m, 0), _row(m, 1), _row(m, 2)
    (x3, y3, z3), (x4, y4, z4) = _row(m, 3), _row(m, 4)
    d0, d1, d2, d3, d4 = distances[0], distances[1], distances[2], distances[3], distances[4]
    beyond_clutter, apart, beyond_wall = costs[1], costs[2], costs[6]
    total = 0.0
    for i in range(last - first):
        on, of_ceiling, of_floor = wall[i], ceiling[i], floor[i]
        k0, k1, k2, k3, k4, kind = kind0[i], kind1[i], kind2[i], kind3[i], kind4[i], kind5[i]
        best, d, factor = _FARTHEST, 0.0, beyond_wall  # as `face_of_point`
        value = x2 * x[i] + y2 * y[i] + z2
        d, kind, best = d2 if value > best else d, k2 if value > best else kind, max(value, best)
        value = x3 * x[i] + y3 * y[i] + z3
        d, kind, best = d3 if value > best else d, k3 if value > best else kind, max(value, best)
        value = x4 * x[i] + y4 * y[i] + z4
        d, kind, best = d4 if value > best else d, k4 if value > best else kind, max(value, best)
        value = x0 * x[i] + y0 * y[i] + z0
        on, factor = of_ceiling if value > best else on, 1.0 if value > best else factor
        d, kind, best = d0 if value > best else d, k0 if value > best else kind, max(value, best)
        value = x1 * x[i] + y1 * y[i] + z1
        on, factor = of_floor if value > best else on, 1.0 if value > best else factor
        d, kind, best = d1 if value > best else d, k1 if value > best else kind, max(value, best)
        offset = d * (best * depth[i] - 1.0)  # of the point beyond the plane
        off = min(abs(offset) * steep[i], 1.0)
        beyond = on * factor + beyond_clutter * clutter[i]
        total += kind + off * off * (beyond if offset > 0.0 else on)
        total += apart * clutter[i] * min(max(-offset, 0.0), 1.0)
    return total


@njit(cache=True, nogil=True, inline="always")
def _row(m, k):  # type: ignore[no-untyped-def]
    return m[k, 0], m[k, 1], m[k, 2]


@njit(cache=True, nogil=True)
def mean_cost(terms, R, distances, costs, count, limit):  # type: ignore[no-untyped-def]
    """Mean cost of a cuboid over the first `count` cells, see `COSTS`; inf as soon as it must be above `limit`."""
    m = plane_rows(R, distances)
    total = 0.0
    for first in range(0, count, _BLOCK):
        total += _sum_costs(terms, m, distances, costs, first, min(first + _BLOCK, count))
        if total > limit * count:
            return np.inf
    faces = 0
    for k in range(5):
        if distances[k] < np.inf:
            faces += 1
    return total / max(count, 1) + costs[3] * faces
