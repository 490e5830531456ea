"""RoomEstimate -> polygons and markers."""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.labels import LABEL_COLORS, LABEL_NAMES
from room_layout_ros.core.layout import FacePolygon

from .header import encode_header
from .messages import ColorRGBA, Marker, MarkerArray, Point, Point32, PolygonInstanceStamped, String
from .stamp import NS_PER_S

_FILL_ALPHA = 0.35
_LINE_WIDTH_M = 0.03
_TEXT_HEIGHT_M = 0.18


def encode_label_names() -> String:
    """Return {"id": "name"} of the label image as JSON, for the latched topic."""
    return String(data=json.dumps(dict(enumerate(LABEL_NAMES))))


def encode_polygons(estimate: RoomEstimate) -> list[PolygonInstanceStamped]:
    """Return one metric polygon per visible face; its id is the label id of the face."""
    messages = []
    for polygon in estimate.polygons:
        message = PolygonInstanceStamped(header=encode_header(estimate.stamp_ns, estimate.frame_id))
        message.polygon.id = int(polygon.face)
        message.polygon.polygon.points = [Point32(x=x, y=y, z=z) for x, y, z in polygon.points_m.tolist()]
        messages.append(message)
    return messages


def encode_markers(estimate: RoomEstimate, lifetime_s: float) -> MarkerArray:
    """Return the room for RViz: per face a translucent fill, an outline and a text with name and distance.

    Ids are those of the faces, so each frame replaces the one before; a face that goes out of view
    disappears when its lifetime ends.
    """
    markers = []
    for polygon in estimate.polygons:
        markers.append(_fill(estimate, polygon, lifetime_s))
        markers.append(_outline(estimate, polygon, lifetime_s))
        markers.append(_text(estimate, polygon, lifetime_s))
    return MarkerArray(markers=markers)


def encode_color(label: int, alpha: float = 1.0) -> ColorRGBA:
    """Return the colour of a label id, as in the pictures."""
    red, green, blue = (float(c) / 255.0 for c in LABEL_COLORS[label])
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)


def encode_points(points: NDArray[np.float64]) -> list[Point]:
    """Return (n, 3) points as a list of geometry_msgs/Point."""
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]


def new_marker(estimate: RoomEstimate, namespace: str, number: int, kind: int, lifetime_s: float) -> Marker:
    """Return a marker in the frame and at the time of the estimate.

    A message makes all its parts itself, also those it is given: filling them costs half of giving them.
    """
    marker = Marker()
    sec, nanosec = divmod(estimate.stamp_ns, NS_PER_S)
    for header in (marker.header, marker.texture.header):  # the texture is empty, but every header is alike
        header.stamp.sec, header.stamp.nanosec, header.frame_id = sec, nanosec, estimate.frame_id
    marker.ns, marker.id, marker.type, marker.action = namespace, number, kind, Marker.ADD
    marker.pose.orientation.w = 1.0
    marker.lifetime.sec, marker.lifetime.nanosec = int(lifetime_s), int(lifetime_s % 1.0 * NS_PER_S)
    return marker


def _fill(estimate: RoomEstimate, polygon: FacePolygon, lifetime_s: float) -> Marker:
    marker = new_marker(estimate, "faces", polygon.face, Marker.TRIANGLE_LIST, lifetime_s)
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    marker.color = encode_color(polygon.face, _FILL_ALPHA)
    corners = encode_points(polygon.points_m)  # convex: a fan covers it
    marker.points = [corners[k] for i in range(1, len(corners) - 1) for k in (0, i, i + 1)]
    return marker


def _outline(estimate: RoomEstimate, polygon: FacePolygon, lifetime_s: float) -> Marker:
    marker = new_marker(estimate, "edges", polygon.face, Marker.LINE_STRIP, lifetime_s)
    marker.scale.x = _LINE_WIDTH_M
    marker.color = encode_color(polygon.face)
    corners = encode_points(polygon.points_m)
    marker.points = [*corners, corners[0]]
    return marker


def _text(estimate: RoomEstimate, polygon: FacePolygon, lifetime_s: float) -> Marker:
    marker = new_marker(estimate, "names", polygon.face, Marker.TEXT_VIEW_FACING, lifetime_s)
    marker.scale.z = _TEXT_HEIGHT_M
    marker.color = encode_color(polygon.face)
    centre = polygon.points_m.mean(axis=0)
    position = marker.pose.position
    position.x, position.y, position.z = centre.tolist()
    unit = " m" if estimate.metric else ""
    marker.text = f"{LABEL_NAMES[polygon.face]} {polygon.distance:.2f}{unit}"
    return marker
