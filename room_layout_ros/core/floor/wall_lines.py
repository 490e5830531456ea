"""The walls at the height of a robot: where most of the wall's length is, not most of its pixels.

A cuboid's wall follows the pixels, and the nearest metre of a wall has more of them than all the rest: in a corridor
a door recess beside the camera pulls the plane. On the floor every decimetre of the wall's length has one vote. Then
the wall settles on the median of its lower part, whose depth was set right by the floor beside it
(`slow_error.remove_bias`).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..depth import DepthGeometry
from ..estimate import RoomEstimate
from ..labels import FACES

_REACH_M = 0.29
_BIN_M = 0.04
_SLICE_M = 0.20
_LONGEST_M = 12.0
_HEIGHTS_M = (0.10, 1.5)
_STRIDE = 2
_MIN_SLICE_PIXELS = 8
_MIN_SLICES = 6
_CLEAR_WIN = 1.4
_FINE_M, _SETTLE_M = 0.005, 0.06
_FOOT_M = 0.6
"""The lower part of a wall reaches up to here: farther from the floor its depth is not known to be right."""

_MIN_FOOT_PIXELS = 150


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
    moved = walls.copy()
    if not len(walls):
        return moved
    wall_of = np.full(max(FACES) + 1, -1, np.int64)
    wall_of[[FACES[int(k)] for k in walls[:, 3]]] = np.arange(len(walls))
    every, feet = _slice_votes(
        geometry.inverse_depth, estimate.labels, wall_of, geometry.camera.numbers, T_camera_floor, walls
    )
    for row, votes, foot in zip(moved, every, feet, strict=True):
        inwards = 0.0
        smooth = np.convolve(votes, (0.5, 1.0, 0.5), mode="same")
        best, here = int(np.argmax(smooth)), len(votes) // 2
        if smooth[best] >= _MIN_SLICES and smooth[best] > _CLEAR_WIN * smooth[here - 2 : here + 3].max():
            near = slice(max(best - 1, 0), best + 2)
            inwards = (float(np.average(np.arange(len(votes))[near], weights=votes[near])) - here) * _BIN_M
        row[2] -= _settled(foot, inwards)
    return moved


def _settled(foot: NDArray[np.int64], inwards_m: float) -> float:
    """Distance in m from the cuboid's wall to the median of its lower part around the line `inwards_m` before it."""
    middle = len(foot) // 2
    low = max(middle + round((inwards_m - _SETTLE_M) / _FINE_M), 0)
    near = np.cumsum(foot[low : middle + round((inwards_m + _SETTLE_M) / _FINE_M) + 1])
    if not len(near) or near[-1] < _MIN_FOOT_PIXELS:
        return inwards_m
    return (low + int(np.searchsorted(near, 0.5 * near[-1])) - middle) * _FINE_M


@njit(cache=True, nogil=True)
def _slice_votes(inverse, labels, wall_of, intrinsics, T, walls):  # type: ignore[no-untyped-def]
    """Votes (walls, bins) per distance before a wall (middle bin: on it): one per slice along it, for its fullest bin.

    And the pixels (walls, fine bins) of its lower part per distance before it.

    `wall_of` is the row of `walls` per label, -1 where a label is no wall.
    """
    fx, fy, cx, cy = intrinsics
    half = int(_REACH_M / _BIN_M)
    slices, bins = int(2 * _LONGEST_M / _SLICE_M), 2 * half + 1
    counts = np.zeros((len(walls), slices, bins), np.int32)
    fine = 2 * int(_REACH_M / _FINE_M) + 1
    feet = np.zeros((len(walls), fine), np.int64)
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
            before = c - a * x - b * y
            k = int(np.floor(before / _FINE_M + 0.5)) + fine // 2
            if h < _FOOT_M and 0 <= k < fine:
                feet[wall, k] += 1
            k = int(np.floor(before / _BIN_M + 0.5)) + half
            s = int(np.floor((a * y - b * x + _LONGEST_M) / _SLICE_M))
            if 0 <= k < bins and 0 <= s < slices:
                counts[wall, s, k] += 1
    votes = np.zeros((len(walls), bins))
    for wall in range(len(walls)):
        for s in range(slices):
            if counts[wall, s].sum() >= _MIN_SLICE_PIXELS:
                votes[wall, np.argmax(counts[wall, s])] += 1.0
    return votes, feet
