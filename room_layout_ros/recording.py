"""A recorder: writes what topics carry, as it comes over DDS, into a rosbag2 (MCAP).

Like `node` a shell around rclpy. Messages are never decoded: bytes in, bytes out.
"""

from __future__ import annotations

import argparse
import json
import queue
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from .ros_process import BAD_SETTINGS, join, leave, message_class, sentence

_DEPTH = 200
_LOOK_PERIOD_S = 0.1
_WAITING = 2000
"""Messages that may wait for the disk: seconds of all that the node publishes, some 300 MB."""

Message = tuple[str, str, int, bytes]
"""Topic, type, time of arrival in ns, CDR."""


class Recorder(Node):
    """Subscribes to topics as their publishers turn up and hands every message to a writer thread.

    Parameters
    ----------
    bag : Path
        Folder to be made.
    topics : list of str
        Names, relative to the namespace.

    Raises
    ------
    ValueError
        When the folder exists or a name is no topic.
    """

    def __init__(self, bag: Path, topics: Sequence[str], **options: Any) -> None:
        super().__init__("recorder", **options)
        if bag.exists():
            raise ValueError(f"recording goes to {bag}, which exists; name a folder that does not")
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self.counts: Counter[str] = Counter()
        self.lost: Counter[str] = Counter()
        self.topics = sorted({self.resolve_topic_name(topic) for topic in topics})
        self.missing = list(self.topics)
        """Those that nobody has published so far."""
        self._messages: queue.Queue[Message | None] = queue.Queue(_WAITING)
        self.failure = ""
        """Why the bag cannot be written; "" while it can."""
        self._writer = threading.Thread(target=self._write, args=(bag,), name="writer")
        self._writer.start()
        self.create_timer(_LOOK_PERIOD_S, self._look)

    def close(self) -> None:
        """Write what is left and finish the bag."""
        if not self.failure:
            self._messages.put(None)  # may wait for the disk; a writer that fails meanwhile makes room
        self._writer.join()

    def _look(self) -> None:
        for topic in list(self.missing):
            publishers = self.get_publishers_info_by_topic(topic)
            if publishers:
                self.missing.remove(topic)
                self._subscribe(topic, publishers)

    def _subscribe(self, topic: str, publishers: Sequence[Any]) -> None:
        kind = publishers[0].topic_type
        if kind not in self._typestore.types:
            self.get_logger().error(f"{topic} has type {kind[:80]!r}, which is no standard message; it is not recorded")
            return
        profiles = [p.qos_profile for p in publishers]
        reliable = all(p.reliability == QoSReliabilityPolicy.RELIABLE for p in profiles)
        latched = all(p.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        qos = QoSProfile(
            depth=_DEPTH,
            reliability=QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT,
            durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE,
        )
        events = SubscriptionEventCallbacks(message_lost=partial(self._on_lost, topic))
        callback = partial(self._on_message, topic, kind)
        self.create_subscription(message_class(kind), topic, callback, qos, event_callbacks=events, raw=True)

    def _on_message(self, topic: str, kind: str, serialized: bytes) -> None:
        try:
            self._messages.put_nowait((topic, kind, time.time_ns(), serialized))
        except queue.Full:  # the disk is too slow
            self.lost[topic] += 1
        else:
            self.counts[topic] += 1

    def _on_lost(self, topic: str, info: Any) -> None:
        self.lost[topic] += info.total_count_change

    def _write(self, bag: Path) -> None:
        """Write until told to end, whatever happens: this is the guarded edge of the writer's thread."""
        try:
            _write(bag, self._typestore, self._messages)
        except Exception as error:  # noqa: BLE001
            self.failure = f"{bag} cannot be written: {getattr(error, 'strerror', None) or error}"
            with suppress(queue.Empty):  # for one who waits to put the end in
                self._messages.get_nowait()


def _write(bag: Path, typestore: Any, messages: queue.Queue[Message | None]) -> None:
    connections: dict[str, Any] = {}
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        while (message := messages.get()) is not None:
            topic, kind, received_ns, serialized = message
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=typestore)
            writer.write(connections[topic], received_ns, serialized)


def main(args: Sequence[str] | None = None) -> int:
    """Record until SIGINT or SIGTERM, or --seconds; prints {"topic": [messages, lost]} as JSON.

    All topics asked for are in it; a line on stderr names each that nobody publishes.

    Returns 0, or 2 after one sentence where a name, the domain or the folder is wrong or the disk is full.
    """
    parser = argparse.ArgumentParser(prog="room_layout_ros.recording", description=__doc__)
    parser.add_argument("topics", nargs="+")
    parser.add_argument("--out", type=Path, required=True, metavar="BAG", help="folder to be made")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    options = parser.parse_args(args)
    try:
        try:
            join([])
            recorder = Recorder(options.out, options.topics)
        except BAD_SETTINGS as error:
            print(f"recording: {sentence(error)}", file=sys.stderr)
            return 2
        _spin(recorder, options.seconds)
        if recorder.failure:
            print(f"recording: {recorder.failure}", file=sys.stderr)
            return 2
        for topic in recorder.missing:
            print(f"recording: nobody publishes {topic}", file=sys.stderr)
        print(json.dumps({t: [recorder.counts[t], recorder.lost[t]] for t in recorder.topics}), flush=True)
    except KeyboardInterrupt:
        pass
    finally:
        leave()
    return 0


def _spin(recorder: Recorder, seconds: float) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(recorder)
    end = time.monotonic() + seconds
    try:
        while recorder.context.ok() and not recorder.failure and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        recorder.close()


if __name__ == "__main__":
    sys.exit(main())
