"""Image and CameraInfo straight from their serialized form, without copying the pixels.

The node subscribes raw: a message that cannot be read then raises here, in a guarded place, instead of ending
`spin`; and reading only the fields costs 0.02 ms where rclpy takes 3 ms to make an Image of 640x480 rgb8, also for
images that are superseded before anyone looks at them. Reads plain CDR (XCDR1, both byte orders), which every ROS 2
middleware of Jazzy hands out. The results have the fields of the messages, so the decoders take them as they are.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MAX_TEXT = 256
"""No more of a string is read; the rest of a 10 MB encoding is skipped."""
_MAX_DISTORTION = 64


@dataclass(frozen=True, slots=True)
class Stamp:
    """builtin_interfaces/Time."""

    sec: int
    nanosec: int


@dataclass(frozen=True, slots=True)
class Header:
    """std_msgs/Header."""

    stamp: Stamp
    frame_id: str


@dataclass(frozen=True, slots=True)
class WireImage:
    """sensor_msgs/Image; `data` is a view of the serialized message."""

    header: Header
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: memoryview


@dataclass(frozen=True, slots=True)
class WireCompressedImage:
    """sensor_msgs/CompressedImage; `data` is a view of the serialized message."""

    header: Header
    format: str
    data: memoryview


@dataclass(frozen=True, slots=True)
class Region:
    """sensor_msgs/RegionOfInterest."""

    x_offset: int
    y_offset: int
    height: int
    width: int


@dataclass(frozen=True, slots=True)
class WireCameraInfo:
    """sensor_msgs/CameraInfo."""

    header: Header
    height: int
    width: int
    d: NDArray[np.float64]
    k: NDArray[np.float64]
    p: NDArray[np.float64]
    binning_x: int
    binning_y: int
    roi: Region


def read_image(serialized: bytes) -> WireImage:
    """Return the image message; its pixels stay where they are.

    Raises
    ------
    ValueError
        When the bytes end early or are not plain CDR.
    """
    reader = _Reader(serialized)
    header = reader.header()
    height, width = reader.u32(), reader.u32()
    encoding = reader.text()
    is_bigendian = reader.u8()
    step = reader.u32()
    return WireImage(header, height, width, encoding, is_bigendian, step, reader.bytes_())


def read_compressed_image(serialized: bytes) -> WireCompressedImage:
    """Return the compressed image message. Raises ValueError as `read_image`."""
    reader = _Reader(serialized)
    return WireCompressedImage(reader.header(), reader.text(), reader.bytes_())


def read_camera_info(serialized: bytes) -> WireCameraInfo:
    """Return the camera_info message. Raises ValueError as `read_image`."""
    reader = _Reader(serialized)
    header = reader.header()
    height, width = reader.u32(), reader.u32()
    reader.text()  # distortion_model
    d_size = reader.u32()
    if d_size > _MAX_DISTORTION:
        raise ValueError(f"camera_info has {d_size} distortion coefficients; at most {_MAX_DISTORTION} are allowed")
    d, k, _, p = (reader.doubles(n) for n in (d_size, 9, 9, 12))
    binning_x, binning_y = reader.u32(), reader.u32()
    roi = Region(reader.u32(), reader.u32(), reader.u32(), reader.u32())
    return WireCameraInfo(header, height, width, d, k, p, binning_x, binning_y, roi)


class _Reader:
    """Takes primitives off a CDR buffer; alignment counts from behind the four bytes of encapsulation."""

    def __init__(self, serialized: bytes) -> None:
        view = memoryview(serialized)
        if len(view) < 4 or view[0] != 0 or view[1] not in (0, 1):
            raise ValueError(f"message of {len(view)} bytes is not plain CDR")
        self._order = "<" if view[1] else ">"
        self._body = view[4:]
        self._at = 0

    def _take(self, size: int, alignment: int = 1) -> int:
        start = -(-self._at // alignment) * alignment
        if start + size > len(self._body):
            raise ValueError(f"message ends after {len(self._body) + 4} bytes; {start + size + 4} are needed")
        self._at = start + size
        return start

    def u8(self) -> int:
        return self._body[self._take(1)]

    def u32(self) -> int:
        return int(struct.unpack_from(self._order + "I", self._body, self._take(4, 4))[0])

    def header(self) -> Header:
        sec, nanosec = struct.unpack_from(self._order + "iI", self._body, self._take(8, 4))
        return Header(Stamp(sec, nanosec), self.text())

    def text(self) -> str:
        size = self.u32()
        start = self._take(size)
        shown = bytes(self._body[start : start + min(max(size - 1, 0), _MAX_TEXT)])  # without the closing NUL
        return shown.decode("utf-8", "replace")

    def bytes_(self) -> memoryview:
        size = self.u32()
        start = self._take(size)
        return self._body[start : start + size]

    def doubles(self, count: int) -> NDArray[np.float64]:
        if count == 0:
            return np.empty(0)
        start = self._take(8 * count, 8)
        return np.frombuffer(self._body, self._order + "f8", count, start).astype(np.float64)
