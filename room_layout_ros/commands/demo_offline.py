"""The demo without ROS: the same bag through the same estimator, results written as the same topics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from room_layout_ros.commands.camera_pose import UPRIGHT, CameraPose
from room_layout_ros.commands.depth_doubts import DepthDoubts
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.picture import draw_overlay
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.datasets import FrameSource, good_samples
from room_layout_ros.datasets.bag_messages import (
    IMAGE,
    OCCUPANCY_GRID,
    encode_grid,
    encode_image_message,
    typestore,
)
from room_layout_ros.runtime.depth_scale import measure_scale

NODE = "/estimator"
MARKERS = "visualization_msgs/msg/MarkerArray"
_LINE_STRIP = 4


def run_offline(
    source: FrameSource,
    out: Path,
    progress: Callable[[int], object],
    doubts: DepthDoubts,
    pose: CameraPose = UPRIGHT,
) -> tuple[Path, Counter[str]]:
    """Estimate every frame in order, with warm starts as the node has them, and write an MCAP.

    Parameters
    ----------
    source : FrameSource
    out : Path
        Folder of the recording; must not exist.
    progress : callable
        Called with the number of frames so far.
    doubts : DepthDoubts
        Gets the scale of each room.
    pose : CameraPose
        How the camera of all frames hangs.

    Returns
    -------
    Path
        The .mcap file.
    Counter
        Frames without a room, by the reason.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    estimator, prior = LayoutEstimator(EstimatorConfig()), TemporalPrior()
    connections: dict[str, Any] = {}
    no_room: Counter[str] = Counter()
    with Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for count, sample in enumerate(good_samples(source), 1):
            estimate = pose.estimate(estimator, sample.frame, prior)
            prior = next_prior(estimate)
            doubts.weigh(measure_scale(sample.frame, estimate))
            if estimate.cuboid is None:
                no_room[estimate.status.value] += 1
            for topic, kind, raw in _messages(sample.frame, estimate, estimator.config):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=typestore())
                writer.write(connections[topic], sample.frame.stamp_ns, raw)
            progress(count)
    return next(out.glob("*.mcap")), no_room


def _messages(frame: RgbdFrame, estimate: RoomEstimate, config: EstimatorConfig) -> list[tuple[str, str, bytes]]:
    stamp_ns, frame_id = frame.stamp_ns, frame.frame_id or "camera"
    images = {
        "overlay": (draw_overlay(frame, estimate), "rgb8"),
        "labels": (estimate.labels, "mono8"),
        "layout": (estimate.layout, "mono8"),
        "furniture": (estimate.furniture, "mono8"),
    }
    messages = [
        (f"{NODE}/{name}", IMAGE, encode_image_message(pixels, encoding, stamp_ns, frame_id))
        for name, (pixels, encoding) in images.items()
    ]
    messages.append((f"{NODE}/markers", MARKERS, _markers(estimate, stamp_ns, frame_id)))
    space = free_space_of_frame(frame, estimate, config)
    if space is not None:
        raw = encode_grid(space.grid, space.resolution_m, space.origin_m, stamp_ns, f"{frame_id}_floor")
        messages.append((f"{NODE}/free_space", OCCUPANCY_GRID, raw))
    return messages


def _markers(estimate: RoomEstimate, stamp_ns: int, frame_id: str) -> bytes:
    """Return the outlines of the faces as a MarkerArray in CDR."""
    types = typestore().types
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    point, color = types["geometry_msgs/msg/Point"], types["std_msgs/msg/ColorRGBA"]
    markers = []
    for polygon in estimate.polygons:
        red, green, blue = (float(c) / 255 for c in LABEL_COLORS[polygon.face])
        closed = np.vstack([polygon.points_m, polygon.points_m[:1]])
        marker = types["visualization_msgs/msg/Marker"](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id),
            ns="edges",
            id=int(polygon.face),
            type=_LINE_STRIP,
            action=0,
            pose=types["geometry_msgs/msg/Pose"](
                position=point(x=0.0, y=0.0, z=0.0),
                orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
            ),
            scale=types["geometry_msgs/msg/Vector3"](x=0.03, y=0.0, z=0.0),
            color=color(r=red, g=green, b=blue, a=1.0),
            lifetime=types["builtin_interfaces/msg/Duration"](sec=0, nanosec=500_000_000),
            frame_locked=False,
            points=[point(x=float(x), y=float(y), z=float(z)) for x, y, z in closed],
            colors=[],
            texture_resource="",
            texture=types["sensor_msgs/msg/CompressedImage"](
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""), format="", data=np.empty(0, np.uint8)
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=types["visualization_msgs/msg/MeshFile"](filename="", data=np.empty(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )
        markers.append(marker)
    return bytes(typestore().serialize_cdr(types[MARKERS](markers=markers), MARKERS))
