"""What the cells of a frame say about each face of a cuboid: on its plane, beyond it, how many."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import depth_sigma
from .layout import plane_rows
from .room_cells import RoomCells
from .room_cost import face_of_point

_ON_PLANE_SIGMAS = 3.0


def balance_faces(
    cells: RoomCells, R_room_camera: NDArray[np.float64], distances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (5, 3) float64 per face.

    Cells of structure on its plane and cells beyond it, as shares of the face's own cells; its share of all cells.
    """
    m = plane_rows(R_room_camera, distances)
    counts = _balance(cells.rays, cells.inverse_depth, cells.probability, m, distances)
    own = np.maximum(counts[:, 2], 1.0)
    return np.column_stack([counts[:, 0] / own, counts[:, 1] / own, counts[:, 2] / len(cells.rays)])


@njit(cache=True, nogil=True)
def _balance(rays, inverse_depth, probability, m, distances):  # type: ignore[no-untyped-def]
    counts = np.zeros((5, 3))
    for i in range(len(rays)):
        face, best = face_of_point(m, rays[i, 0], rays[i, 1], rays[i, 2])
        if face < 0:
            continue
        counts[face, 2] += 1.0
        w = inverse_depth[i]
        if w <= 0.0:
            continue
        offset = distances[face] * (best / w - 1.0)
        width = _ON_PLANE_SIGMAS * depth_sigma(1.0 / w)
        if abs(offset) < width:
            counts[face, 0] += 1.0 - probability[i, 5]
        elif offset > 0.0:
            counts[face, 1] += 1.0
    return counts
