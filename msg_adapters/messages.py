"""The one place where message classes are imported: a change of message package is a change of this file."""

from __future__ import annotations

from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Point32, PolygonInstance, PolygonInstanceStamped, Vector3
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import ColorRGBA, Header, String
from visualization_msgs.msg import Marker, MarkerArray

__all__ = [
    "CameraInfo",
    "ColorRGBA",
    "CompressedImage",
    "DiagnosticArray",
    "DiagnosticStatus",
    "Duration",
    "Header",
    "Image",
    "KeyValue",
    "Marker",
    "MarkerArray",
    "Point",
    "Point32",
    "PolygonInstance",
    "PolygonInstanceStamped",
    "String",
    "Time",
    "Vector3",
]
