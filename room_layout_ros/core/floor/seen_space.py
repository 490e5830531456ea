"""How high over the floor the picture reaches: of what is above its edge nothing is known.

A camera that looks down steeply sees the floor between the legs of a table, and not its top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .floor_cells import FREE_CELL, UNKNOWN_CELL


def hide_above_picture(
    grid: NDArray[np.int8],
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
    height_m: float,
) -> None:
    """Make free cells unknown where the point at a height over their centre is not in the picture.

    Parameters
    ----------
    grid : (rows, cols) int8, changed in place.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.
    height_m : over the floor; 0 changes nothing.
    """
    if height_m <= 0.0:
        return
    i, j = np.nonzero(grid == FREE_CELL)
    x0, y0, size = corner
    over = np.stack([x0 + (j + 0.5) * size, y0 + (i + 0.5) * size, np.full(len(i), height_m)], axis=1)
    x, y, z = T_camera_floor[:3, :3] @ over.T + T_camera_floor[:3, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = x / z * camera.fx + camera.cx, y / z * camera.fy + camera.cy
    inside = (z > 0.0) & (np.abs(u - 0.5 * (camera.width - 1)) <= 0.5 * camera.width)
    inside &= np.abs(v - 0.5 * (camera.height - 1)) <= 0.5 * camera.height
    grid[i[~inside], j[~inside]] = UNKNOWN_CELL
