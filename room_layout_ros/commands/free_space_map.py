"""Free space of a frame as the two files of a map that Nav2's map_server loads: a picture and its YAML."""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, FreeSpace
from room_layout_ros.datasets.images import encode_image

_SHADES = {FREE_CELL: 254, OCCUPIED_CELL: 0}
_UNKNOWN_SHADE = 128
"""Between both thresholds; the usual 205 is free to a map_server of the usual threshold 0.25."""


def map_files(name: str, space: FreeSpace) -> dict[str, bytes]:
    """Return the files by the end of their names.

    The map's frame is that on the floor below the camera: x ahead, to the right in the picture, y left, up in it.
    """
    shades: NDArray[np.uint8] = np.full(space.grid.shape, _UNKNOWN_SHADE, np.uint8)
    for cell, shade in _SHADES.items():
        shades[space.grid == cell] = shade
    x, y = (float(value) for value in space.origin_m)
    text = (
        f"image: {json.dumps(f'{name}.png')}\nmode: trinary\nresolution: {float(space.resolution_m)}\n"
        f"origin: [{x}, {y}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    return {".png": encode_image(".png", shades[::-1]), ".yaml": text.encode()}
