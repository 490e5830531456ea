"""Floor below dark things without depth: a black sofa on its feet, a black table, black shoes.

Such a thing is a dark hole in the depth (`dark_holes.py`), and the floor that is seen below its lower edge, between its
feet, has depth and looks free. The hole itself tells where the thing stands. A straight line on the floor is straight
in the picture, so the line that spans the hole from below, from foot to foot, is the near side of the thing on the
floor; between that line and the hole's lower edge, floor is below the thing. A hole that lies flat, or stands on the
floor with all of its lower edge, a mat or a cupboard, leaves nothing between.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .dark_holes import BLUR_PX, FOOT_M, LEVEL, depth_of_floor, find_dark_holes
from .floor_pixels import BEYOND_PIXEL, FLOOR_PIXEL, WALL_PIXEL, camera_height, pixel_rays
from .thing_edges import DEEP_M, LONG_M, LOW_M, OVER_LEGS_M

_LEAST_HIGH_M = 0.02
"""What hangs no higher stands on the floor."""

_LONGEST_M = 2.5
"""Two feet of a thing, a long sofa, are no farther apart. Where a row of shelves turns around a corner of the room they
would be."""

_JUMP_PX = 4
"""The lower edge of a thing jumps by so many rows where a leg begins."""

_ON_LINE_PX = 1e-6

_CLOSING = np.ones((3, 3), np.uint8)


def below_dark_things(
    shape: tuple[int, int],
    inverse_depth: NDArray[np.float32],
    hole_kind: NDArray[np.uint8],
    kind: NDArray[np.uint8],
    color: NDArray[np.uint8] | None,
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
    margin_m: float,
) -> NDArray[np.bool_]:
    """Return the cells that lie below a dark thing without depth, or in the margin before one.

    Parameters
    ----------
    shape : rows and columns of the grid. inverse_depth : (H, W) float32, 0 where nothing was measured.
    hole_kind, kind : (H, W) uint8 of `close_holes` and `sum_floor_cells`.
    color : (H, W, 3) uint8 RGB, or None: without it nothing is dark.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    margin_m : cells this near before the near side of a thing are not free.

    Returns
    -------
    (rows, cols) bool
    """
    if color is None:
        return np.zeros(shape, np.bool_)
    intrinsics = camera.numbers
    below = np.zeros(shape, np.uint8)
    for hole in find_dark_holes(hole_kind, kind, inverse_depth, color, camera, T_camera_floor):
        edges = hole.highest, hole.lowest, hole.on_floor
        line = _span(hole.lowest, hole.on_floor, hole.first, intrinsics, T_camera_floor)
        _mark_below(below, edges, line, hole.first, kind, intrinsics, T_camera_floor, corner, margin_m)
    return np.asarray(cv2.morphologyEx(below, cv2.MORPH_CLOSE, _CLOSING)).view(np.bool_)


@njit(cache=True, nogil=True)
def _span(lowest, on_floor, first, intrinsics, T):  # type: ignore[no-untyped-def]
    """Row of the line that spans the feet of a patch from below in each of its columns, -1 beside them.

    Between two that are too far apart for one thing, it is that of the lower edge.
    """
    line, corners, n = np.full(len(lowest), -1.0), np.empty(len(lowest), np.int64), 0
    for u in range(len(lowest)):
        if not on_floor[u]:
            continue
        while n > 1 and not _is_corner(corners[n - 2], corners[n - 1], u, lowest):
            n -= 1
        corners[n] = u
        n += 1
    for k in range(n):
        line[corners[k]] = lowest[corners[k]]
        if k == 0:
            continue
        a, b = corners[k - 1], corners[k]
        one_thing = _apart(lowest, a, b, first, intrinsics, T) <= _LONGEST_M
        for u in range(a + 1, b):
            if one_thing:
                line[u] = lowest[a] + (lowest[b] - lowest[a]) * (u - a) / (b - a)
            elif on_floor[u]:
                line[u] = lowest[u]
    return line


@njit(cache=True, nogil=True)
def _apart(lowest, a, b, first, intrinsics, T):  # type: ignore[no-untyped-def]
    """Distance on the floor in m between what is seen just below two columns of a patch; inf where one is no floor."""
    above_floor = camera_height(T)
    xa, ya, rise_a = _ray(T, intrinsics, first + a, lowest[a] + 1.0)
    xb, yb, rise_b = _ray(T, intrinsics, first + b, lowest[b] + 1.0)
    if max(rise_a, rise_b) >= LEVEL:
        return np.inf
    ra, rb = above_floor / -rise_a, above_floor / -rise_b
    return np.sqrt((xa * ra - xb * rb) ** 2 + (ya * ra - yb * rb) ** 2)


@njit(cache=True, nogil=True)
def _is_corner(before, here, after, lowest):  # type: ignore[no-untyped-def]
    """Whether the row at a column is lower in the picture than the line between two others."""
    return (lowest[here] - lowest[before]) * (after - before) > (lowest[after] - lowest[before]) * (here - before)


@njit(cache=True, nogil=True)
def _ray(T, intrinsics, u, v):  # type: ignore[no-untyped-def]
    """Unit vector ahead and to the left of a pixel's ray over the floor, and its rise per metre of that."""
    ax0, ax1, ay0, ay1, az0, az1 = pixel_rays(T, intrinsics, v)
    x, y, z = ax0 + ax1 * u, ay0 + ay1 * u, az0 + az1 * u
    along = max(np.sqrt(x * x + y * y), 1e-9)
    return x / along, y / along, z / along


@njit(cache=True, nogil=True)
def _mark_below(below, edges, line, first, kind, intrinsics, T, corner, margin):  # type: ignore[no-untyped-def]
    """Mark the cells between the margin before the line that spans a patch and its lower edge, column by column."""
    highest, lowest, on_floor = edges
    x0, y0, size = corner
    rows, cols = below.shape
    above_floor = camera_height(T)
    near, hangs = _near_sides(line, lowest, first, intrinsics, T, above_floor)
    _straighten_ends(near, hangs, line, lowest, on_floor, above_floor)
    legs_end = _behind_legs(lowest, on_floor, first, intrinsics, T, above_floor)
    for k in range(len(line)):
        if near[k] == np.inf:
            continue
        x, y, _ = _ray(T, intrinsics, first + k, line[k] + 1.0)
        ends = _ends_in_sight(kind, highest[k], first + k)
        upper = _ray(T, intrinsics, first + k, highest[k] - 1.0)[2] if ends else 0.0
        lower = _ray(T, intrinsics, first + k, lowest[k] + 1.0)[2]
        far = _far_side(near[k], hangs[k], lower, upper, legs_end, above_floor)
        begin = near[k] - margin + 0.5 * size
        steps = max(int(2.0 * (far - begin) / size) + 1, 1)
        for i in range(steps + 1):
            r = begin + (far - begin) * i / steps
            row, col = int(np.floor((y * r - y0) / size)), int(np.floor((x * r - x0) / size))
            if 0 <= row < rows and 0 <= col < cols:
                below[row, col] = 1


@njit(cache=True, nogil=True)
def _near_sides(line, lowest, first, intrinsics, T, above_floor):  # type: ignore[no-untyped-def]
    """Distance in m from below the camera at which the line that spans a patch lies on the floor, inf beside it; and
    how high the patch's lower edge hangs over that, inf where its ray meets no floor.
    """
    near, hangs = np.full(len(line), np.inf), np.full(len(line), np.inf)
    for k in range(len(line)):
        if line[k] < 0.0:
            continue
        rise = _ray(T, intrinsics, first + k, line[k] + 1.0)[2]
        if rise < LEVEL:
            near[k] = above_floor / -rise
            rise = _ray(T, intrinsics, first + k, lowest[k] + 1.0)[2]
            if rise < LEVEL:
                hangs[k] = above_floor + rise * near[k]
    return near, hangs


@njit(cache=True, nogil=True)
def _straighten_ends(near, hangs, line, lowest, on_floor, above_floor):  # type: ignore[no-untyped-def]
    """Beyond the outermost feet the lower edge of a sofa hangs as high as it does beside them.

    There the spanning line runs to where the edge ends in the picture, which is not where a foot is.
    """
    feet = np.flatnonzero(on_floor)
    for side in range(2):
        end, step = (feet[0], 1) if side == 0 else (feet[-1], -1)
        k, high = end, 0.0
        beside = end + step * BLUR_PX
        if not 0 <= beside < len(line) or abs(lowest[end] - lowest[beside]) > BLUR_PX:
            continue  # a foot is there
        k += step
        while 0 <= k < len(line) and line[k] > lowest[k] + _ON_LINE_PX:
            high = max(high, hangs[k])
            k += step
        if not _LEAST_HIGH_M < high < LOW_M:
            continue
        k = end
        while k == end or (0 <= k < len(line) and line[k] > lowest[k] + _ON_LINE_PX):
            near[k] *= (above_floor - high) / (above_floor - hangs[k])
            hangs[k] = high
            k += step


@njit(cache=True, nogil=True)
def _behind_legs(lowest, on_floor, first, intrinsics, T, above_floor):  # type: ignore[no-untyped-def]
    """Distance in m from below the camera at which a thing on legs ends, inf where fewer than four legs are seen."""
    legs, far, begin = 0, 0.0, 0
    for k in range(1, len(lowest) + 1):
        if k < len(lowest) and abs(lowest[k] - lowest[k - 1]) < _JUMP_PX:
            continue
        from_left = begin == 0 or lowest[begin] > lowest[begin - 1]
        to_right = k == len(lowest) or lowest[k - 1] > lowest[k]
        if from_left and to_right and on_floor[begin:k].any():
            row = lowest[begin:k].max() + 1.0
            rise = _ray(T, intrinsics, first + begin, row)[2]
            z = depth_of_floor(T, intrinsics, first + begin, row)
            if rise < LEVEL and (k - begin) * z <= FOOT_M * intrinsics[0]:
                legs, far = legs + 1, max(far, above_floor / -rise)
        begin = k
    return far + OVER_LEGS_M if legs >= 4 else np.inf


@njit(cache=True, nogil=True)
def _ends_in_sight(kind, highest, u):  # type: ignore[no-untyped-def]
    """Whether what is seen over a patch is floor or a wall, and not more of the thing."""
    ends = False
    for v in range(max(highest - BLUR_PX, 0), highest):
        ends |= kind[v, u] in (FLOOR_PIXEL, WALL_PIXEL, BEYOND_PIXEL)
    return ends


@njit(cache=True, nogil=True)
def _far_side(near, hangs, lower, upper, legs_end, above_floor):  # type: ignore[no-untyped-def]
    """Distance in m from below the camera at which a thing ends that begins at `near`.

    Not behind where the ray of its lower edge meets the floor; nor, for all of it is no lower than that edge, behind
    where that of its upper edge comes down to its height. `lower`, `upper` : by how much these rays rise per metre, 0
    where what is seen over the upper edge may be more of the thing.
    """
    if lower > LEVEL:
        return min(near + DEEP_M, max(legs_end, near))
    far = near + LONG_M if hangs < LOW_M else min(near + DEEP_M, max(legs_end, near))
    if upper < LEVEL:
        far = min(far, max((above_floor - hangs) / -upper, near))
    return min(far, above_floor / -lower)
