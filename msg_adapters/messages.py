"""The one place where message classes are imported: a change of message package is a change of this file."""

from __future__ import annotations

from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    Point,
    Point32,
    PolygonInstance,
    PolygonInstanceStamped,
    PolygonStamped,
    PoseStamped,
    Quaternion,
    TransformStamped,
    Vector3,
)
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, LaserScan, PointCloud2, PointField
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
    "Imu",
    "KeyValue",
    "LaserScan",
    "Marker",
    "MarkerArray",
    "OccupancyGrid",
    "Point",
    "Point32",
    "PointCloud2",
    "PointField",
    "PolygonInstance",
    "PolygonInstanceStamped",
    "PolygonStamped",
    "PoseStamped",
    "Quaternion",
    "String",
    "Time",
    "TransformStamped",
    "Vector3",
]
