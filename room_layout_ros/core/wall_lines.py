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
    for row in moved:
        votes = _slice_votes(
            geometry.inverse_depth, estimate.labels, FACES[int(row[3])], (c.fx, c.fy, c.cx, c.cy), T_camera_floor,
            (row[0], row[1], row[2]),
        )  # fmt: skip
        smooth = np.convolve(votes, (0.5, 1.0, 0.5), mode="same")
        best, here = int(np.argmax(smooth)), len(votes) // 2
        if smooth[best] >= _MIN_SLICES and smooth[best] > _CLEAR_WIN * smooth[here - 2 : here + 3].max():
            near = slice(max(best - 1, 0), best + 2)
            row[2] -= (float(np.average(np.arange(len(votes))[near], weights=votes[near])) - here) * _BIN_M
    return moved


@njit(cache=True, nogil=True)
def _slice_votes(inverse, labels, face, intrinsics, T, wall):  # type: ignore[no-untyped-def]
    """Votes per distance before the wall (middle bin: on it): one per slice along the wall, for its fullest bin."""
    fx, fy, cx, cy = intrinsics
    a, b, c = wall
    half = int(_REACH_M / _BIN_M)
    slices = int(2 * _LONGEST_M / _SLICE_M)
    counts = np.zeros((slices, 2 * half + 1), np.int64)
    distance = T[0, 3] * -T[0, 2] + T[1, 3] * -T[1, 2] + T[2, 3] * -T[2, 2]
    height, width = inverse.shape
    for v in range(0, height, _STRIDE):
        ry = (v - cy) / fy
        for u in range(0, width, _STRIDE):
            w = inverse[v, u]
            if w <= 0.0 or labels[v, u] != face:
                continue
            rx, z = (u - cx) / fx, 1.0 / w
            h = distance + (T[0, 2] * rx + T[1, 2] * ry + T[2, 2]) * z
            if h < _HEIGHTS_M[0] or h > _HEIGHTS_M[1]:
                continue
            x = (T[0, 0] * rx + T[1, 0] * ry + T[2, 0]) * z
            y = (T[0, 1] * rx + T[1, 1] * ry + T[2, 1]) * z
            k = int(np.floor((c - a * x - b * y) / _BIN_M + 0.5)) + half
            s = int(np.floor((a * y - b * x + _LONGEST_M) / _SLICE_M))
            if 0 <= k < counts.shape[1] and 0 <= s < slices:
                counts[s, k] += 1
    votes = np.zeros(counts.shape[1])
    for s in range(slices):
        total, best = 0, 0
        for k in range(counts.shape[1]):
            total += counts[s, k]
            if counts[s, k] > counts[s, best]:
                best = k
        if total >= _MIN_SLICE_PIXELS:
            votes[best] += 1.0
    return votes
