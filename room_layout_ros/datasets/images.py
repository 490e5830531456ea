"""Image files, strictly: no half-decoded picture passes, none is left half-written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.decoding.image import depth_from_mm

from .errors import DataError

MAX_FILE_BYTES = 256 * 1024 * 1024
_ENDS = {b"\xff\xd8": b"\xff\xd9", b"\x89PNG": b"IEND\xaeB\x60\x82"}


def decode_image(content: bytes, where: str) -> NDArray[np.generic]:
    """Decode a PNG or JPEG to (H, W) or (H, W, 3) RGB with the depth of the file.

    Raises
    ------
    DataError
        When it is neither, is cut or does not decode. (OpenCV fills the rest of a cut picture with grey.)
    """
    end = next((end for start, end in _ENDS.items() if content.startswith(start)), None)
    if end is None:
        raise DataError(f"{where} is neither PNG nor JPEG")
    if not content.rstrip(b"\0").endswith(end):
        raise DataError(f"{where} is cut: the end of the picture is missing")
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise DataError(f"{where} is damaged and does not decode")
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB)
    return image


def read_image(path: Path) -> NDArray[np.generic]:
    """Read and decode an image file; see `decode_image`."""
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise DataError(f"{path} is {size} bytes; at most {MAX_FILE_BYTES} are read")
        return decode_image(path.read_bytes(), str(path))
    except FileNotFoundError:
        raise DataError(f"{path} is missing") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}") from None


def read_color(path: Path) -> NDArray[np.uint8]:
    """Read a colour image as (H, W, 3) uint8 RGB; grey pictures are repeated into three channels."""
    image = read_image(path)
    if image.dtype != np.uint8:
        raise DataError(f"{path} has {image.dtype} pixels; a colour image must have uint8")
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    return image.astype(np.uint8, copy=False)


def read_index(path: Path, highest: int) -> NDArray[np.uint8]:
    """Read an id image as (H, W) uint8 with values 0..highest."""
    image = read_image(path)
    if image.ndim != 2 or image.dtype != np.uint8:
        raise DataError(f"{path} has shape {image.shape} of {image.dtype}; one channel of uint8 is needed")
    if int(image.max(initial=0)) > highest:
        raise DataError(f"{path} holds the id {int(image.max())}; allowed are 0 to {highest}")
    return image.astype(np.uint8, copy=False)


def read_depth(path: Path) -> NDArray[np.float32]:
    """Read a depth image in millimetres (uint16, 0 = not measured) as (H, W) float32 metres, NaN = not measured."""
    image = read_image(path)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise DataError(f"{path} has shape {image.shape} of {image.dtype}; one channel of uint16 millimetres is needed")
    return depth_from_mm(image)


def depth_to_millimetres(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return whole millimetres, 0 where not measured or beyond 65.535 m."""
    with np.errstate(invalid="ignore"):
        millimetres = np.rint(depth_m.astype(np.float64) * 1000.0)
        return np.where((millimetres >= 1) & (millimetres <= 65535), millimetres, 0).astype(np.uint16)


def encode_image(suffix: str, image: NDArray[np.uint8] | NDArray[np.uint16], jpeg_quality: int = 92) -> bytes:
    """Return RGB or one-channel pixels as the bytes of a ".png" or ".jpg" file."""
    pixels: NDArray[Any] = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else np.ascontiguousarray(image)
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    done, content = cv2.imencode(suffix, pixels, options)
    if not done:
        raise DataError(f"{image.dtype} pixels of shape {image.shape} cannot be written as {suffix}")
    return content.tobytes()


def write_image(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16], jpeg_quality: int = 92) -> None:
    """Write an image by its suffix; the file appears whole or not at all."""
    write_atomically(path, encode_image(path.suffix, image, jpeg_quality))


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that appears whole or not at all."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise DataError(f"{path} cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)  # an interrupt, too, leaves nothing behind
