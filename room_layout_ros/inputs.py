"""What the node listens to: serialized messages -> checked messages -> RgbdFrame."""

from __future__ import annotations

from msg_adapters import cdr
from msg_adapters.camera_info import CameraReading, check_size, decode_camera_info
from msg_adapters.image import check_color, check_depth, decode_color, decode_depth
from msg_adapters.protocols import ImageLike
from msg_adapters.stamp import decode_stamp
from msg_adapters.text import clean_text

from .core.frame import RgbdFrame
from .runtime.pairing import COLOR, DEPTH, Pair
from .runtime.session import CAMERA, RefusedError

INPUT_TOPICS = {COLOR: "rgb/image_rect_color", DEPTH: "depth_registered/image_rect", CAMERA: "rgb/camera_info"}


def read_image(stream: str, serialized: bytes) -> tuple[int, cdr.WireImage]:
    """Return stamp and message of an image, checked without a look at its pixels.

    Raises
    ------
    RefusedError
        With the reason it is counted under: not decodable, bad stamp, bad image.
    """
    try:
        message = cdr.read_image(serialized)
    except ValueError as error:
        raise RefusedError("not decodable", f"{stream}: {error}") from error
    try:
        stamp_ns = decode_stamp(message.header.stamp)
    except ValueError as error:
        raise RefusedError("bad stamp", f"{stream}: {error}") from error
    try:
        (check_color if stream == COLOR else check_depth)(message)
    except ValueError as error:
        raise RefusedError("bad image", str(error)) from error
    return stamp_ns, message


def read_camera(serialized: bytes) -> tuple[int, CameraReading]:
    """Return stamp (0 where it has none) and camera. Raises RefusedError: not decodable, uncalibrated."""
    try:
        message = cdr.read_camera_info(serialized)
    except ValueError as error:
        raise RefusedError("not decodable", f"camera_info: {error}") from error
    try:
        reading = decode_camera_info(message)
    except ValueError as error:
        raise RefusedError("uncalibrated", str(error)) from error
    try:
        return decode_stamp(message.header.stamp), reading
    except ValueError:
        return 0, reading  # drivers that latch it leave the stamp empty


def assemble(pair: Pair[ImageLike], reading: CameraReading) -> RgbdFrame:
    """Return the frame of a pair.

    Raises
    ------
    RefusedError
        not registered (sizes or frames of colour and depth differ), camera_info does not fit, bad depth unit.
    """
    color, depth = pair.color, pair.depth
    if color is not None and depth is not None:
        _check_registered(color, depth)
    lead = depth if depth is not None else color
    if lead is None:
        raise ValueError("pair has neither colour nor depth")
    try:
        check_size(reading.camera, "depth" if depth is not None else "colour", lead.height, lead.width)
    except ValueError as error:
        raise RefusedError("camera_info does not fit", str(error)) from error
    color_rgb = None if color is None else decode_color(color)
    try:
        depth_m = None if depth is None else decode_depth(depth)
    except ValueError as error:
        raise RefusedError("depth unit", str(error)) from error
    return RgbdFrame(reading.camera, color_rgb, depth_m, pair.stamp_ns, lead.header.frame_id)


def _check_registered(color: ImageLike, depth: ImageLike) -> None:
    if (color.height, color.width) != (depth.height, depth.width):
        raise RefusedError(
            "not registered",
            f"colour image is {color.width}x{color.height} and depth image {depth.width}x{depth.height}; "
            "depth is not registered to colour (use the driver's aligned depth topic)",
        )
    frames = color.header.frame_id, depth.header.frame_id
    if frames[0] != frames[1] and all(frames):
        raise RefusedError(
            "not registered",
            f"colour is in frame {clean_text(frames[0])} and depth in frame {clean_text(frames[1])}; "
            "depth is not registered to colour (use the driver's aligned depth topic)",
        )
