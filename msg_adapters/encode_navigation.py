"""Free space -> what navigation takes: occupancy grid, point clouds, laser scan, outline, pose of the floor."""

from __future__ import annotations

import array

import numpy as np
from numpy.typing import NDArray

from .encode_image import pack_bytes
from .header import encode_header
from .messages import (
    LaserScan,
    OccupancyGrid,
    Point32,
    PointCloud2,
    PointField,
    PolygonStamped,
    PoseStamped,
    Quaternion,
    TransformStamped,
)

_XYZ = tuple(zip("xyz", (0, 4, 8), strict=True))


def encode_grid(
    grid: NDArray[np.int8], resolution_m: float, origin_m: tuple[float, float], stamp_ns: int, frame_id: str
) -> OccupancyGrid:
    """Return (rows, cols) int8 of -1, 0..100 as a grid; row i lies along y, column j along x of `frame_id`."""
    message = OccupancyGrid(header=encode_header(stamp_ns, frame_id))
    message.info.map_load_time = message.header.stamp
    message.info.resolution = resolution_m
    message.info.height, message.info.width = grid.shape
    message.info.origin.position.x, message.info.origin.position.y = origin_m
    message.info.origin.orientation.w = 1.0
    cells = array.array("b")
    cells.frombytes(np.ascontiguousarray(grid, dtype=np.int8).tobytes())
    message.data = cells
    return message


def encode_cloud(points_m: NDArray[np.float32], stamp_ns: int, frame_id: str) -> PointCloud2:
    """Return (n, 3) points as an unordered cloud of x, y, z in float32."""
    points_m = np.ascontiguousarray(points_m, dtype="<f4")
    message = PointCloud2(header=encode_header(stamp_ns, frame_id))
    message.height, message.width = 1, len(points_m)
    message.fields = [PointField(name=n, offset=o, datatype=PointField.FLOAT32, count=1) for n, o in _XYZ]
    message.point_step, message.row_step = 12, 12 * len(points_m)
    message.is_bigendian, message.is_dense = False, True
    message.data = pack_bytes(points_m)
    return message


def encode_scan(
    ranges_m: NDArray[np.float32],
    angle_min: float,
    angle_increment: float,
    range_max_m: float,
    stamp_ns: int,
    frame_id: str,
) -> LaserScan:
    """Return a scan in the plane of `frame_id`: +inf is seen free, NaN not known (REP-117)."""
    message = LaserScan(header=encode_header(stamp_ns, frame_id))
    message.angle_min, message.angle_increment = angle_min, angle_increment
    message.angle_max = angle_min + angle_increment * (len(ranges_m) - 1)
    message.range_min, message.range_max = 0.0, range_max_m
    ranges = array.array("f")
    ranges.frombytes(np.ascontiguousarray(ranges_m, dtype=np.float32).tobytes())
    message.ranges = ranges
    return message


def encode_outline(corners_m: NDArray[np.float64], stamp_ns: int, frame_id: str) -> PolygonStamped:
    """Return (n, 2) corners on the floor of `frame_id`."""
    message = PolygonStamped(header=encode_header(stamp_ns, frame_id))
    message.polygon.points = [Point32(x=x, y=y, z=0.0) for x, y in corners_m.tolist()]
    return message


def encode_pose(T_frame_child: NDArray[np.float64], stamp_ns: int, frame_id: str) -> PoseStamped:
    """Return a (4, 4) rigid transform as the pose of its source frame in `frame_id`."""
    message = PoseStamped(header=encode_header(stamp_ns, frame_id))
    position = message.pose.position
    position.x, position.y, position.z = (float(v) for v in T_frame_child[:3, 3])
    message.pose.orientation = encode_rotation(T_frame_child[:3, :3])
    return message


def encode_transform(
    T_frame_child: NDArray[np.float64], stamp_ns: int, frame_id: str, child_frame_id: str
) -> TransformStamped:
    """Return a (4, 4) rigid transform as TF sends it."""
    message = TransformStamped(header=encode_header(stamp_ns, frame_id), child_frame_id=child_frame_id)
    translation = message.transform.translation
    translation.x, translation.y, translation.z = (float(v) for v in T_frame_child[:3, 3])
    message.transform.rotation = encode_rotation(T_frame_child[:3, :3])
    return message


def encode_rotation(R: NDArray[np.float64]) -> Quaternion:
    """Return a (3, 3) rotation as a quaternion with w >= 0 (eigenvector of Bar-Itzhack's matrix: never singular)."""
    (a, b, c), (d, e, f), (g, h, i) = R
    K = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = np.linalg.eigh(K)[1][:, -1]
    sign = -1.0 if w < 0 else 1.0
    return Quaternion(x=float(sign * x), y=float(sign * y), z=float(sign * z), w=float(sign * w))
