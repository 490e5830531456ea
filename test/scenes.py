"""Rooms and views whose truth is known exactly, for the tests of the core."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.layout import RoomCuboid

SMALL = CameraIntrinsics(160, 120, 131.25, 131.25, 79.5, 59.5)
TINY = CameraIntrinsics(40, 30, 33.0, 34.0, 18.2, 15.7)
HALF = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
ROOM = np.array([1.2, 1.3, 1.8, 3.5, 2.2])
"""Distances of ceiling, floor, left, front, right in m."""


def look(yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> NDArray[np.float64]:
    """Return R_room_camera of a camera turned right, then nodding down, then tilted."""
    a, b, c = np.deg2rad([yaw_deg, pitch_deg, roll_deg])
    yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(b), np.sin(b)], [0, -np.sin(b), np.cos(b)]])
    roll = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return np.asarray(yaw @ pitch @ roll)


def seen_from_inside(
    camera: CameraIntrinsics = SMALL, R: NDArray[np.float64] | None = None, distances: NDArray[np.float64] = ROOM
) -> tuple[RgbdFrame, RoomCuboid]:
    """Return a frame of an empty room, each face in its own colour, and the room."""
    room = RoomCuboid(look(20.0, 8.0, 1.5) if R is None else R, distances)
    return RgbdFrame(camera, LABEL_COLORS[room.raster(camera)], room.depth(camera)), room
