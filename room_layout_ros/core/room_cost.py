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


@dataclass(frozen=True, slots=True)
class FittedRoom:
    """A cuboid and its mean cost per cell (0 perfect, above 0.5 no room)."""

    R_room_camera: NDArray[np.float64]
    distances: NDArray[np.float64]
    cost: float


def rate_room(cells: RoomCells, room: FittedRoom, costs: NDArray[np.float64] = COSTS) -> FittedRoom:
    """Return the room with its cost."""
    R, distances = room.R_room_camera, room.distances
    n = len(cells.rays)
    cost = mean_cost(cells.rays, cells.inverse_depth, cells.probability, cells.behind, R, distances, costs, n, np.inf)
    return FittedRoom(R, distances, float(cost))


@njit(cache=True, nogil=True)
def plane_rows(R, distances):  # type: ignore[no-untyped-def]
    """n_k / d_k of the five faces."""
    m = np.empty((5, 3))
    for j in range(3):
        m[0, j] = -R[1, j] / distances[0]
        m[1, j] = R[1, j] / distances[1]
        m[2, j] = -R[0, j] / distances[2]
        m[3, j] = R[2, j] / distances[3]
        m[4, j] = R[0, j] / distances[4]
    return m


@njit(cache=True, nogil=True)
def face_of_ray(m, ray):  # type: ignore[no-untyped-def]
    """(face 0..4 that a ray of the camera hits, -1 for none; the inverse depth there) for rows m = n_k / d_k."""
    best, face = 1e-3, -1  # a face more than a kilometre away is no face
    for k in range(5):
        value = m[k, 0] * ray[0] + m[k, 1] * ray[1] + m[k, 2] * ray[2]
        if value > best:
            best, face = value, k
    return face, best


@njit(cache=True, nogil=True)
def mean_cost(rays, inverse_depth, probability, behind, R, distances, costs, count, limit):  # type: ignore[no-untyped-def]
    """Mean cost of a cuboid over the first `count` cells, see `COSTS`; inf as soon as it must be above `limit`."""
    m = plane_rows(R, distances)
    total = 0.0
    stop = limit * count
    for i in range(count):
        face, best = face_of_ray(m, rays[i])
        walls = probability[i, 2] + probability[i, 3] + probability[i, 4]
        structure = probability[i, 0] + probability[i, 1] + walls
        clutter = probability[i, 5]
        wall_behind = behind[i, 2] + behind[i, 3] + behind[i, 4]
        known = behind[i, 0] + behind[i, 1] + wall_behind
        if face < 0:
            total += costs[0] * structure + costs[1] * clutter + costs[8] * known
            continue
        likely = behind[i, face] if face < 2 else wall_behind
        total += costs[8] * (known - likely)
        if face >= 2:
            total += costs[9] * (likely - behind[i, face])
        mine = probability[i, face] if face < 2 else walls
        total += costs[0] * (structure - mine)
        if face >= 2:
            total += costs[7] * (walls - probability[i, face])
        w = inverse_depth[i]
        if w > 0.0:
            offset = distances[face] * (best / w - 1.0)  # of the point beyond the plane
            off = min(abs(offset) / (costs[4] + costs[5] / w), 1.0) ** 2
            if offset > 0.0:
                total += off * (mine * (costs[6] if face >= 2 else 1.0) + clutter * costs[1])
            else:
                total += off * mine + clutter * costs[2] * min(-offset, 1.0)
        if i % 64 == 63 and total > stop:
            return np.inf
    faces = 0
    for k in range(5):
        if distances[k] < np.inf:
            faces += 1
    return total / max(count, 1) + costs[3] * faces
