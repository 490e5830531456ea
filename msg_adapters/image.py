"""sensor_msgs/Image -> colour and depth arrays: the decoders of `room_layout_ros.decoding.image`."""

from __future__ import annotations

from room_layout_ros.decoding.image import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    check_color,
    check_depth,
    decode_color,
    decode_depth,
    depth_from_mm,
)

__all__ = [
    "COLOR_ENCODINGS",
    "DEPTH_ENCODINGS",
    "check_color",
    "check_depth",
    "decode_color",
    "decode_depth",
    "depth_from_mm",
]
