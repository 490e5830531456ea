"""Frames as ROS messages in CDR and back, through rosbags: no ROS installation needed.

The decoder is as strict as msg_adapters' and gives the same bits (a test holds them together); it is its own
because data sets must not depend on the ROS side.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from room_layout_ros.core.frame import MAX_SIDE_PX
from room_layout_ros.extras import install_hint

from .calibration import CameraCalibration
from .errors import DataError
from .images import decode_image, depth_from_millimetres

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, POSE = "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/PoseStamped"
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"

_COLOR = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
}
_DEPTH = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_DEPTH_HEADER_BYTES = 12
"""compressedDepth puts its quantisation parameters before the PNG."""


def need_rosbags() -> None:
    """Raise a sentence that names the extra unless rosbags is installed."""
    try:
        import rosbags.rosbag2  # noqa: F401
    except ImportError:
        raise ModuleNotFoundError(f"bags need rosbags: {install_hint('playback')}", name="rosbags") from None


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Return the message types of Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _header(stamp_ns: int, frame_id: str) -> Any:
    types = typestore().types
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def encode_image_message(pixels: NDArray[Any], encoding: str, stamp_ns: int, frame_id: str) -> bytes:
    """Return the CDR of a sensor_msgs/Image; the rows are not padded."""
    height, width = pixels.shape[:2]
    content = np.ascontiguousarray(pixels).view(np.uint8).reshape(-1)
    message = typestore().types[IMAGE](
        header=_header(stamp_ns, frame_id), height=height, width=width, encoding=encoding, is_bigendian=0,
        step=content.size // height, data=content,
    )  # fmt: skip
    return bytes(typestore().serialize_cdr(message, IMAGE))


def encode_grid(
    cells: NDArray[np.int8], resolution_m: float, origin_m: tuple[float, float], stamp_ns: int, frame_id: str
) -> bytes:
    """Return the CDR of a nav_msgs/OccupancyGrid; row i of the (rows, cols) cells lies along y, column j along x."""
    types, header = typestore().types, _header(stamp_ns, frame_id)
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=origin_m[0], y=origin_m[1], z=0.0),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    info = types["nav_msgs/msg/MapMetaData"](
        map_load_time=header.stamp, resolution=resolution_m, width=cells.shape[1], height=cells.shape[0], origin=pose
    )
    data = np.ascontiguousarray(cells, np.int8).reshape(-1)
    message = types[OCCUPANCY_GRID](header=header, info=info, data=data)
    return bytes(typestore().serialize_cdr(message, OCCUPANCY_GRID))


def encode_camera_info(calibration: CameraCalibration, stamp_ns: int, frame_id: str) -> bytes:
    """Return the CDR of a sensor_msgs/CameraInfo."""
    types, c = typestore().types, calibration
    roi = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    message = types[CAMERA_INFO](
        header=_header(stamp_ns, frame_id), height=c.height, width=c.width, distortion_model=c.distortion_model,
        d=np.array(c.D, np.float64), k=np.array(c.K), r=np.array(c.R), p=np.array(c.P), binning_x=0, binning_y=0,
        roi=roi,
    )  # fmt: skip
    return bytes(typestore().serialize_cdr(message, CAMERA_INFO))


def encode_pose(T_world_camera: NDArray[np.float64], stamp_ns: int, frame_id: str = "map") -> bytes:
    """Return the CDR of a geometry_msgs/PoseStamped."""
    types = typestore().types
    x, y, z = (float(v) for v in T_world_camera[:3, 3])
    qx, qy, qz, qw = (float(v) for v in Rotation.from_matrix(T_world_camera[:3, :3]).as_quat())
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
    message = types[POSE](header=_header(stamp_ns, frame_id), pose=pose)
    return bytes(typestore().serialize_cdr(message, POSE))


def decode(raw: bytes, kind: str) -> Any:
    """Return the message object of a CDR.

    Raises
    ------
    DataError
        When the bytes are no such message.
    """
    try:
        return typestore().deserialize_cdr(raw, kind)
    except Exception as error:  # noqa: BLE001 - rosbags raises whatever broken bytes lead to: struct, index, unicode
        raise DataError(f"a {kind} message is damaged: {type(error).__name__}") from None


def stamp_of(message: Any) -> int:
    """Return the header stamp in nanoseconds."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def decode_color(message: Any) -> NDArray[np.uint8]:
    """Return (H, W, 3) uint8 RGB of an Image or CompressedImage.

    Raises
    ------
    DataError
        When encoding, size, step or amount of data do not fit.
    """
    if message.__msgtype__ == COMPRESSED:
        image = decode_image(message.data.tobytes(), "compressed colour image")
        if image.dtype != np.uint8:
            raise DataError(f"compressed colour image has {image.dtype} pixels; uint8 is needed")
        pixels = image.astype(np.uint8, copy=False)
        return np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else pixels
    if message.encoding not in _COLOR:
        raise DataError(f"colour image has encoding {message.encoding[:40]!r}; allowed are {', '.join(_COLOR)}")
    channels, conversion = _COLOR[message.encoding]
    pixels = np.ascontiguousarray(_pixels("colour", message, channels, np.dtype(np.uint8)))
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion), dtype=np.uint8)


def decode_depth(message: Any) -> NDArray[np.float32]:
    """Return (H, W) float32 metres, NaN = not measured, of an Image or a PNG compressedDepth.

    Raises
    ------
    DataError
        When encoding, size, step or amount of data do not fit.
    """
    if message.__msgtype__ == COMPRESSED:
        return _compressed_depth(message)
    if message.encoding not in _DEPTH:
        raise DataError(f"depth image has encoding {message.encoding[:40]!r}; allowed are {', '.join(_DEPTH)}")
    dtype = np.dtype((">" if message.is_bigendian else "<") + _DEPTH[message.encoding])
    pixels = _pixels("depth", message, 1, dtype)
    if dtype.kind == "u":
        return depth_from_millimetres(pixels.astype(np.uint16))
    depth_m = pixels.astype(np.float32)
    depth_m[~((depth_m > 0) & (depth_m < np.inf))] = np.nan
    return depth_m


def _compressed_depth(message: Any) -> NDArray[np.float32]:
    if not message.format.startswith("16UC1"):
        raise DataError(f"compressed depth has format {message.format[:40]!r}; 16UC1 as PNG is needed")
    content = message.data.tobytes()
    start = 0 if content.startswith(b"\x89PNG") else _DEPTH_HEADER_BYTES
    image = decode_image(content[start:], "compressed depth image")
    if image.ndim != 2 or image.dtype != np.uint16:
        raise DataError(f"compressed depth image has shape {image.shape} of {image.dtype}; uint16 is needed")
    return depth_from_millimetres(image.astype(np.uint16, copy=False))


def decode_index(message: Any, highest: int) -> NDArray[np.uint8]:
    """Return (H, W) uint8 ids of a mono8 image."""
    if message.encoding != "mono8":
        raise DataError(f"label image has encoding {message.encoding[:40]!r}; mono8 is needed")
    pixels = np.ascontiguousarray(_pixels("label", message, 1, np.dtype(np.uint8)))
    if int(pixels.max(initial=0)) > highest:
        raise DataError(f"label image holds the id {int(pixels.max())}; allowed are 0 to {highest}")
    return pixels


def _pixels(what: str, message: Any, channels: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    height, width, step = int(message.height), int(message.width), int(message.step)
    if not (0 < height <= MAX_SIDE_PX and 0 < width <= MAX_SIDE_PX):
        raise DataError(f"{what} image is {width}x{height}; each side must be 1 to {MAX_SIDE_PX} pixels")
    row = width * channels * dtype.itemsize
    if step < row or message.data.size != step * height:
        raise DataError(
            f"{what} image has {message.data.size} bytes in rows of {step}; {height} rows of at least {row} are needed"
        )
    rows = message.data.reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(dtype).reshape(height, width, channels)
    return pixels if channels > 1 else pixels[..., 0]


def decode_calibration(message: Any) -> CameraCalibration:
    """Return the calibration of a CameraInfo; region of interest and binning are applied.

    Raises
    ------
    DataError
        When it is uncalibrated.
    """
    K, P = [float(v) for v in message.k], [float(v) for v in message.p]
    roi = message.roi
    cut = bool(roi.width or roi.height)
    bx, by = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    x0, y0 = (int(roi.x_offset), int(roi.y_offset)) if cut else (0, 0)
    width = (int(roi.width) or int(message.width)) // bx
    height = (int(roi.height) or int(message.height)) // by
    if cut or bx > 1 or by > 1:
        for values, fx, fy, cx, cy in ((K, 0, 4, 2, 5), (P, 0, 5, 2, 6)):
            if values[fx]:
                values[fx], values[fy] = values[fx] / bx, values[fy] / by
                values[cx] = (values[cx] - x0 + 0.5) / bx - 0.5
                values[cy] = (values[cy] - y0 + 0.5) / by - 0.5
    D, R = tuple(float(v) for v in message.d), tuple(float(v) for v in message.r)
    return CameraCalibration(
        width, height, tuple(K), D, R, tuple(P), str(message.distortion_model), str(message.header.frame_id)
    )


def decode_pose(message: Any) -> NDArray[np.float64]:
    """Return the (4, 4) pose of a PoseStamped."""
    p, q = message.pose.position, message.pose.orientation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    pose[:3, 3] = p.x, p.y, p.z
    return pose
