"""sensor_msgs/CameraInfo -> CameraIntrinsics: the decoder of `room_layout_ros.decoding.camera_info`."""

from __future__ import annotations

from room_layout_ros.decoding.camera_info import CameraReading, check_size, decode_camera_info

__all__ = ["CameraReading", "check_size", "decode_camera_info"]
