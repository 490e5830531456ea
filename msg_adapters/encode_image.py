"""Arrays -> sensor_msgs/Image."""

from __future__ import annotations

import array

import numpy as np
from numpy.typing import NDArray

from .header import encode_header
from .messages import Image

_ENCODINGS = {("|u1", 1): "mono8", ("|u1", 3): "rgb8", ("<u2", 1): "16UC1", ("<f4", 1): "32FC1"}


def encode_image(pixels: NDArray[np.generic], stamp_ns: int, frame_id: str) -> Image:
    """Return (H, W) uint8 as mono8, (H, W, 3) uint8 as rgb8, (H, W) uint16 as 16UC1, (H, W) float32 as 32FC1.

    Raises
    ------
    ValueError
        For any other array.
    """
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    encoding = _ENCODINGS.get((pixels.dtype.str, channels))
    if encoding is None or pixels.ndim not in (2, 3):
        raise ValueError(f"image is {pixels.dtype} of shape {pixels.shape}; there is no encoding for that here")
    message = Image(header=encode_header(stamp_ns, frame_id))
    message.height, message.width = pixels.shape[:2]
    message.encoding = encoding
    message.step = message.width * channels * pixels.itemsize
    message.data = pack_bytes(pixels)
    return message


def pack_bytes(pixels: NDArray[np.generic]) -> array.array[int]:
    """Return the bytes as array.array('B'): the one type that rclpy takes over without looking at each element.

    0.015 ms for a 640x480 mono8 image; a numpy array or memoryview in its place costs 23-47 ms.
    """
    packed = array.array("B")
    packed.frombytes(np.ascontiguousarray(pixels).reshape(-1).view(np.uint8).data)
    return packed
