"""Frames of a made-up room for tests of the node: any number, each different, each the same in every process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.layout import RoomCuboid

CAMERA = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
FRAME_ID = "camera_color_optical_frame"
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 33_333_333


def stamp_ns(i: int) -> int:
    """Time of frame `i` at 30 Hz."""
    return START_NS + i * PERIOD_NS


def room_images(i: int) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Return RGB and depth in mm of frame `i`: a box room with a crate, the camera turning slowly."""
    yaw, pitch = np.deg2rad(12.0 * np.sin(i / 20.0)), np.deg2rad(6.0)
    turn = np.array([[np.cos(yaw), 0, -np.sin(yaw)], [0, 1, 0], [np.sin(yaw), 0, np.cos(yaw)]])
    nod = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    room = RoomCuboid(turn @ nod, np.array([1.2, 1.3, 1.8, 3.5, 2.2]))
    depth_mm = np.rint(np.nan_to_num(room.depth(CAMERA), posinf=0.0) * 1000.0).astype(np.uint16)
    color = LABEL_COLORS[room.raster(CAMERA)]
    left = 200 + 2 * (i % 60)
    depth_mm[260:380, left : left + 120] = 2000
    color[260:380, left : left + 120] = (120, 80, 40)
    depth_mm[:20, :20] = 0
    return color, depth_mm


def room_frame(i: int) -> RgbdFrame:
    """Return frame `i` as the offline estimator sees it."""
    color, depth_mm = room_images(i)
    depth_m = depth_mm.astype(np.float32) * np.float32(0.001)
    depth_m[depth_mm == 0] = np.nan
    return RgbdFrame(CAMERA, color, depth_m, stamp_ns(i), FRAME_ID, f"{i:04d}")
