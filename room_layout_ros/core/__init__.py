"""The algorithm: layout and clutter of a room from one RGB-D frame. Knows no ROS."""

from pathlib import Path

from .kernel_cache import drop_stale_kernels

drop_stale_kernels(Path(__file__).parent)  # before the first kernel is loaded

# ruff: noqa: E402
from .config import EstimatorConfig
from .estimate import RoomEstimate, Status
from .estimator import LayoutEstimator
from .frame import CameraIntrinsics, RgbdFrame
from .layout import FacePolygon, RoomCuboid
from .tracking import TemporalPrior, next_prior

__all__ = [
    "CameraIntrinsics",
    "EstimatorConfig",
    "FacePolygon",
    "LayoutEstimator",
    "RgbdFrame",
    "RoomCuboid",
    "RoomEstimate",
    "Status",
    "TemporalPrior",
    "next_prior",
]
