"""Whether a wall of the room stands in a direction or a doorway is open: what is measured on it or beyond it tells.

From a camera of a man's height the floor of the next room shows through an open door. A low camera sees that floor too
flat to measure it, and takes the foot of a wall for floor behind it; but it sees the wall, or what stands beyond.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .floor_pixels import BEYOND_PIXEL, WALL_PIXEL

UNTOLD, CLOSED, OPEN = range(3)
"""Of a place on a wall: too little is seen of it, or both are; the wall is seen there; what is beyond it is."""

_BEAMS = 720
_ROWS, _COLUMNS = 4, 2
"""One in so many is looked at."""

_LEAST_PIXELS, _SHARE = 4, 0.9
"""So many of them in the directions of a cell tell, if this share is of one kind: under a window is wall."""


def see_walls(
    kind: NDArray[np.uint8], camera: CameraIntrinsics, T_camera_floor: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (2, 720) float64 pixels on the walls, and beyond them, in each direction ahead of the camera.

    Parameters
    ----------
    kind : (H, W) uint8 of `sum_floor_cells`. T_camera_floor : (4, 4) float64, `floor_frame` of the fit.
    """
    return np.asarray(_count(kind, camera.numbers, T_camera_floor))


@njit(cache=True, nogil=True)
def _beam(x, y):  # type: ignore[no-untyped-def]
    """Index of the direction of a place."""
    return min(max(int((np.arctan2(y, x) / np.pi + 0.5) * _BEAMS), 0), _BEAMS - 1)


@njit(cache=True, nogil=True)
def _count(kind, intrinsics, T):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = intrinsics
    seen = np.zeros((2, _BEAMS))
    height, width = kind.shape
    for v in range(0, height, _ROWS):
        ry = (v - cy) / fy
        for u in range(0, width, _COLUMNS):
            if kind[v, u] != BEYOND_PIXEL and kind[v, u] != WALL_PIXEL:
                continue
            rx = (u - cx) / fx
            x, y = T[0, 0] * rx + T[1, 0] * ry + T[2, 0], T[0, 1] * rx + T[1, 1] * ry + T[2, 1]
            if x > 0.0:
                seen[int(kind[v, u] == BEYOND_PIXEL), _beam(x, y)] += 1.0
    return seen


@njit(cache=True, nogil=True)
def wall_at(seen, x, y, size):  # type: ignore[no-untyped-def]
    """`UNTOLD`, `CLOSED` or `OPEN`, of a cell of a side `size` through which a wall runs; `seen` : of `see_walls`."""
    part = 0.5 * size / np.sqrt(x * x + y * y)  # half a cell to either side
    first, last = _beam(x + y * part, y - x * part), _beam(x - y * part, y + x * part)
    on, beyond = seen[0, first : last + 1].sum(), seen[1, first : last + 1].sum()
    if on + beyond < _LEAST_PIXELS:
        return UNTOLD
    if beyond >= _SHARE * (on + beyond):
        return OPEN
    return CLOSED if on >= _SHARE * (on + beyond) else UNTOLD
