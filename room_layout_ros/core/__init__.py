"""The algorithm: layout and clutter of a room from one RGB-D frame. Knows no ROS."""

from .config import EstimatorConfig
from .estimate import RoomEstimate, Status
from .frame import CameraIntrinsics, RgbdFrame
from .layout import FacePolygon, RoomCuboid

__all__ = [
    "CameraIntrinsics",
    "EstimatorConfig",
    "FacePolygon",
    "RgbdFrame",
    "RoomCuboid",
    "RoomEstimate",
    "Status",
]
