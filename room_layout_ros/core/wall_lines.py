"""The walls at the height of a robot: where most of the wall's length is, not most of its pixels.

A cuboid's wall follows the pixels, and the nearest metre of a wall has more of them than all the rest: in a corridor
a door recess beside the camera pulls the plane. On the floor every decimetre of the wall's length has one vote.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import DepthGeometry
from .estimate import RoomEstimate
from .labels import FACES

_REACH_M = 0.29
_BIN_M = 0.04
_SLICE_M = 0.20
_LONGEST_M = 12.0
_HEIGHTS_M = (0.10, 1.5)
_STRIDE = 2
_MIN_SLICE_PIXELS = 8
_MIN_SLICES = 6
_CLEAR_WIN = 1.4


def refine_walls(
    geometry: DepthGeometry, estimate: RoomEstimate, T_camera_floor: NDArray[np.float64], walls: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move walls on the floor, parallel, to where most of their length stands, at most `_REACH_M`.

    Parameters
    ----------
    walls : (n, 4) float64 of `walls_on_floor`.

    Returns
    -------
    (n, 4) float64; a wall stays where it is unless another line has clearly more of its length.
    """
    c = geometry.camera
    moved = walls.copy()
    if not len(walls):
        return moved
    wall_of = np.full(max(FACES) + 1, -1, np.int64)
    wall_of[[FACES[int(k)] for k in walls[:, 3]]] = np.arange(len(walls))
    every = _slice_votes(
        geometry.inverse_depth, estimate.labels, wall_of, (c.fx, c.fy, c.cx, c.cy), T_camera_floor, walls
    )
    for row, votes in zip(moved, every, strict=True):
        smooth = np.convolve(votes, (0.5, 1.0, 0.5), mode="same")
        best, here = int(np.argmax(smooth)), len(votes) // 2
        if smooth[best] >= _MIN_SLICES and smooth[best] > _CLEAR_WIN * smooth[here - 2 : here + 3].max():
            near = slice(max(best - 1, 0), best + 2)
            row[2] -= (float(np.average(np.arange(len(votes))[near], weights=votes[near])) - here) * _BIN_M
    return moved


@njit(cache=True, nogil=True)
def _slice_votes(inverse, labels, wall_of, intrinsics, T, walls):  # type: ignore[no-untyped-def]
    """Votes (walls, bins) per distance before a wall (middle bin: on it): one per slice along it, for its fullest bin.

    `wall_of` is the row of `walls` per label, -1 where a label is no wall.
    """
    fx, fy, cx, cy = intrinsics
    half = int(_REACH_M / _BIN_M)
    slices, bins = int(2 * _LONGEST_M / _SLICE_M), 2 * half + 1
    counts = np.zeros((len(walls), slices, bins), np.int32)
    distance = T[0, 3] * -T[0, 2] + T[1, 3] * -T[1, 2] + T[2, 3] * -T[2, 2]
    height, width = inverse.shape
    for v in range(0, height, _STRIDE):
        ry = (v - cy) / fy
        for u in range(0, width, _STRIDE):
            w, label = inverse[v, u], labels[v, u]
            wall = wall_of[label] if label < len(wall_of) else -1
            if w <= 0.0 or wall < 0:
                continue
            rx, z = (u - cx) / fx, 1.0 / w
            h = distance + (T[0, 2] * rx + T[1, 2] * ry + T[2, 2]) * z
            if h < _HEIGHTS_M[0] or h > _HEIGHTS_M[1]:
                continue
            x = (T[0, 0] * rx + T[1, 0] * ry + T[2, 0]) * z
            y = (T[0, 1] * rx + T[1, 1] * ry + T[2, 1]) * z
            a, b, c = walls[wall, 0], walls[wall, 1], walls[wall, 2]
            k = int(np.floor((c - a * x - b * y) / _BIN_M + 0.5)) + half
            s = int(np.floor((a * y - b * x + _LONGEST_M) / _SLICE_M))
            if 0 <= k < bins and 0 <= s < slices:
                counts[wall, s, k] += 1
    votes = np.zeros((len(walls), bins))
    for wall in range(len(walls)):
        for s in range(slices):
            if counts[wall, s].sum() >= _MIN_SLICE_PIXELS:
                votes[wall, np.argmax(counts[wall, s])] += 1.0
    return votes
