"""Floor that is seen below something: the seat behind a chair's back, the table over its legs."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics

_STEP_M, _STEPS = 0.05, 24
_MIN_HIDDEN = 4
_COVER_M = (0.08, 0.6)
"""What stands this far before the space above a cell hides what may hang there."""

_CUT_M = -0.15
"""At the side of the picture also what stands this little behind it."""


def hide_overhung(
    grid: NDArray[np.int8],
    inverse_depth: NDArray[np.float32],
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
    robot_height_m: float,
) -> None:
    """Make free cells unknown where a thing hides the space above one of their corners, up to the robot's height.

    Parameters
    ----------
    grid : (rows, cols) int8, changed in place. inverse_depth : (H, W) float32, 0 where nothing was measured.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    """
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    _hide(grid, inverse_depth, intrinsics, T_camera_floor, corner, robot_height_m)


@njit(cache=True, nogil=True)
def _hide(grid, inverse, intrinsics, T, corner, robot_height):  # type: ignore[no-untyped-def]
    """Free cells become unknown where a thing hides the space above one of their corners (a chair's seat)."""
    x0, y0, size = corner
    covered = np.zeros((grid.shape[0] + 1, grid.shape[1] + 1), np.bool_)
    for i in range(grid.shape[0] + 1):
        for j in range(grid.shape[1] + 1):
            near = False
            for m in range(max(i - 1, 0), min(i + 1, grid.shape[0])):
                for n in range(max(j - 1, 0), min(j + 1, grid.shape[1])):
                    near = near or grid[m, n] == 0
            if near:
                covered[i, j] = _is_covered(x0 + j * size, y0 + i * size, inverse, intrinsics, T, robot_height)
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            hidden = covered[i, j] or covered[i + 1, j] or covered[i, j + 1] or covered[i + 1, j + 1]
            if hidden and grid[i, j] == 0:
                grid[i, j] = -1


@njit(cache=True, nogil=True)
def _is_covered(x, y, inverse, intrinsics, T, robot_height):  # type: ignore[no-untyped-def]
    """Whether something nearer hides part of the space above a point of the floor."""
    fx, fy, cx, cy = intrinsics
    height, width = inverse.shape
    hidden = 0
    for k in range(1, min(int(robot_height / _STEP_M), _STEPS) + 1):
        h = k * _STEP_M
        z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * h + T[2, 3]
        if z < 0.1:
            continue
        u = int(np.rint((T[0, 0] * x + T[0, 1] * y + T[0, 2] * h + T[0, 3]) / z * fx + cx))
        v = int(np.rint((T[1, 0] * x + T[1, 1] * y + T[1, 2] * h + T[1, 3]) / z * fy + cy))
        # What the side of the picture cuts off goes on beyond it, and may be the thing right here.
        cut = u < 0 or u >= width
        u = min(max(u, 0), width - 1)
        if v < 0 or v >= height or inverse[v, u] <= 0.0:
            continue
        before = z - 1.0 / inverse[v, u]
        if before > (_CUT_M if cut else _COVER_M[0]) and before < _COVER_M[1]:
            hidden += 2 if cut else 1
    return hidden >= _MIN_HIDDEN
