"""Subscriptions for a while: what topics carry goes to plain functions. Like `playback` a shell around rclpy."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from room_layout_ros.datasets import DataError


class Listener(NamedTuple):
    """A topic, its type ("sensor_msgs/msg/Image"), how many messages may wait, and who takes them."""

    topic: str
    kind: str
    depth: int
    take: Callable[[Any], None]


def listen(name: str, listeners: Sequence[Listener], end: float) -> None:
    """Subscribe and hand on messages until `end` (time.monotonic), SIGINT or SIGTERM.

    Raises
    ------
    DataError
        When ROS or a message package is not installed, or a topic name is not allowed.
    """
    try:
        import rclpy
        from rclpy.exceptions import InvalidTopicNameException
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        kinds = [_message_class(listener.kind) for listener in listeners]
    except ImportError as error:
        what = error.name or "rclpy"
        raise DataError(f"listening needs ROS 2 ({what} is missing): pip install 'room_layout_ros[ros]'") from None
    rclpy.init(args=[])
    try:
        node = rclpy.create_node(name)
        for listener, kind in zip(listeners, kinds, strict=True):
            node.create_subscription(kind, listener.topic, listener.take, listener.depth)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while time.monotonic() < end and rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
    except InvalidTopicNameException as error:
        raise DataError(" ".join(str(error).split())) from None
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


def _message_class(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)
