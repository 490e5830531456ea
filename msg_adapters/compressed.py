"""sensor_msgs/CompressedImage -> colour and depth arrays: the decoders of `room_layout_ros.decoding.compressed`."""

from __future__ import annotations

from room_layout_ros.decoding.compressed import (
    check_compressed_color,
    check_compressed_depth,
    decode_compressed_color,
    decode_compressed_depth,
)

__all__ = ["check_compressed_color", "check_compressed_depth", "decode_compressed_color", "decode_compressed_depth"]
