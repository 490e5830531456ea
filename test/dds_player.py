"""A camera in a process of its own: publishes the frames of `room_frames` as serialized messages, at a steady rate."""

from __future__ import annotations

import argparse
import time
from typing import Any

import rclpy
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rclpy.utilities import try_shutdown
from room_frames import CAMERA, FRAME_ID, room_images, stamp_ns

from msg_adapters.encode_image import encode_image
from msg_adapters.header import encode_header
from msg_adapters.messages import CameraInfo, Image


def camera_info(stamp: int) -> CameraInfo:
    """Return the CameraInfo of `room_frames.CAMERA`."""
    message = CameraInfo(header=encode_header(stamp, FRAME_ID), height=CAMERA.height, width=CAMERA.width)
    message.k = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0]
    message.p = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return message


def serialized(i: int) -> tuple[bytes, bytes, bytes]:
    """Return camera_info, colour and depth of frame `i`."""
    stamp, (color, depth_mm) = stamp_ns(i), room_images(i)
    parts = (camera_info(stamp), encode_image(color, stamp, FRAME_ID), encode_image(depth_mm, stamp, FRAME_ID))
    info, rgb, depth = (serialize_message(part) for part in parts)
    return info, rgb, depth


def main() -> None:
    """Wait for a subscriber of each topic, publish, tell how many."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=90)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--namespace", default="/")
    options = parser.parse_args()
    frames = [serialized(i) for i in range(options.frames)]
    rclpy.init()
    node = rclpy.create_node("player", namespace=options.namespace)
    kinds: dict[str, Any] = {
        "rgb/camera_info": CameraInfo, "rgb/image_rect_color": Image, "depth_registered/image_rect": Image,
    }  # fmt: skip
    publishers = [node.create_publisher(kind, topic, qos_profile_sensor_data) for topic, kind in kinds.items()]
    deadline = time.monotonic() + 60.0
    while any(p.get_subscription_count() == 0 for p in publishers) and time.monotonic() < deadline:
        time.sleep(0.02)
    time.sleep(0.5)  # both sides have to know each other
    print("playing", flush=True)
    start = time.perf_counter()
    for i, parts in enumerate(frames):
        for publisher, part in zip(publishers, parts, strict=True):
            publisher.publish(part)
        time.sleep(max(0.0, start + (i + 1) / options.rate - time.perf_counter()))
    print(f"sent {len(frames)}", flush=True)
    time.sleep(2.0)
    try_shutdown()


if __name__ == "__main__":
    main()
