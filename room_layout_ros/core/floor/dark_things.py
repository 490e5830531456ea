"""Floor below dark things without depth: a black sofa on its feet, a black table, black shoes.

Black leather and varnish swallow the sensor's light. Such a thing is a dark hole in the depth, and the floor that is
seen below its lower edge, between its feet, has depth and looks free. The hole itself tells where the thing stands. A
straight line on the floor is straight in the picture, so the line that spans the hole from below, from foot to foot,
is the near side of the thing on the floor; between that line and the hole's lower edge, floor is below the thing. A
hole that lies flat, or stands on the floor with all of its lower edge, a mat or a cupboard, leaves nothing between.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .depth_holes import GAP
from .floor_cells import FREE_CELL, UNKNOWN_CELL
from .floor_pixels import BEYOND_PIXEL, FLOOR_PIXEL, FLYING_PIXEL, OBSTACLE_PIXEL, WALL_PIXEL, pixel_rays

_DARK = 90
"""Level of the brightest channel up to which a pixel is dark."""

_LEAST_AREA = 1.2e-3
"""Solid angle in sr of a hole that counts: a black shoe at 2.5 m."""

_OPENING = np.ones((3, 3), np.uint8)
"""Holes that hang together by less are two."""

_BLUR_PX = 3
"""The floor below a foot begins no more than so many rows farther down."""

_LEAST_FEET = 3
"""Columns of a hole below which floor is; a hole with fewer hangs on a wall."""

_FOOT_M = 0.15
"""A foot that has depth is no wider."""

_LEAST_HIGH_M = 0.02
"""What hangs no higher stands on the floor."""

_LONGEST_M = 2.5
"""Two feet of a thing, a long sofa, are no farther apart. Where a row of shelves turns around a corner of the room they
would be."""

_JUMP_PX, _OVER_LEGS_M = 4, 0.2
"""The lower edge of a thing jumps by so many rows where a leg begins. A thing of which four legs are seen ends so far
behind the farthest."""

_ON_LINE_PX, _NEAREST_Z_M = 1e-6, 0.1

_LOW_M, _LONG_M, _DEEP_M = 0.40, 2.0, 1.2
"""What hangs lower than the first is a bed or a sofa, and may be as deep as the second; other things as the third."""

_LEVEL = -1e-3
"""Rays that do not fall by more meet no floor."""

_CLOSING = np.ones((3, 3), np.uint8)


def hide_below_dark_things(
    grid: NDArray[np.int8],
    inverse_depth: NDArray[np.float32],
    hole_kind: NDArray[np.uint8],
    kind: NDArray[np.uint8],
    color: NDArray[np.uint8] | None,
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
    margin_m: float,
) -> None:
    """Make free cells unknown that lie below a dark thing without depth, or in the margin before one.

    Parameters
    ----------
    grid : (rows, cols) int8, changed in place. inverse_depth : (H, W) float32, 0 where nothing was measured.
    hole_kind, kind : (H, W) uint8 of `close_holes` and `sum_floor_cells`.
    color : (H, W, 3) uint8 RGB, or None: without it nothing is dark.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    margin_m : cells this near before the near side of a thing are not free.
    """
    if color is None:
        return
    least = int(_LEAST_AREA * camera.fx * camera.fy)
    dark, (top, bottom, left, right), count = _dark_holes(hole_kind, color)
    if count < least:
        return
    part = np.asarray(cv2.morphologyEx(dark[top:bottom, left:right], cv2.MORPH_OPEN, _OPENING), np.uint8)
    parts, patch, boxes = _patches(part, least, left == 0, right == dark.shape[1])
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    below = np.zeros(grid.shape, np.uint8)
    for k, box in boxes.items():
        edges = _edges(parts, patch == k, box, (top, left), kind)
        _go_on_over_feet(edges, box[2] + left, inverse_depth, kind, intrinsics, T_camera_floor)
        if np.count_nonzero(edges[2]) >= _LEAST_FEET:
            line = _span(edges[1], edges[2], box[2] + left, intrinsics, T_camera_floor)
            _mark_below(below, edges, line, box[2] + left, kind, intrinsics, T_camera_floor, corner, margin_m)
    closed = cv2.morphologyEx(below, cv2.MORPH_CLOSE, _CLOSING)
    grid[(closed > 0) & (grid == FREE_CELL)] = UNKNOWN_CELL


def _patches(
    dark: NDArray[np.uint8], least: int, at_left: bool, at_right: bool
) -> tuple[NDArray[np.int32], NDArray[np.int64], dict[int, NDArray[np.int64]]]:
    """(H, W) int32 parts that hang together, the patch of each part, and rows and columns of patches of enough pixels.

    Parts that one side of the picture cuts off may hang together beyond it, as the legs of a table do: they are one
    patch. `at_left`, `at_right` : whether `dark` reaches that side.
    """
    n, labelled = cv2.connectedComponents(dark, connectivity=8)
    parts = np.asarray(labelled, np.int32)
    box, area = _boxes(parts, dark, n)
    patch = np.arange(n)
    for reaches, cut in ((at_left, box[1:, 2] == 0), (at_right, box[1:, 3] == dark.shape[1])):
        joined = np.unique(patch[1:][cut])
        if reaches and len(joined) > 1:
            patch[np.isin(patch, joined)] = joined[0]
    boxes = {}
    for k in np.flatnonzero(np.bincount(patch, area) >= least):
        own = patch == k
        boxes[int(k)] = np.ravel([box[own, 0::2].min(axis=0), box[own, 1::2].max(axis=0)], order="F")
    return parts, patch, boxes


@njit(cache=True, nogil=True)
def _dark_holes(hole_kind, color):  # type: ignore[no-untyped-def]
    """(H, W) uint8 dark pixels without depth; their rows and columns, with one beside them; and how many they are."""
    height, width = hole_kind.shape
    dark = np.zeros((height, width), np.uint8)
    top, bottom, left, right, count = height, 0, width, 0, 0
    for v in range(height):
        if not _has_any(hole_kind[v], GAP):
            continue
        for u in range(width):
            if hole_kind[v, u] != GAP or max(color[v, u, 0], color[v, u, 1], color[v, u, 2]) > _DARK:
                continue
            dark[v, u] = 1
            top, bottom, left, right = min(top, v), v + 1, min(left, u), max(right, u + 1)
            count += 1
    return dark, (max(top - 1, 0), min(bottom + 1, height), max(left - 1, 0), min(right + 1, width)), count


@njit(cache=True, nogil=True)
def _boxes(parts, dark, count):  # type: ignore[no-untyped-def]
    """(count, 4) int64 rows and columns of parts, and (count,) int64 how many pixels they have; of number 0 none."""
    height, width = parts.shape
    box, area = np.empty((count, 4), np.int64), np.zeros(count, np.int64)
    box[:, 0], box[:, 1], box[:, 2], box[:, 3] = height, 0, width, 0
    for v in range(height):
        if not _has_any(dark[v], 1):
            continue
        for u in range(width):
            k = parts[v, u]
            if k > 0:
                box[k, 0], box[k, 1] = min(box[k, 0], v), v + 1
                box[k, 2], box[k, 3] = min(box[k, 2], u), max(box[k, 3], u + 1)
                area[k] += 1
    return box, area


@njit(cache=True, nogil=True)
def _has_any(row, value):  # type: ignore[no-untyped-def]
    """Whether a value is in a row; by itself, without a way out, so that it runs on vectors."""
    count = 0
    for u in range(len(row)):
        count += row[u] == value
    return count > 0


@njit(cache=True, nogil=True)
def _edges(parts, own, box, offset, kind):  # type: ignore[no-untyped-def]
    """Highest and lowest row of a patch in each of its columns, and whether floor with depth is below it.

    `own` : of each part whether it belongs to the patch. `box` : rows and columns of the patch in `parts`, which begin
    at row and column `offset` of the picture.
    """
    top, bottom, left, right = box
    highest, lowest = np.empty(right - left, np.int64), np.empty(right - left, np.int64)
    on_floor = np.zeros(right - left, np.bool_)
    for u in range(left, right):
        high, low = top, bottom - 1
        while not own[parts[high, u]]:
            high += 1
        while not own[parts[low, u]]:
            low -= 1
        high, low = high + offset[0], low + offset[0]
        highest[u - left], lowest[u - left] = high, low
        on_floor[u - left] = low + 1 == len(kind)
        for v in range(low + 1, min(low + 1 + _BLUR_PX, len(kind))):
            on_floor[u - left] |= kind[v, u + offset[1]] == FLOOR_PIXEL
    return highest, lowest, on_floor


@njit(cache=True, nogil=True)
def _go_on_over_feet(edges, first, inverse, kind, intrinsics, T):  # type: ignore[no-untyped-def]
    """Let a patch go on down over feet that have depth: narrow things that end at its lower edge."""
    _, lowest, on_floor = edges
    feet, n = np.full(len(lowest), -1, np.int64), len(lowest)
    for k in range(n):
        if not on_floor[k]:
            feet[k] = _end_of_foot(inverse, kind, lowest[k], first + k, intrinsics, T)
    begin = 0
    for k in range(n + 1):
        if k < n and feet[k] >= 0:
            continue
        if k > begin and begin >= _BLUR_PX and k + _BLUR_PX <= n:
            before, after = lowest[begin - _BLUR_PX], lowest[k + _BLUR_PX - 1]
            least, most = min(before, after) - _BLUR_PX, max(before, after) + _BLUR_PX
            even = lowest[begin:k].min() >= least and lowest[begin:k].max() <= most
            z = _depth_of_floor(T, intrinsics, first + 0.5 * (begin + k - 1), feet[begin:k].max() + 1.0)
            if even and (k - begin) * z <= _FOOT_M * intrinsics[0]:
                lowest[begin:k], on_floor[begin:k] = feet[begin:k], True
        begin = k + 1


@njit(cache=True, nogil=True)
def _end_of_foot(inverse, kind, low, u, intrinsics, T):  # type: ignore[no-untyped-def]
    """Lowest row of what stands below a pixel in its column, if floor follows it; else -1.

    The last centimetres of a foot are sorted with the floor: it ends where its lowest pixel stands.
    """
    v, last, seen = low + 1, low, False
    while v < len(kind) and v - last <= _BLUR_PX:
        if kind[v, u] == FLOOR_PIXEL:
            return _row_below(inverse[last, u], last, u, intrinsics, T) if seen else -1
        if kind[v, u] in (OBSTACLE_PIXEL, FLYING_PIXEL):
            last, seen = v, True
        v += 1
    return -1


@njit(cache=True, nogil=True)
def _row_below(inverse, v, u, intrinsics, T):  # type: ignore[no-untyped-def]
    """Last row over the floor right below the point of a pixel, no higher than that pixel."""
    fx, fy, cx, cy = intrinsics
    z = 1.0 / inverse
    x, y = (u - cx) / fx * z - T[0, 3], (v - cy) / fy * z - T[1, 3]
    high = T[0, 2] * x + T[1, 2] * y + T[2, 2] * (z - T[2, 3])
    foot = (y + T[1, 3] - high * T[1, 2]) / max(z - high * T[2, 2], _NEAREST_Z_M)
    return max(int(np.ceil(foot * fy + cy)) - 1, v)


@njit(cache=True, nogil=True)
def _depth_of_floor(T, intrinsics, u, v):  # type: ignore[no-untyped-def]
    """Depth in m at which the ray of a pixel meets the floor, inf where it does not fall."""
    _, _, _, _, az0, az1 = pixel_rays(T, intrinsics, v)
    rise = az0 + az1 * u
    above_floor = -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])
    return above_floor / -rise if rise < _LEVEL else np.inf


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
    above_floor = -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])
    xa, ya, rise_a = _ray(T, intrinsics, first + a, lowest[a] + 1.0)
    xb, yb, rise_b = _ray(T, intrinsics, first + b, lowest[b] + 1.0)
    if max(rise_a, rise_b) >= _LEVEL:
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
    above_floor = -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])
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
        if rise < _LEVEL:
            near[k] = above_floor / -rise
            rise = _ray(T, intrinsics, first + k, lowest[k] + 1.0)[2]
            if rise < _LEVEL:
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
        beside = end + step * _BLUR_PX
        if not 0 <= beside < len(line) or abs(lowest[end] - lowest[beside]) > _BLUR_PX:
            continue  # a foot is there
        k += step
        while 0 <= k < len(line) and line[k] > lowest[k] + _ON_LINE_PX:
            high = max(high, hangs[k])
            k += step
        if not _LEAST_HIGH_M < high < _LOW_M:
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
            z = _depth_of_floor(T, intrinsics, first + begin, row)
            if rise < _LEVEL and (k - begin) * z <= _FOOT_M * intrinsics[0]:
                legs, far = legs + 1, max(far, above_floor / -rise)
        begin = k
    return far + _OVER_LEGS_M if legs >= 4 else np.inf


@njit(cache=True, nogil=True)
def _ends_in_sight(kind, highest, u):  # type: ignore[no-untyped-def]
    """Whether what is seen over a patch is floor or a wall, and not more of the thing."""
    for v in range(max(highest - _BLUR_PX, 0), highest):
        if kind[v, u] in (FLOOR_PIXEL, WALL_PIXEL, BEYOND_PIXEL):
            return True
    return False


@njit(cache=True, nogil=True)
def _far_side(near, hangs, lower, upper, legs_end, above_floor):  # type: ignore[no-untyped-def]
    """Distance in m from below the camera at which a thing ends that begins at `near`.

    Not behind where the ray of its lower edge meets the floor; nor, for all of it is no lower than that edge, behind
    where that of its upper edge comes down to its height. `lower`, `upper` : by how much these rays rise per metre, 0
    where what is seen over the upper edge may be more of the thing.
    """
    if lower > _LEVEL:
        return min(near + _DEEP_M, max(legs_end, near))
    far = near + _LONG_M if hangs < _LOW_M else min(near + _DEEP_M, max(legs_end, near))
    if upper < _LEVEL:
        far = min(far, max((above_floor - hangs) / -upper, near))
    return min(far, above_floor / -lower)
