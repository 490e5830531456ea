"""Subscriptions for a while: what topics carry goes to plain functions. Like `playback` a shell around rclpy."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from room_layout_ros.datasets import DataError
from room_layout_ros.extras import install_hint


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
        When ROS or a message package is not installed, or ROS refuses a topic or the domain.
    """
    try:
        import rclpy
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        from .ros_process import BAD_SETTINGS, join, leave, sentence

        kinds = [_message_class(listener.kind) for listener in listeners]
    except ImportError as error:
        what = error.name or "rclpy"
        raise DataError(f"listening needs ROS 2 ({what} is missing): {install_hint('ros')}") from None
    try:
        join([])
        node = rclpy.create_node(name)
        for listener, kind in zip(listeners, kinds, strict=True):
            node.create_subscription(kind, listener.topic, listener.take, listener.depth)
    except BAD_SETTINGS as error:
        leave()
        raise DataError(sentence(error)) from None
    try:
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while time.monotonic() < end and rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        leave()


def _message_class(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)
