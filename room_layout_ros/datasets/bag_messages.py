"""Frames as ROS messages in CDR and back, through rosbags: no ROS installation needed.

Decoding is `room_layout_ros.decoding`, which the live node uses too: a bag is refused for what the node refuses.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from room_layout_ros.decoding import image
from room_layout_ros.decoding.camera_info import decode_camera_info
from room_layout_ros.decoding.compressed import bytes_before_depth, decode_compressed_color, decode_compressed_depth
from room_layout_ros.decoding.text import clean_text
from room_layout_ros.extras import install_hint

from .calibration import CameraCalibration
from .errors import DataError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, POSE = "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/PoseStamped"
OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"

T = TypeVar("T")


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
    """Return the CDR of a sensor_msgs/CameraInfo.

    Raises
    ------
    DataError
        When the lens distorts and no P says where the rectified image's rays go: nobody would read it.
    """
    types, c = typestore().types, calibration
    if c.is_distorted and not (c.P[0] or c.P[5]):
        raise DataError(
            "the camera has distortion and no projection_matrix, which a camera_info needs then; "
            "if the images are rectified, add it to the calibration file"
        )
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
        See `decoding.image.decode_color` and `decoding.compressed.decode_compressed_color`.
    """
    return _read(decode_compressed_color if message.__msgtype__ == COMPRESSED else image.decode_color, message)


def decode_depth(message: Any) -> NDArray[np.float32]:
    """Return (H, W) float32 metres, NaN = not measured, of an Image or a compressedDepth.

    Raises
    ------
    DataError
        See `decoding.image.decode_depth` and `decoding.compressed.decode_compressed_depth`.
    """
    return _read(decode_compressed_depth if message.__msgtype__ == COMPRESSED else image.decode_depth, message)


def check_depth_format(message: Any) -> None:
    """Raise DataError where the format of compressed depth says that it cannot be read."""
    _read(bytes_before_depth, message)


def decode_index(message: Any, highest: int) -> NDArray[np.uint8]:
    """Return (H, W) uint8 ids of a mono8 image."""
    if message.encoding != "mono8":
        raise DataError(f"label image has encoding {clean_text(message.encoding)}; mono8 is needed")
    pixels = _read(lambda m: np.ascontiguousarray(image.pixels_of("label", m, 1, np.dtype(np.uint8))), message)
    if int(pixels.max(initial=0)) > highest:
        raise DataError(f"label image holds the id {int(pixels.max())}; allowed are 0 to {highest}")
    return pixels.astype(np.uint8, copy=False)


def decode_calibration(message: Any) -> CameraCalibration:
    """Return the calibration of a CameraInfo; region of interest and binning are applied.

    Raises
    ------
    DataError
        See `decoding.camera_info.decode_camera_info`.
    """
    reading = _read(decode_camera_info, message)
    camera = reading.camera
    K, P = [float(v) for v in message.k], [float(v) for v in message.p]
    if P[0] == 0 and P[5] == 0:
        P = [0.0] * 12  # K stands in for it
    bx, by = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    cut = bool(message.roi.width or message.roi.height)
    x0, y0 = (int(message.roi.x_offset), int(message.roi.y_offset)) if cut else (0, 0)
    if cut or bx > 1 or by > 1:
        for values, fx, fy, cx, cy in ((K, 0, 4, 2, 5), (P, 0, 5, 2, 6)):
            if values[fx]:
                values[fx], values[fy] = values[fx] / bx, values[fy] / by
                values[cx] = (values[cx] - x0 + 0.5) / bx - 0.5
                values[cy] = (values[cy] - y0 + 0.5) / by - 0.5
    D, R = tuple(float(v) for v in message.d), tuple(float(v) for v in message.r)
    model, name = str(message.distortion_model), str(message.header.frame_id)
    return CameraCalibration(camera.width, camera.height, tuple(K), D, R, tuple(P), model, name, reading.warning)


def _read(decoder: Callable[[Any], T], message: Any) -> T:
    try:
        return decoder(message)
    except ValueError as error:
        raise DataError(str(error)) from None


def decode_pose(message: Any) -> NDArray[np.float64]:
    """Return the (4, 4) pose of a PoseStamped."""
    p, q = message.pose.position, message.pose.orientation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    pose[:3, 3] = p.x, p.y, p.z
    return pose
