"""Floor that is seen below something: the seat behind a chair's back, the table over its legs, a sofa on its feet.

The picture shows a piece of floor, but a robot needs the space above it too. So that is looked at, from the floor up to
the robot's height: what of it something nearer hides is not known.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .floor_cells import FREE_CELL
from .floor_pixels import OBSTACLE_PIXEL

_STEP_M, _MIN_HIDDEN = 0.05, 4
"""The space above a corner is looked at so far apart, and at no less than so many heights: of what hangs lower a
picture shows too little. Hidden it is when so many looks meet something before it. One look is enough that leaves the
picture at its side and meets there what the side cuts off: of such a thing the picture may show one column."""

_COVER_M = (0.03, 0.5)
"""What stands this far before the space above a cell hides what may hang there."""

_LOW_LOOKS, _DEEP_M, _MIN_LOW = 6, 0.25, 2
"""The lower edge of a sofa: a thing, no farther before the space, that so many of the first looks meet. Floor is below
it if `_MIN_HIDDEN` looks in all meet something, be it a table far before the sofa."""

_DARK_LOOKS, _MIN_DARK = 5, 3
"""Nobody knows what stands over floor where so many of the first looks meet something, however far before."""

_LOW_M = 0.22
"""Floor is below a thing too where `_MIN_DARK` of the first `_DARK_LOOKS` meet it no higher than this over the floor,
however far before: a robot's low camera sees floor below a bed, and the front of the bed a metre before that."""

_GOES_ON_M = 0.15
"""What has floor below it goes on so far over such floor: a table hides the rest of the sofa."""

SEEN, HIDDEN, BELOW, DARK = range(4)
"""The space over a place: enough of it is seen; it is hidden by what stands just before it; it is below the lower edge
of a thing; its lower part is hidden by what may be far before it."""

_CUT_M = -0.3
"""What is cut off by the side of the picture may come this much nearer beyond it."""

_NEAREST_Z_M = 0.1
"""Nearer points are not looked at: they have no place in the picture."""

_TILE_PX = 8
"""Side of the tiles of which the nearest pixel is known."""

_EVEN_DEPTHS, _SPREAD = 1.2, 1.5
"""Looks are about evenly apart in the picture where the depths of the highest and lowest differ by less than this part;
then no two gaps differ by more than the second."""


def find_overhung(
    grid: NDArray[np.int8],
    inverse_depth: NDArray[np.float32],
    kind: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
    robot_height_m: float,
    margin_m: float,
) -> NDArray[np.bool_]:
    """Return the cells of which a thing hides the space above a corner, up to the robot's height.

    Parameters
    ----------
    grid : (rows, cols) int8. inverse_depth : (H, W) float32, 0 where nothing was measured.
    kind : (H, W) uint8 of `sum_floor_cells`: a thing goes on beyond the side of the picture, a wall is where it is.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    margin_m : cells this near before a thing are not free; where that place is beside the picture, it is looked at too.

    Returns
    -------
    (rows, cols) bool, some of it not free in any case.
    """
    over = _look_over_corners(
        grid, inverse_depth, kind, camera.numbers, T_camera_floor, corner, robot_height_m, margin_m
    )
    below = _corners_of_cells(over == BELOW) > 0
    hidden = below | (_corners_of_cells(over == HIDDEN) > 0)
    if below.any():
        side = 2 * max(round(_GOES_ON_M / corner[2]), 1) + 1
        beside = cv2.dilate(below.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        hidden |= beside & (_corners_of_cells(over == DARK) > 1)
    return hidden


def _corners_of_cells(corners: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(rows, cols) how many of each cell's four corners are marked."""
    marked = corners.view(np.uint8)
    return np.asarray(marked[:-1, :-1] + marked[1:, :-1] + marked[:-1, 1:] + marked[1:, 1:])


@njit(cache=True, nogil=True)
def _free_corners(grid):  # type: ignore[no-untyped-def]
    """(rows + 1, cols + 1) bool: corners of free cells."""
    rows, cols = grid.shape
    free = np.zeros((rows + 1, cols + 1), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if grid[i, j] == FREE_CELL:
                free[i, j] = free[i + 1, j] = free[i, j + 1] = free[i + 1, j + 1] = True
    return free


@njit(cache=True, nogil=True)
def _nearest_of_tiles(inverse):  # type: ignore[no-untyped-def]
    """(columns, rows) float32 largest inverse depth in each tile of the picture."""
    height, width = inverse.shape
    nearest = np.zeros(((width + _TILE_PX - 1) // _TILE_PX, (height + _TILE_PX - 1) // _TILE_PX), np.float32)
    column = np.empty(width, np.float32)
    for i in range(nearest.shape[1]):
        column[:] = 0.0
        for v in range(i * _TILE_PX, min((i + 1) * _TILE_PX, height)):
            row = inverse[v]
            for u in range(width):
                column[u] = row[u] if row[u] > column[u] else column[u]
        for u in range(width):
            nearest[u // _TILE_PX, i] = max(nearest[u // _TILE_PX, i], column[u])
    return nearest


@njit(cache=True, nogil=True)
def _may_hide(nearest, shape, low, high, steps, intrinsics):  # type: ignore[no-untyped-def]
    """Whether anything in the part of the picture between two points is near enough; most floor has nothing before it.

    `low`, `high` : camera frame, of the lowest and the highest of the `steps` points over a place.
    """
    fx, fy, cx, cy = intrinsics
    height, width = shape
    if min(low[2], high[2]) < _NEAREST_Z_M:
        return True
    u0, u1 = low[0] / low[2] * fx + cx, high[0] / high[2] * fx + cx
    v0, v1 = low[1] / low[2] * fy + cy, high[1] / high[2] * fy + cy
    left, right, top, bottom = min(u0, u1) - 1.0, max(u0, u1) + 1.0, min(v0, v1) - 1.0, max(v0, v1) + 1.0
    cut = left < 0.0 or right > width - 1.0
    farther = np.float32(1.0 / max(max(low[2], high[2]) - (_CUT_M if cut else _COVER_M[0]), 1e-9) - 1e-6)
    first, last = int(min(max(left, 0.0), width - 1.0)), int(min(max(right, 0.0), width - 1.0))
    after = int(min(bottom, height - 1.0)) // _TILE_PX + 1
    # The lowest tile holds nearer floor. Too few looks fall into it to matter, as long as they are evenly apart.
    even = max(low[2], high[2]) < _EVEN_DEPTHS * min(low[2], high[2])
    if even and not cut and _SPREAD * (_TILE_PX + 2) * (steps - 1) < (_MIN_DARK - 1) * abs(v1 - v0):
        after -= 1
    for j in range(first // _TILE_PX, last // _TILE_PX + 1):
        if _some_above(nearest[j, int(max(top, 0.0)) // _TILE_PX : after], farther):
            return True
    return False


@njit(cache=True, nogil=True)
def _some_above(values, bound):  # type: ignore[no-untyped-def]
    """Whether any value is above a bound; by itself, without a way out, so that it runs on vectors."""
    count = 0
    for k in range(len(values)):
        count += values[k] > bound
    return count > 0


@njit(cache=True, nogil=True)
def _look_over_corners(grid, inverse, kind, intrinsics, T, corner, robot_height, margin):  # type: ignore[no-untyped-def]
    """(rows + 1, cols + 1) uint8: how much of the space over the corners of free cells is seen."""
    fx, cx = intrinsics[0], intrinsics[2]
    x0, y0, size = corner
    rows, cols = grid.shape
    width = inverse.shape[1]
    steps = max(int(robot_height / _STEP_M + 1e-6), _MIN_HIDDEN)
    up = (T[0, 2], T[1, 2], T[2, 2])
    above_floor = -(up[0] * T[0, 3] + up[1] * T[1, 3] + up[2] * T[2, 3])
    nearest = _nearest_of_tiles(inverse)
    free, over = _free_corners(grid), np.full((rows + 1, cols + 1), SEEN, np.uint8)
    for i in range(rows + 1):
        for j in range(cols + 1):
            if not free[i, j]:
                continue
            x, y = x0 + j * size, y0 + i * size
            farther = 1.0 + margin / max(np.sqrt(x * x + y * y), 1e-9)
            for place in range(2):
                if place == 1:  # within the margin behind the corner, where the picture's side cuts that off
                    x, y = x * farther, y * farther
                px, py = T[0, 0] * x + T[0, 1] * y + T[0, 3], T[1, 0] * x + T[1, 1] * y + T[1, 3]
                pz = T[2, 0] * x + T[2, 1] * y + T[2, 3]
                foot = px / max(pz, _NEAREST_Z_M) * fx + cx
                if over[i, j] in (HIDDEN, BELOW) or (place == 1 and 0 <= foot <= width - 1):
                    break
                low = (px + T[0, 2] * _STEP_M, py + T[1, 2] * _STEP_M, pz + T[2, 2] * _STEP_M)
                top = steps * _STEP_M
                high = (px + T[0, 2] * top, py + T[1, 2] * top, pz + T[2, 2] * top)
                if _may_hide(nearest, inverse.shape, low, high, steps, intrinsics):
                    found = _look_over(inverse, kind, intrinsics, (px, py, pz), up, above_floor, steps)
                    over[i, j] = over[i, j] if found == SEEN else found
    return over


@njit(cache=True, nogil=True, error_model="numpy")
def _look_over(inverse, kind, intrinsics, foot, up, above_floor, steps):  # type: ignore[no-untyped-def]
    """How much is seen of the space over a place: `SEEN` and those after it.

    `foot`, `up` : camera frame, of the place on the floor, m, and of one metre up. `above_floor` : m, of the camera.
    """
    fx, fy, cx, cy = intrinsics
    px, py, pz = foot
    height, width = inverse.shape
    met = hidden = low = dark = under = 0
    for k in range(1, steps + 1):
        h = k * _STEP_M
        z = pz + up[2] * h
        if z < _NEAREST_Z_M:
            continue
        w = 1.0 / z
        u = int(np.rint((px + up[0] * h) * w * fx + cx))
        v = int(np.rint((py + up[1] * h) * w * fy + cy))
        # What the side of the picture cuts off goes on beyond it, and may be the thing right here.
        cut = u < 0 or u >= width
        u = min(max(u, 0), width - 1)
        if v < 0 or v >= height or inverse[v, u] <= 0.0:
            continue
        # how far it stands before the space: z - 1 / inverse, without a division
        thing = kind[v, u] == OBSTACLE_PIXEL
        least = z - (_CUT_M if cut and thing else _COVER_M[0])
        if least * inverse[v, u] <= 1.0:
            continue
        met += 1
        dark += k <= _DARK_LOOKS
        # height at which the look is met: as far along the line from the camera as what is seen there
        under += k <= _DARK_LOOKS and above_floor + (h - above_floor) / (inverse[v, u] * z) < _LOW_M
        if under >= _MIN_DARK:
            return BELOW
        if (z - _COVER_M[1]) * inverse[v, u] < 1.0:
            hidden += _MIN_HIDDEN if cut and thing else 1
            low += thing and k <= _LOW_LOOKS and (z - _DEEP_M) * inverse[v, u] < 1.0
        if low >= _MIN_LOW and met >= _MIN_HIDDEN:
            return BELOW
        if hidden >= _MIN_HIDDEN and k >= _LOW_LOOKS:
            return HIDDEN
    if hidden >= _MIN_HIDDEN:
        return HIDDEN
    return DARK if dark >= _MIN_DARK else SEEN
