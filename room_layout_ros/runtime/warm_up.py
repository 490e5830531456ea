"""A room to warm up with: compiles every kernel before the first real frame waits for it."""

from __future__ import annotations

import numpy as np

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.layout import RoomCuboid


def warm_up_frame(scale: float = 1.0) -> RgbdFrame:
    """Return a plain box room of 4 x 2.5 x 4 m seen from inside, with colour and depth, 640x480 or a multiple of it."""
    camera = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5).scaled(scale)
    pitch = np.deg2rad(5.0)
    R = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    room = RoomCuboid(R, np.array([1.2, 1.3, 1.8, 3.5, 2.2]))
    depth_m = room.depth(camera)
    color = LABEL_COLORS[room.raster(camera)]
    depth_m[200:300, 300:400] = 2.0  # something to be clutter
    color[200:300, 300:400] = 120
    depth_m[440:450, 100:140] = np.nan  # a hole in the floor's depth
    color[:, ::40] //= 2  # lines for the line detector
    color.setflags(write=False)  # as that of a message is: numba compiles for it apart
    return RgbdFrame(camera, color, depth_m, stamp_ns=1, frame_id="warm_up")
