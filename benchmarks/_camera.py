"""A camera in a process of its own: real frames at 30 Hz, stamped with the time at which they are published.

    python -m benchmarks._camera --seconds 20 --namespace /bench [--frames FOLDER | --hd]

It waits for its subscribers, and prints {"sent": frames} at the end.
"""

from __future__ import annotations

import argparse
import itertools
import json
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import qos_profile_sensor_data
from rclpy.utilities import try_shutdown

from benchmarks._frames import HD
from msg_adapters import messages
from msg_adapters.stamp import NS_PER_S
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.datasets import FrameSource, open_folder
from room_layout_ros.datasets.bag_topics import COLOR_INFO_TOPIC, COLOR_TOPIC, DEPTH_TOPIC
from room_layout_ros.datasets.synthetic import KINECT, SyntheticSource
from room_layout_ros.playback import frame_stream

RATE_HZ = 30.0
_KINDS = {COLOR_INFO_TOPIC: messages.CameraInfo, COLOR_TOPIC: messages.Image, DEPTH_TOPIC: messages.Image}
_FRAMES = 120
_RENDERED = 12
_STAMP = struct.Struct("<iI")
_STAMP_AT = 4
"""Behind the four bytes that say how CDR is encoded, a header begins with its stamp."""
_START_S = 300.0
_SETTLE_S = 1.0


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--namespace", required=True)
    parser.add_argument("--frames", type=Path, help="frames folder; rendered ones without")
    parser.add_argument("--hd", action="store_true", help="rendered frames of 1280x720")
    options = parser.parse_args()
    frames = _load(_source(options.frames, HD if options.hd else KINECT))
    rclpy.init(args=[])
    try:
        node = rclpy.create_node("camera", namespace=options.namespace)
        publishers = {
            topic: node.create_publisher(kind, topic.lstrip("/"), qos_profile_sensor_data)
            for topic, kind in _KINDS.items()
        }
        _wait(list(publishers.values()))
        sent = _play(frames, publishers, round(options.seconds * RATE_HZ))
        print(json.dumps({"sent": sent}), flush=True)
        time.sleep(1.0)  # the readers fetch the last ones
    finally:
        try_shutdown()


def _source(folder: Path | None, camera: CameraIntrinsics) -> FrameSource:
    if folder is None:
        return SyntheticSource(_RENDERED, 4, camera=camera)
    whole = open_folder(folder)
    return whole.subset(tuple(whole.names[:_FRAMES]))


def _load(source: FrameSource) -> list[dict[str, bytearray]]:
    """Return the messages of each frame by topic, encoded."""
    by_stamp: dict[int, dict[str, bytearray]] = {}
    for message in frame_stream(source)():
        by_stamp.setdefault(message.time_ns, {})[message.topic] = bytearray(message.raw)
    return [by_stamp[stamp] for stamp in sorted(by_stamp)]


def _wait(publishers: list[Any]) -> None:
    end = time.monotonic() + _START_S
    while not all(p.get_subscription_count() for p in publishers):
        if time.monotonic() > end:
            raise SystemExit(f"nobody has subscribed within {_START_S:.0f} s")
        time.sleep(0.05)
    time.sleep(_SETTLE_S)  # the readers have to know us too


def _play(frames: list[dict[str, bytearray]], publishers: dict[str, Any], number: int) -> int:
    start = time.perf_counter()
    for i, frame in enumerate(itertools.islice(_there_and_back(frames), number)):
        time.sleep(max(0.0, start + i / RATE_HZ - time.perf_counter()))
        stamp = divmod(time.time_ns(), NS_PER_S)
        for topic, publisher in publishers.items():
            _STAMP.pack_into(frame[topic], _STAMP_AT, *stamp)
            publisher.publish(bytes(frame[topic]))
    return number


def _there_and_back(frames: list[dict[str, bytearray]]) -> Iterator[dict[str, bytearray]]:
    """Yield the frames forth and back for ever: no jump that a camera would not make."""
    return itertools.cycle([*frames, *frames[-2:0:-1]])


if __name__ == "__main__":
    main()
