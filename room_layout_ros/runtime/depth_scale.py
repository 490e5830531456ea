"""How large the room looks by its depth: depth of a wrong unit is a room like any other, of another size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import FLOOR

_STRIDE = 8
"""Every eighth row and column: the median of 4800 pixels takes 0.1 ms."""


class DepthScale(NamedTuple):
    """Median of the measured depths of a frame, and the camera's height over the estimated floor (None without)."""

    median_depth_m: float
    camera_height_m: float | None


def measure_scale(frame: RgbdFrame, estimate: RoomEstimate) -> DepthScale | None:
    """Return the scale of a frame; None where depth is not used or measures nothing."""
    if frame.depth_m is None or not estimate.metric:
        return None
    depth_m = frame.depth_m[::_STRIDE, ::_STRIDE]
    measured = depth_m[np.isfinite(depth_m) & (depth_m > 0)]
    if measured.size == 0:
        return None
    floor_m = float("inf") if estimate.cuboid is None else float(estimate.cuboid.distances[FLOOR - 1])
    return DepthScale(float(np.median(measured)), floor_m if np.isfinite(floor_m) else None)
