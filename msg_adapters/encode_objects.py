"""Things in the room -> markers: boxes and names."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

from room_layout_ros.core.cuboids import ObjectCuboid
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.labels import CLUTTER, FURNITURE_NYU40

from .encode_navigation import encode_pose
from .encode_room import encode_color, new_marker
from .messages import ColorRGBA, Marker, MarkerArray, Vector3

_ALPHA = 0.45
_TEXT_HEIGHT_M = 0.14


def encode_objects(objects: Sequence[ObjectCuboid], estimate: RoomEstimate, lifetime_s: float) -> MarkerArray:
    """Return a box and a text with class and size for each thing, the largest in the image with number 0."""
    markers = []
    for number, thing in enumerate(objects):
        box = new_marker(estimate, "objects", number, Marker.CUBE, lifetime_s)
        box.pose = encode_pose(thing.T_camera_object, estimate.stamp_ns, estimate.frame_id).pose
        box.scale = Vector3(x=float(thing.size_m[0]), y=float(thing.size_m[1]), z=float(thing.size_m[2]))
        box.color = _color(thing.nyu40)
        name = FURNITURE_NYU40.get(thing.nyu40, "object")
        text = new_marker(estimate, "object names", number, Marker.TEXT_VIEW_FACING, lifetime_s)
        above = thing.T_camera_object.copy()
        above[:3, 3] += above[:3, 2] * (0.5 * thing.size_m[2] + _TEXT_HEIGHT_M)
        text.pose.position = encode_pose(above, estimate.stamp_ns, estimate.frame_id).pose.position
        text.scale.z = _TEXT_HEIGHT_M
        text.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
        text.text = f"{name} {' x '.join(f'{side:.2f}' for side in thing.size_m)} m"
        markers += [box, text]
    return MarkerArray(markers=markers)


def _color(nyu40: int) -> ColorRGBA:
    """Return a colour of its own for each class, the clutter's grey for the rest."""
    if nyu40 not in FURNITURE_NYU40:
        return encode_color(CLUTTER, _ALPHA)
    hue = list(FURNITURE_NYU40).index(nyu40) / len(FURNITURE_NYU40)
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.65, 0.95)
    return ColorRGBA(r=red, g=green, b=blue, a=_ALPHA)
