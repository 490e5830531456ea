"""sensor_msgs/Image -> colour and depth arrays. Checked in full before anything is allocated."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import MAX_SIDE_PX

from .protocols import ImageLike
from .text import clean_text

_COLOR_TO_RGB = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
}
_DEPTH_TYPES = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}

_OF_IMAGE_PROC = "bayer_", "yuv422"
"""How encodings begin that image_proc's debayer node takes."""

COLOR_ENCODINGS = tuple(_COLOR_TO_RGB)
DEPTH_ENCODINGS = tuple(_DEPTH_TYPES)

_PROBE_STEP = 16
"""The unit of depth is checked on every 16th pixel of every 16th row."""
_MAX_PLAUSIBLE_M = 200.0
_MIN_PLAUSIBLE_MM = 50


@dataclass(frozen=True, slots=True)
class _Layout:
    """How the bytes of an image message lie."""

    height: int
    width: int
    channels: int
    dtype: np.dtype[np.generic]
    step: int

    def view(self, message: ImageLike) -> NDArray[np.generic]:
        """Return the pixels as an array over the message's own memory (rows may be padded)."""
        shape = (self.height, self.width, self.channels)
        strides = (self.step, self.dtype.itemsize * self.channels, self.dtype.itemsize)
        pixels = np.ndarray(shape, self.dtype, buffer=message.data, strides=strides)
        return pixels if self.channels > 1 else pixels[..., 0]


def check_color(message: ImageLike) -> None:
    """Check a colour image without reading its pixels.

    Raises
    ------
    ValueError
        As `decode_color`.
    """
    _color_layout(message)


def check_depth(message: ImageLike) -> None:
    """Check a depth image without reading its pixels.

    Raises
    ------
    ValueError
        As `decode_depth`, but for the unit.
    """
    _depth_layout(message)


def decode_color(message: ImageLike) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 RGB image of an rgb8, bgr8, rgba8, bgra8 or mono8 message.

    An unpadded rgb8 image is a view of the message, everything else a copy.

    Raises
    ------
    ValueError
        When encoding, size, step or amount of data are not what the message type demands.
    """
    pixels = np.ascontiguousarray(_color_layout(message).view(message), dtype=np.uint8)
    conversion = _COLOR_TO_RGB[message.encoding][1]
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion).astype(np.uint8, copy=False)


def decode_depth(message: ImageLike) -> NDArray[np.float32]:
    """Return the (H, W) float32 depth in metres of a 16UC1, mono16 (mm) or 32FC1 (m) message; NaN = not measured.

    Raises
    ------
    ValueError
        When encoding, size, step or amount of data are not what the message type demands, or the values can only
        be in the wrong unit (REP-118: 16 bit is millimetres, float is metres).
    """
    layout = _depth_layout(message)
    pixels = layout.view(message)
    check_unit(pixels, message.encoding)
    if layout.dtype.kind == "u":
        return depth_from_mm(pixels)
    depth_m = pixels.astype(np.float32)
    depth_m[~((depth_m > 0) & (depth_m < np.inf))] = np.nan
    return depth_m


def depth_from_mm(depth_mm: NDArray[np.generic]) -> NDArray[np.float32]:
    """Return millimetres (0 = not measured) as float32 metres (NaN = not measured)."""
    depth_m = depth_mm.astype(np.float32)
    depth_m *= np.float32(0.001)
    depth_m[depth_mm == 0] = np.nan
    return depth_m


def pixels_of(what: str, message: ImageLike, channels: int, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    """Return (H, W) or (H, W, channels) pixels as they lie in the message; `what` names the image in a refusal.

    Raises
    ------
    ValueError
        When size, step or amount of data do not fit.
    """
    return _layout(what, message, channels, dtype).view(message)


def _color_layout(message: ImageLike) -> _Layout:
    known = _COLOR_TO_RGB.get(_encoding(message))
    if known is None:
        raise ValueError(_wrong_encoding("colour", message, COLOR_ENCODINGS))
    return _layout("colour", message, known[0], np.dtype(np.uint8))


def _depth_layout(message: ImageLike) -> _Layout:
    known = _DEPTH_TYPES.get(_encoding(message))
    if known is None:
        raise ValueError(_wrong_encoding("depth", message, DEPTH_ENCODINGS))
    return _layout("depth", message, 1, np.dtype((">" if message.is_bigendian else "<") + known))


def _encoding(message: ImageLike) -> str:
    return message.encoding if isinstance(message.encoding, str) else ""


def _wrong_encoding(what: str, message: ImageLike, allowed: tuple[str, ...]) -> str:
    cure = "; image_proc makes bgr8 of it" if _encoding(message).startswith(_OF_IMAGE_PROC) else ""
    return f"{what} image has encoding {clean_text(message.encoding)}; allowed are {', '.join(allowed)}{cure}"


def _layout(what: str, message: ImageLike, channels: int, dtype: np.dtype[np.generic]) -> _Layout:
    height, width, step = int(message.height), int(message.width), int(message.step)
    if not (0 < height <= MAX_SIDE_PX and 0 < width <= MAX_SIDE_PX):
        raise ValueError(f"{what} image is {width}x{height}; each side must be 1 to {MAX_SIDE_PX} pixels")
    row = width * channels * dtype.itemsize
    if step < row:
        raise ValueError(f"{what} image has step {step}; a row of {width} {message.encoding} pixels needs {row} bytes")
    size = memoryview(message.data).nbytes
    if size != step * height:
        raise ValueError(f"{what} image has {size} bytes; step {step} x height {height} is {step * height}")
    return _Layout(height, width, channels, dtype, step)


def check_unit(pixels: NDArray[np.generic], encoding: str) -> None:
    """Raise ValueError when most distances are beyond any depth camera: then the unit is another.

    `pixels` are mm for 16UC1 and mono16, metres for 32FC1.
    """
    probe = pixels[_PROBE_STEP // 2 :: _PROBE_STEP, _PROBE_STEP // 2 :: _PROBE_STEP].astype(np.float32)
    measured = probe[(probe > 0) & (probe < np.inf)]
    if measured.size == 0:
        return
    median = float(np.median(measured))
    if encoding == "32FC1" and median > _MAX_PLAUSIBLE_M:
        raise ValueError(
            f"median depth is {median:.0f} m; check the depth unit: "
            "32FC1 must be in metres (these look like millimetres)"
        )
    if encoding != "32FC1" and median < _MIN_PLAUSIBLE_MM:
        raise ValueError(
            f"median depth is {median:.0f} mm; check the depth unit: "
            f"{encoding} must be in millimetres (these look like metres)"
        )
