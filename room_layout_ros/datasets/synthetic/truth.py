"""What is true of a synthetic view: face names, layout, cuboid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import CEILING, FLOOR, FRONT_WALL, LEFT_WALL, N_FACES, RIGHT_WALL
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid

from .raster import camera_rectangles, cast
from .room import SyntheticRoom

MIN_VISIBLE_SHARE = 0.005
"""A face that covers less of the image does not take part in the choice of the front wall."""

_LEVEL = 0.5
"""|n_z| above which a surface is floor or ceiling (a sloped ceiling up to 60 degrees)."""


def cast_shell(
    room: SyntheticRoom, camera: CameraIntrinsics, T_world_camera: NDArray[np.float64]
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float64]]:
    """Cast the empty room.

    Returns
    -------
    layout : (H, W) uint8 face ids, depth_m : (H, W) float32, R_room_camera : (3, 3) float64 with the front
    axis by the one rule: the visible wall that faces the camera most.
    """
    index, depth_m = cast(camera_rectangles(room.shell, T_world_camera), camera)
    normals = np.array([surface.normal for surface in room.shell])
    R_room_camera = room_axes(normals, index, T_world_camera[:3, :3])
    faces = np.append(face_ids(normals @ T_world_camera[:3, :3] @ R_room_camera.T), 0).astype(np.uint8)
    return faces[index], depth_m, R_room_camera


def room_axes(
    normals: NDArray[np.float64], index: NDArray[np.int32], R_world_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return R_room_camera (rows X right, Y down, Z front) from outward world normals and the surfaces in view."""
    pixels = np.bincount(index[index >= 0], minlength=len(normals))
    wall = np.abs(normals[:, 2]) < _LEVEL
    visible = wall & (pixels >= MIN_VISIBLE_SHARE * index.size)
    facing = normals @ R_world_camera[:, 2]
    front = int(np.argmax(np.where(visible if visible.any() else wall, facing, -np.inf)))
    Z = normals[front] @ R_world_camera
    Y = np.array([0.0, 0.0, -1.0]) @ R_world_camera
    return np.array([np.cross(Y, Z), Y, Z])


def face_ids(normals_room: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the face of each outward normal (n, 3) in room axes (x right, y down, z front); 0 for behind."""
    x, y, z = normals_room.T
    sides = np.where(x > 0, RIGHT_WALL, LEFT_WALL)
    walls = np.where(np.abs(x) > np.abs(z), sides, np.where(z > 0, FRONT_WALL, 0))
    return np.where(y > _LEVEL, FLOOR, np.where(y < -_LEVEL, CEILING, walls))


def true_cuboid(
    room: SyntheticRoom,
    layout: NDArray[np.uint8],
    R_room_camera: NDArray[np.float64],
    T_world_camera: NDArray[np.float64],
) -> RoomCuboid | None:
    """Return the cuboid with the faces in view, None where the room is none."""
    if not room.is_cuboid:
        return None
    R_world_room = T_world_camera[:3, :3] @ R_room_camera.T
    position = T_world_camera[:3, 3]
    corners = np.concatenate([np.c_[room.corners, np.zeros(4)], np.c_[room.corners, np.full(4, room.height)]])
    local = (corners - position) @ R_world_room
    extent = np.where(FACE_SIGN > 0, local.max(axis=0)[FACE_AXIS], -local.min(axis=0)[FACE_AXIS])
    seen = np.bincount(layout.ravel(), minlength=N_FACES + 1)[1:] > 0
    return RoomCuboid(R_room_camera, np.where(seen, extent, np.inf))
