"""The slow obvious twins of the ray caster, the projector's shadow and the floor map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.datasets.synthetic.room import SyntheticRoom
from room_layout_ros.datasets.synthetic.shapes import Surface


def cast_pixel(
    surfaces: Sequence[Surface], camera: CameraIntrinsics, T_world_camera: NDArray[np.float64], x: int, y: int
) -> tuple[int, float]:
    """Intersect one ray with every rectangle in the world frame; nearest wins (patches by a hair)."""
    eye = T_world_camera[:3, 3]
    ray = T_world_camera[:3, :3] @ np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])
    best, index, depth = np.inf, -1, np.inf
    for i, s in enumerate(surfaces):
        normal = np.cross(s.u, s.v)
        slope = normal @ ray
        if slope == 0:
            continue
        z = normal @ (s.origin - eye) / slope  # the ray has z = 1 in the camera: its parameter is the depth
        place = eye + z * ray - s.origin
        a, b = place @ s.u / (s.u @ s.u), place @ s.v / (s.v @ s.v)
        key = z / (1 + 1e-4 * s.patch)
        if z > 0 and 0 <= a <= 1 and 0 <= b <= 1 and key < best:
            best, index, depth = key, i, z
    return index, float(depth)


def hidden_from_projector(disparity: NDArray[np.float32], y: int, x: int) -> bool:
    """Whether a pixel to the right of this one is seen by the projector at or left of its column."""
    return any(x2 - disparity[y, x2] < x - disparity[y, x] - 0.5 for x2 in range(x + 1, disparity.shape[1]))


def stands_in_cell(room: SyntheticRoom, corners: NDArray[np.float64], samples: int = 12) -> bool:
    """Whether any of many points of a square cell (its four corners, world) lies in a solid or outside the room."""
    for a in np.linspace(0.02, 0.98, samples):
        for b in np.linspace(0.02, 0.98, samples):
            p = corners[0] + a * (corners[1] - corners[0]) + b * (corners[3] - corners[0])
            parts = room.floor_parts
            if not np.any(
                (parts[:, 0] <= p[0]) & (p[0] <= parts[:, 2]) & (parts[:, 1] <= p[1]) & (p[1] <= parts[:, 3])
            ):
                return True
            for s in room.solids:
                local = s.axes @ (p - [s.x, s.y])
                if s.top > 0.02 and s.bottom < 2.0 and abs(local[0]) <= s.size_x / 2 and abs(local[1]) <= s.size_y / 2:
                    return True
    return False
