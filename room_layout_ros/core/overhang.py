"""Floor that is seen below something: the seat behind a chair's back, the table over its legs."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .floor_cells import FREE_CELL, OBSTACLE_PIXEL, UNKNOWN_CELL
from .frame import CameraIntrinsics

_STEP_M = 0.05
_MIN_HIDDEN = 4
_COVER_M = (0.08, 0.5)
"""What stands this far before the space above a cell hides what may hang there."""

_CUT_M = -0.3
"""What is cut off by the side of the picture may come this much nearer beyond it."""


def hide_overhung(
    grid: NDArray[np.int8],
    inverse_depth: NDArray[np.float32],
    kind: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
    robot_height_m: float,
    margin_m: float,
) -> None:
    """Make free cells unknown where a thing hides the space above one of their corners, up to the robot's height.

    Parameters
    ----------
    grid : (rows, cols) int8, changed in place. inverse_depth : (H, W) float32, 0 where nothing was measured.
    kind : (H, W) uint8 of `sum_floor_cells`: a thing goes on beyond the side of the picture, a wall is where it is.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    margin_m : cells this near before a thing are not free; where that place is beside the picture, it is looked at too.
    """
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    _hide(grid, inverse_depth, kind, intrinsics, T_camera_floor, corner, robot_height_m, margin_m)


@njit(cache=True, nogil=True)
def _hide(grid, inverse, kind, intrinsics, T, corner, robot_height, margin):  # type: ignore[no-untyped-def]
    """Free cells become unknown where a thing hides the space above one of their corners (a chair's seat)."""
    rows, cols = grid.shape
    covered = _covered(grid, inverse, kind, intrinsics, T, corner, robot_height, margin)
    for i in range(rows):
        for j in range(cols):
            hidden = covered[i, j] or covered[i + 1, j] or covered[i, j + 1] or covered[i + 1, j + 1]
            if hidden and grid[i, j] == FREE_CELL:
                grid[i, j] = UNKNOWN_CELL


@njit(cache=True, nogil=True)
def _covered(grid, inverse, kind, intrinsics, T, corner, robot_height, margin):  # type: ignore[no-untyped-def]
    """Corners (rows + 1, cols + 1) of free cells over which something nearer hides part of the space."""
    fx, fy, cx, cy = intrinsics
    x0, y0, size = corner
    rows, cols = grid.shape
    height, width = inverse.shape
    steps = int(robot_height / _STEP_M)
    covered = np.zeros((rows + 1, cols + 1), np.bool_)
    for i in range(rows + 1):
        for j in range(cols + 1):
            near = False
            for m in range(max(i - 1, 0), min(i + 1, rows)):
                for n in range(max(j - 1, 0), min(j + 1, cols)):
                    near = near or grid[m, n] == FREE_CELL
            if not near:
                continue
            x, y = x0 + j * size, y0 + i * size
            farther = 1.0 + margin / max(np.sqrt(x * x + y * y), 1e-9)
            for place in range(2):
                if place == 1:  # within the margin behind the corner, where the picture's side cuts that off
                    x, y = x * farther, y * farther
                px, py = T[0, 0] * x + T[0, 1] * y + T[0, 3], T[1, 0] * x + T[1, 1] * y + T[1, 3]
                pz = T[2, 0] * x + T[2, 1] * y + T[2, 3]
                foot = px / max(pz, 0.1) * fx + cx
                if covered[i, j] or (place == 1 and 0 <= foot <= width - 1):
                    break
                hidden = 0
                for k in range(1, steps + 1):
                    h = k * _STEP_M
                    z = pz + T[2, 2] * h
                    if z < 0.1:
                        continue
                    w = 1.0 / z
                    u = int(np.rint((px + T[0, 2] * h) * w * fx + cx))
                    v = int(np.rint((py + T[1, 2] * h) * w * fy + cy))
                    # What the side of the picture cuts off goes on beyond it, and may be the thing right here.
                    cut = u < 0 or u >= width
                    u = min(max(u, 0), width - 1)
                    if v < 0 or v >= height or inverse[v, u] <= 0.0:
                        continue
                    # how far it stands before the space: z - 1 / inverse, without a division
                    goes_on = cut and kind[v, u] == OBSTACLE_PIXEL
                    least, most = z - (_CUT_M if goes_on else _COVER_M[0]), z - _COVER_M[1]
                    if least * inverse[v, u] > 1.0 and most * inverse[v, u] < 1.0:
                        hidden += 2 if goes_on else 1
                        if hidden >= _MIN_HIDDEN:
                            covered[i, j] = True
                            break
    return covered
