"""Slow, obvious twins of core/integral_geometry.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.integral_geometry import PairTables
from room_layout_ros.core.ray_grid import QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid


def naive_bins(grid: RayGrid) -> tuple[NDArray[np.int64], ...]:
    """Quadrant, vertical, horizontal and angle bin of every pixel, each counted from scratch; and dz > 0.

    The bins of a pixel that is not ahead are those in the plane dz = 0.
    """
    m = grid.ray_matrix
    shape = (grid.camera.height, grid.camera.width)
    quadrant, vertical, horizontal, angle, ahead = (np.zeros(shape, np.int64) for _ in range(5))
    for y in range(shape[0]):
        for x in range(shape[1]):
            dx, dy, dz = (m[k, 0] * x + (m[k, 1] * y + m[k, 2]) for k in range(3))
            q = 2 * (dy >= 0) + (dx >= 0)
            quadrant[y, x], ahead[y, x] = q, dz > 0
            for bins, side, size in (
                (vertical, QUADRANT_VERTICAL[q], abs(dy)),
                (horizontal, QUADRANT_HORIZONTAL[q], abs(dx)),
            ):
                states = grid.side_states(side)[:-1]
                bins[y, x] = sum(size > a * max(dz, 0.0) for a in states)
            slopes = grid.slopes[q, 1 : grid.bin_counts[q]]
            angle[y, x] = sum(abs(dx) >= s * abs(dy) for s in slopes)
    return quadrant, vertical, horizontal, angle, ahead


def naive_face_tables(
    grid: RayGrid, feature: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Mass of a feature in the front, side and top part of each quadrant: all pixels for every pair of states."""
    quadrant, vertical, horizontal, angle, ahead = naive_bins(grid)
    front, side, top = [], [], []
    for q in range(4):
        of_i, of_j = grid.side_states(QUADRANT_VERTICAL[q]), grid.side_states(QUADRANT_HORIZONTAL[q])
        here = quadrant == q
        tables = np.zeros((3, len(of_i), len(of_j)))
        for i, a_i in enumerate(of_i):
            for j, a_j in enumerate(of_j):
                t, share = naive_corner(grid, q, a_i, a_j)
                in_front = here & (ahead > 0) & (vertical <= i) & (horizontal <= j)
                beyond = here & (horizontal > j)
                tables[0, i, j] = feature[in_front].sum()
                tables[1, i, j] = feature[beyond & (angle > t)].sum() + share * feature[beyond & (angle == t)].sum()
                nothing = here & (ahead == 0) & (vertical <= i) & (horizontal <= j)  # no face that it could hit
                tables[2, i, j] = feature[here & ~nothing].sum() - tables[0, i, j] - tables[1, i, j]
        front.append(tables[0])
        side.append(tables[1])
        top.append(tables[2])
    return front, side, top


def naive_corner(grid: RayGrid, q: int, a_i: float, a_j: float) -> tuple[int, float]:
    """Angle bin that the corner of two states falls into, and the share of the bin on the side's part."""
    if np.isinf(a_i) and np.isinf(a_j):
        corner = 0.5
    elif np.isinf(a_j):
        corner = 1.0
    else:
        corner = a_j / (a_i + a_j)  # 0 for an infinite a_i
    edges = grid.edges[q, : grid.bin_counts[q] + 1]
    t = max(0, min(int((edges <= corner).sum()) - 1, len(edges) - 2))
    return t, (edges[t + 1] - corner) / (edges[t + 1] - edges[t])


def naive_pair_tables(grid: RayGrid, face_cost: NDArray[np.float64]) -> PairTables:
    """Pair tables of a cost image (H, W, 5) by five feature images."""
    faces = [naive_face_tables(grid, face_cost[..., k]) for k in range(5)]
    result = []
    for q in range(4):
        top, side = (0, 0, 1, 1)[q], (2, 4, 2, 4)[q]
        result.append(faces[3][0][q] + faces[side][1][q] + faces[top][2][q])
    return result[0], result[1], result[2], result[3]
