"""The floor frame, and the room's outline in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..labels import WALL_FACES
from ..layout import FACE_AXIS, FACE_SIGN, RoomCuboid

_VERTICAL = 0.98


def floor_frame(normal: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
    """Return T_camera_floor (4, 4): origin on the floor below the camera, x ahead, y left, z up (REP-103).

    Ahead is the optical axis laid on the floor; where the camera looks straight down, the upper edge of the image.

    Parameters
    ----------
    normal : (3,) float64 unit vector down in the camera frame. distance_m : height of the camera.
    """
    ahead = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < _VERTICAL else np.array([0.0, -1.0, 0.0])
    x = ahead - (ahead @ normal) * normal
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(-normal, x), -normal, normal * distance_m
    return T


def view_fan(camera: CameraIntrinsics, T_camera_floor: NDArray[np.float64]) -> tuple[float, float]:
    """Return the bearings of what is in the picture, the rightmost and the leftmost, within the half circle ahead.

    Radians counter-clockwise from ahead. Those of the corners that lie ahead: of a camera that looks down or hangs on
    its side they are not those of the picture's sides. Where the picture's border passes the camera it ends the half
    circle on that side; a bearing of a corner behind would not tell on which. Of a picture of which nothing lies ahead
    the whole half circle.
    """
    u = np.array([-0.5, camera.width - 0.5, camera.width - 0.5, -0.5])  # along the border
    v = np.array([-0.5, -0.5, camera.height - 0.5, camera.height - 0.5])
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(4)], axis=1)
    ahead, left, _ = (rays @ T_camera_floor[:3, :3]).T
    is_ahead, next_ahead, next_left = ahead > 0.0, np.roll(ahead, -1), np.roll(left, -1)
    passes = is_ahead != (next_ahead > 0.0)
    beside = (left * next_ahead - next_left * ahead) * (next_ahead - ahead)  # has the sign of left where ahead is 0
    bearings = np.append(np.arctan2(left, ahead)[is_ahead], np.copysign(0.5 * np.pi, beside[passes]))
    return (float(bearings.min()), float(bearings.max())) if len(bearings) else (-0.5 * np.pi, 0.5 * np.pi)


def walls_on_floor(cuboid: RoomCuboid | None, T_camera_floor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 4) float64 a, b, c and face index of the walls in view: inside is a x + b y <= c (unit (a, b))."""
    rows = []
    for k in WALL_FACES:
        if cuboid is None or not np.isfinite(cuboid.distances[k]):
            continue
        outward = FACE_SIGN[k] * cuboid.R_room_camera[FACE_AXIS[k]]
        a, b = outward @ T_camera_floor[:3, 0], outward @ T_camera_floor[:3, 1]
        length = float(np.hypot(a, b))
        if length > 0.5:  # a wall leans by less than 60 degrees
            c = cuboid.distances[k] - outward @ T_camera_floor[:3, 3]
            rows.append([a / length, b / length, c / length, k])
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def room_outline(walls: NDArray[np.float64], box: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """Return the room on the floor: (n, 2) float64 corners, counter-clockwise, clipped to x0, y0, x1, y1."""
    x0, y0, x1, y1 = box
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    for a, b, c, _ in walls:
        side = c - corners @ (a, b)
        kept = []
        for i in range(len(corners)):
            j = (i + 1) % len(corners)
            if side[i] >= 0:
                kept.append(corners[i])
            if (side[i] >= 0) != (side[j] >= 0):
                kept.append(corners[i] + side[i] / (side[i] - side[j]) * (corners[j] - corners[i]))
        corners = np.array(kept).reshape(-1, 2)
        if not len(corners):
            break
    return corners
