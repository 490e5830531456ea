"""What the decoders need of a message: fields, not classes. rclpy's and rosbags' messages both have them."""

from __future__ import annotations

from typing import Any, Protocol

Buffer = Any
"""Anything `memoryview` takes: bytes, array.array, a uint8 numpy array (typing has a name for it from 3.12 on)."""


class StampLike(Protocol):
    """builtin_interfaces/Time."""

    @property
    def sec(self) -> int: ...
    @property
    def nanosec(self) -> int: ...


class HeaderLike(Protocol):
    """std_msgs/Header."""

    @property
    def stamp(self) -> StampLike: ...
    @property
    def frame_id(self) -> str: ...


class ImageLike(Protocol):
    """sensor_msgs/Image."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def height(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def encoding(self) -> str: ...
    @property
    def is_bigendian(self) -> int: ...
    @property
    def step(self) -> int: ...
    @property
    def data(self) -> Buffer: ...


class CompressedImageLike(Protocol):
    """sensor_msgs/CompressedImage."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def format(self) -> str: ...
    @property
    def data(self) -> Buffer: ...


class RegionLike(Protocol):
    """sensor_msgs/RegionOfInterest."""

    @property
    def x_offset(self) -> int: ...
    @property
    def y_offset(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def width(self) -> int: ...


class CameraInfoLike(Protocol):
    """sensor_msgs/CameraInfo (rosbags and rclpy: `k`, `p`, `d` in lower case)."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def height(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def binning_x(self) -> int: ...
    @property
    def binning_y(self) -> int: ...
    @property
    def roi(self) -> RegionLike: ...
