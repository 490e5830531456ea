"""How wide a corridor's floor is: from where it ends on either side, not from the walls alone.

A cuboid's wall may lie in a door recess, or behind the glass before which the floor ends. Along each wall, in slices
of 20 cm, the foot of what bounds the floor is measured in the depth: the edge of the floor, with something upright
there. A wall counts as it is where two slices show its foot; else the nearest line that two slices share does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.depth import DepthGeometry
from room_layout_ros.core.freespace import FreeSpace

LEFT, RIGHT = 2, 4

_SLICE_M, _LONGEST_M = 0.2, 8.0
_ON_FLOOR_M = 0.03
_UPRIGHT_M = (0.06, 0.40)
_AT_EDGE_M = 0.12
_MIN_FLOOR_PIXELS, _MIN_UPRIGHT_PIXELS = 30, 8
_SAME_M = 0.08
"""Feet this near to each other, or to a wall, are of one line."""

_SHARED = 2


def floor_width(geometry: DepthGeometry, free_space: FreeSpace | None) -> float:
    """Return the distance in m from the left to the right end of the floor, NaN where the estimate has not both walls.

    The two lines are parallel up to the lean of the cuboid against the floor: their distances to the foot add up.
    """
    if free_space is None:
        return float("nan")
    walls = {int(row[3]): row for row in free_space.walls}
    if LEFT not in walls or RIGHT not in walls:
        return float("nan")
    T = free_space.T_camera_floor
    points = (geometry.points().reshape(-1, 3) - T[:3, 3]) @ T[:3, :3]
    points = points[np.isfinite(points[:, 2]) & (np.abs(points[:, 2]) < _UPRIGHT_M[1])]
    return sum(_end_of_floor(points, walls[k]) for k in (LEFT, RIGHT))


def _end_of_floor(points: NDArray[np.float64], wall: NDArray[np.float64]) -> float:
    feet = np.sort(_feet(points, wall))
    if (np.abs(feet - wall[2]) <= _SAME_M).sum() >= _SHARED:
        return float(wall[2])
    for foot in feet:
        line = feet[(feet >= foot) & (feet <= foot + _SAME_M)]
        if len(line) >= _SHARED:
            return float(np.median(line))
    return float(wall[2])


def _feet(points: NDArray[np.float64], wall: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) distance of what bounds the floor towards the wall, one per slice along the wall that shows it."""
    a, b, _, _ = wall
    across, height = a * points[:, 0] + b * points[:, 1], points[:, 2]
    piece = np.floor((a * points[:, 1] - b * points[:, 0] + _LONGEST_M) / _SLICE_M).astype(int)
    on_floor, upright = np.abs(height) < _ON_FLOOR_M, height > _UPRIGHT_M[0]
    feet = []
    for k in range(int(2 * _LONGEST_M / _SLICE_M)):
        floor = across[(piece == k) & on_floor]
        if len(floor) < _MIN_FLOOR_PIXELS:
            continue
        standing = across[(piece == k) & upright]
        standing = standing[np.abs(standing - np.percentile(floor, 99)) < _AT_EDGE_M]
        if len(standing) >= _MIN_UPRIGHT_PIXELS:
            feet.append(float(np.median(standing)))
    return np.array(feet)
