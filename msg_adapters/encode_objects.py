"""Things in the room -> markers: boxes and names."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.cuboids import ObjectCuboid
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.labels import CLUTTER, FURNITURE_NYU40

from .encode_navigation import encode_rotation
from .encode_room import encode_color, new_marker
from .messages import ColorRGBA, Marker, MarkerArray

_ALPHA = 0.45
_TEXT_HEIGHT_M = 0.14


def encode_objects(
    objects: Sequence[ObjectCuboid], T_camera_floor: NDArray[np.float64], estimate: RoomEstimate, lifetime_s: float
) -> MarkerArray:
    """Return a box and a text with class and size for each thing, the largest with number 0, in the camera's frame."""
    markers = []
    for number, thing in enumerate(objects):
        size = thing.size_m
        box = new_marker(estimate, "objects", number, Marker.CUBE, lifetime_s)
        pose, position = T_camera_floor @ _pose(thing), box.pose.position
        position.x, position.y, position.z = pose[:3, 3].tolist()
        box.pose.orientation = encode_rotation(pose[:3, :3])
        box.scale.x, box.scale.y, box.scale.z = size.tolist()
        box.color = _color(thing.nyu40)
        text = new_marker(estimate, "object names", number, Marker.TEXT_VIEW_FACING, lifetime_s)
        above = thing.center_m + np.array([0.0, 0.0, 0.5 * size[2] + _TEXT_HEIGHT_M])
        position = text.pose.position
        position.x, position.y, position.z = (T_camera_floor @ np.append(above, 1.0))[:3].tolist()
        text.scale.z = _TEXT_HEIGHT_M
        text.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
        name = FURNITURE_NYU40.get(thing.nyu40, "object")
        text.text = f"{name} {' x '.join(f'{side:.2f}' for side in size)} m"
        markers += [box, text]
    return MarkerArray(markers=markers)


def _pose(thing: ObjectCuboid) -> NDArray[np.float64]:
    """Return (4, 4) pose of a box in the floor frame."""
    c, s = np.cos(thing.yaw), np.sin(thing.yaw)
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = thing.center_m
    return pose


def _color(nyu40: int) -> ColorRGBA:
    """Return a colour of its own for each class, the clutter's grey for the rest."""
    if nyu40 not in FURNITURE_NYU40:
        return encode_color(CLUTTER, _ALPHA)
    hue = list(FURNITURE_NYU40).index(nyu40) / len(FURNITURE_NYU40)
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.65, 0.95)
    return ColorRGBA(r=red, g=green, b=blue, a=_ALPHA)
