"""The dashboard's picture of the free-space grid, the same for a running node and for a bag."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.datasets.images import encode_image

_UNKNOWN, _FREE, _OCCUPIED = (np.array(c) for c in ((120, 126, 136), (235, 240, 246), (30, 36, 46)))
_OCCUPIED_FROM = 50
_SIDE_PX = 480
_JPEG_QUALITY = 92


def draw_plan(cells: NDArray[np.int8]) -> bytes:
    """Draw a grid as JPEG: free bright, occupied dark, unknown between; ahead (x) is right, left (y) is up.

    Parameters
    ----------
    cells : (rows, cols) int8
        As in an OccupancyGrid: -1 unknown, 0 free to 100 occupied, row 0 the lower edge; not empty.
    """
    layer = cells[:, :, None]
    colors = np.select([layer < 0, layer < _OCCUPIED_FROM], [_UNKNOWN, _FREE], _OCCUPIED).astype(np.uint8)
    scale = max(1, _SIDE_PX // max(cells.shape))
    upright = np.ascontiguousarray(colors[::-1])
    return encode_image(".jpg", upright.repeat(scale, axis=0).repeat(scale, axis=1), _JPEG_QUALITY)
