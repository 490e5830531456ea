"""What the node listens to: serialized messages -> checked messages -> RgbdFrame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_adapters import cdr
from msg_adapters.camera_info import CameraReading, check_size, decode_camera_info
from msg_adapters.compressed import (
    check_compressed_color,
    check_compressed_depth,
    decode_compressed_color,
    decode_compressed_depth,
)
from msg_adapters.image import check_color, check_depth, decode_color, decode_depth
from msg_adapters.stamp import decode_stamp
from msg_adapters.text import clean_text

from .core.config import EstimatorConfig
from .core.frame import RgbdFrame
from .core.registration import register_depth
from .node_config import FindTransform, NodeConfig, parse_pose
from .runtime.pairing import COLOR, DEPTH, Pair
from .runtime.session import CAMERA, DEPTH_CAMERA, RefusedError

INPUT_TOPICS = {
    COLOR: "rgb/image_rect_color",
    DEPTH: "depth_registered/image_rect",
    CAMERA: "rgb/camera_info",
    DEPTH_CAMERA: "depth/camera_info",
}
IMU_TOPIC = "imu"
TRANSPORTS = {COLOR: ("raw", "compressed"), DEPTH: ("raw", "compressedDepth", "compressed")}
"""Transports that a stream may come by; the others come raw."""
_ALIGNED = "use the driver's aligned depth topic, or depth_registered: false"


@dataclass(frozen=True, slots=True)
class ImageItem:
    """A checked image message of either transport, not decoded yet."""

    message: cdr.WireImage | cdr.WireCompressedImage
    height: int
    width: int

    @property
    def frame_id(self) -> str:
        """Optical frame of the image."""
        return self.message.header.frame_id


def used_inputs(node: NodeConfig, estimator: EstimatorConfig) -> dict[str, bool]:
    """Return which streams the settings need."""
    return {
        COLOR: estimator.use_color,
        DEPTH: estimator.use_depth,
        CAMERA: not node.camera_file and (estimator.use_color or node.depth_registered),
        DEPTH_CAMERA: not node.depth_camera_file and estimator.use_depth and not node.depth_registered,
    }


def transport_of(stream: str, node: NodeConfig) -> str:
    """Return the transport of a stream: raw, compressed or compressedDepth; it is the end of the topic's name."""
    return {COLOR: node.color_transport, DEPTH: node.depth_transport}.get(stream, "raw")


def read_image(stream: str, serialized: bytes, compressed: bool = False) -> tuple[int, ImageItem]:
    """Return stamp and message of an image, checked without a look at its pixels.

    Raises
    ------
    RefusedError
        With the reason it is counted under: not decodable, bad stamp, bad image.
    """
    try:
        message = cdr.read_compressed_image(serialized) if compressed else cdr.read_image(serialized)
    except ValueError as error:
        raise RefusedError("not decodable", f"{stream}: {error}") from error
    try:
        stamp_ns = decode_stamp(message.header.stamp)
    except ValueError as error:
        raise RefusedError("bad stamp", f"{stream}: {error}") from error
    try:
        if isinstance(message, cdr.WireCompressedImage):
            size = (check_compressed_color if stream == COLOR else check_compressed_depth)(message)
        else:
            (check_color if stream == COLOR else check_depth)(message)
            size = message.height, message.width
    except ValueError as error:
        raise RefusedError("bad image", str(error)) from error
    return stamp_ns, ImageItem(message, *size)


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


def assemble(
    pair: Pair[ImageItem], cameras: Mapping[str, CameraReading | None], node: NodeConfig, find: FindTransform
) -> RgbdFrame:
    """Return the frame of a pair.

    Its stamp is the depth image's, and so is its frame id, except where depth is registered here: then the
    frame is the colour camera's, because the result lies there. Depth alone that is not registered is in the view
    of the depth camera, and needs nothing of the colour camera.

    Raises
    ------
    RefusedError
        not registered (sizes or frames of colour and depth differ), camera_info does not fit, bad depth unit,
        no camera_info, no transform.
    """
    color, depth = pair.color, pair.depth
    of_depth = color is None and not node.depth_registered
    reading = cameras[DEPTH_CAMERA if of_depth else CAMERA]
    if reading is None:
        raise _no_camera_info(" of the depth camera" if of_depth else "")
    if color is not None and depth is not None and not node.depth_registered:
        return _registered_here(pair.stamp_ns, color, depth, cameras, node, find)
    if color is not None and depth is not None:
        _check_registered(color, depth)
    lead = depth if depth is not None else color
    if lead is None:
        raise ValueError("pair has neither colour nor depth")
    _check_camera(reading, "depth" if depth is not None else "colour", lead)
    color_rgb = None if color is None else _decode_color(color)
    depth_m = None if depth is None else _decode_depth(depth)
    return RgbdFrame(reading.camera, color_rgb, depth_m, pair.stamp_ns, lead.frame_id)


def foreign_cameras(
    pair: Pair[ImageItem], cameras: Mapping[str, CameraReading | None], node: NodeConfig
) -> dict[str, str]:
    """Return a sentence, by stream, for each camera_info that lies in another frame than the image it is used with.

    It may be that of another camera of the same size. Drivers are known that name both frames of one camera otherwise,
    so the frame is worked all the same.
    """
    color, depth = pair.color, pair.depth
    of_color = depth if color is None and node.depth_registered else color
    found = {}
    for stream, image in ((CAMERA, of_color), (DEPTH_CAMERA, None if node.depth_registered else depth)):
        reading = cameras[stream]
        if image is None or reading is None or reading.frame_id == image.frame_id:
            continue
        if reading.frame_id and image.frame_id:
            found[stream] = (
                f"camera_info is in frame {clean_text(reading.frame_id)} and its images in frame "
                f"{clean_text(image.frame_id)}; is it that of another camera?"
            )
    return found


def _no_camera_info(whose: str) -> RefusedError:
    return RefusedError("no camera_info", f"no camera_info{whose} has come yet; images cannot be used without it")


def _check_registered(color: ImageItem, depth: ImageItem) -> None:
    if (color.height, color.width) != (depth.height, depth.width):
        raise RefusedError(
            "not registered",
            f"colour image is {color.width}x{color.height} and depth image {depth.width}x{depth.height}; "
            f"depth is not registered to colour ({_ALIGNED})",
        )
    if color.frame_id != depth.frame_id and color.frame_id and depth.frame_id:
        raise RefusedError(
            "not registered",
            f"colour is in frame {clean_text(color.frame_id)} and depth in frame {clean_text(depth.frame_id)}; "
            f"depth is not registered to colour ({_ALIGNED})",
        )


def _check_camera(reading: CameraReading, what: str, image: ImageItem) -> None:
    try:
        check_size(reading.camera, what, image.height, image.width)
    except ValueError as error:
        raise RefusedError("camera_info does not fit", str(error)) from error


def _registered_here(
    stamp_ns: int,
    color: ImageItem,
    depth: ImageItem,
    cameras: Mapping[str, CameraReading | None],
    node: NodeConfig,
    find: FindTransform,
) -> RgbdFrame:
    reading, depth_reading = cameras[CAMERA], cameras[DEPTH_CAMERA]
    if reading is None or depth_reading is None:
        raise RefusedError(
            "no camera_info", "no camera_info of the depth camera has come yet; it is needed to register depth"
        )
    _check_camera(reading, "colour", color)
    _check_camera(depth_reading, "depth", depth)
    if node.depth_to_color:
        T_color_depth: NDArray[np.float64] | None = parse_pose(node.depth_to_color)
    elif color.frame_id and color.frame_id == depth.frame_id:
        T_color_depth = np.eye(4)
    else:
        T_color_depth = find(color.frame_id, depth.frame_id, stamp_ns)
    if T_color_depth is None:
        raise RefusedError(
            "no transform",
            f"no transform from depth frame {clean_text(depth.frame_id)} to colour frame {clean_text(color.frame_id)}; "
            "give parameter depth_to_color, or publish it on /tf_static (tf2 must be installed)",
        )
    depth_m = register_depth(_decode_depth(depth), depth_reading.camera, reading.camera, T_color_depth)
    return RgbdFrame(reading.camera, _decode_color(color), depth_m, stamp_ns, color.frame_id)


def _decode_color(item: ImageItem) -> NDArray[np.uint8]:
    if isinstance(item.message, cdr.WireCompressedImage):
        return decode_compressed_color(item.message)
    return decode_color(item.message)


def _decode_depth(item: ImageItem) -> NDArray[np.float32]:
    try:
        if isinstance(item.message, cdr.WireCompressedImage):
            return decode_compressed_depth(item.message)
        return decode_depth(item.message)
    except ValueError as error:
        raise RefusedError("bad depth", str(error)) from error
