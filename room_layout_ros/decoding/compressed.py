"""sensor_msgs/CompressedImage -> colour and depth arrays (image_transport's `compressed` and `compressedDepth`)."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import MAX_SIDE_PX

from .image import check_unit, depth_from_mm
from .protocols import CompressedImageLike
from .text import clean_text

_MAX_PIXELS = 32_000_000
"""A picture of a few bytes may unfold to gigabytes; no depth camera has more pixels than this."""
_PNG, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB\x60\x82"
_JPEG, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG segments that hold the size of the picture."""
_DEPTH_HEADER = 12
"""compressedDepth puts a format number and two quantisation parameters before the picture."""


def check_compressed_color(message: CompressedImageLike) -> tuple[int, int]:
    """Return (height, width) of a JPEG or PNG without decoding it.

    Raises
    ------
    ValueError
        When it is neither, too large, or cut.
    """
    return _picture_size("colour", memoryview(message.data).cast("B"))


def check_compressed_depth(message: CompressedImageLike) -> tuple[int, int]:
    """Return (height, width) of the PNG of a depth image without decoding it. Raises ValueError as its decoder."""
    picture = memoryview(message.data).cast("B")[bytes_before_depth(message) :]
    if bytes(picture[: len(_PNG)]) != _PNG:
        raise ValueError("compressed depth image holds no PNG")
    if bytes(picture[24:26]) != b"\x10\x00":
        raise ValueError("compressed depth image is no PNG of 16-bit grey")
    return _picture_size("depth", picture)


def bytes_before_depth(message: CompressedImageLike) -> int:
    """Return the number of bytes before the picture: none in image_transport's `compressed`, of 16UC1 as PNG.

    Raises
    ------
    ValueError
        When the message's format is no depth that can be read.
    """
    encoding, _, method = (part.strip() for part in str(message.format).partition(";"))
    if encoding in ("16UC1", "32FC1") and method in ("compressedDepth", "compressedDepth png"):
        return _DEPTH_HEADER
    if encoding == "16UC1" and method.split()[:2] == ["png", "compressed"]:
        return 0
    raise ValueError(
        f"depth image has format {clean_text(message.format)}; "
        "allowed are 16UC1 and 32FC1 as 'compressedDepth png', and 16UC1 as 'png compressed'"
    )


def decode_compressed_color(message: CompressedImageLike) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 RGB image. Grey is repeated, transparency dropped.

    Raises
    ------
    ValueError
        When it is no whole JPEG or PNG with 8 bits per channel.
    """
    check_compressed_color(message)
    pixels = _decode("colour", np.frombuffer(message.data, np.uint8))
    if pixels.dtype != np.uint8:
        raise ValueError(f"compressed colour image has {pixels.dtype} pixels; uint8 is needed")
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    conversion = {1: cv2.COLOR_GRAY2RGB, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}[channels]
    return cv2.cvtColor(pixels, conversion).astype(np.uint8, copy=False)


def decode_compressed_depth(message: CompressedImageLike) -> NDArray[np.float32]:
    """Return the (H, W) float32 depth in metres, NaN = not measured.

    16UC1 is millimetres; 32FC1 is inverse depth in steps, z = A / (step - B), with A and B before the picture.
    `compressedDepth` holds both, `compressed` 16UC1.

    Raises
    ------
    ValueError
        When it is no whole 16-bit PNG of one of these formats, or in the wrong unit.
    """
    check_compressed_depth(message)
    content = np.frombuffer(message.data, np.uint8)
    pixels = _decode("depth", content[bytes_before_depth(message) :])
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise ValueError(f"compressed depth image has shape {pixels.shape} of {pixels.dtype}; uint16 grey is needed")
    if message.format.startswith("16UC1"):
        check_unit(pixels, "16UC1")
        return depth_from_mm(pixels)
    a, b = struct.unpack_from("<ff", message.data, 4)
    if not (np.isfinite([a, b]).all() and a > 0):
        raise ValueError(f"compressed depth image has quantisation parameters {a:g}, {b:g}; A must be above 0")
    steps = pixels.astype(np.float32) - np.float32(b)
    depth_m = np.full(pixels.shape, np.nan, np.float32)
    np.divide(np.float32(a), steps, out=depth_m, where=(pixels > 0) & (steps > 0))
    check_unit(depth_m, "32FC1")
    return depth_m


def _decode(what: str, content: NDArray[np.uint8]) -> NDArray[Any]:
    pixels = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError(f"compressed {what} image is damaged and does not decode")
    return pixels


def _picture_size(what: str, content: memoryview) -> tuple[int, int]:
    if bytes(content[: len(_PNG)]) == _PNG:
        size, end = _png_size(content), _PNG_END
    elif bytes(content[: len(_JPEG)]) == _JPEG:
        size, end = _jpeg_size(content), _JPEG_END
    else:
        raise ValueError(f"compressed {what} image is neither PNG nor JPEG")
    if size is None or not _ends_with(content, end):
        raise ValueError(f"compressed {what} image of {len(content)} bytes is cut")
    height, width = size
    sides = 0 < height <= MAX_SIDE_PX and 0 < width <= MAX_SIDE_PX
    if not sides or height * width > _MAX_PIXELS:
        raise ValueError(
            f"{what} image is {width}x{height}; each side must be 1 to {MAX_SIDE_PX}, all at most {_MAX_PIXELS} pixels"
        )
    return height, width


def _ends_with(content: memoryview, end: bytes) -> bool:
    """Whether it ends so, zeros behind apart (some cameras send their whole buffer); copies no more than it needs."""
    taken = 64
    while len(tail := bytes(content[-taken:]).rstrip(b"\0")) < len(end) and taken < len(content):
        taken *= 8
    return tail.endswith(end)


def _png_size(content: memoryview) -> tuple[int, int] | None:
    if len(content) < 26:
        return None
    width, height = struct.unpack_from(">II", content, 16)
    return height, width


def _jpeg_size(content: memoryview) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        if content[at + 1] in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", content, at + 5)
            return height, width
        if content[at + 1] == 0xFF:  # fill byte
            at += 1
            continue
        at += 2 + struct.unpack_from(">H", content, at + 2)[0]
    return None
