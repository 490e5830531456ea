"""The dashboard's ears: what a running node publishes."""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import Any

import numpy as np

from room_layout_ros.core.labels import LABEL_NAMES
from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.images import encode_image

from .dashboard_server import Board, Room

_KEPT = 8
_JPEG_QUALITY = 85


def listen(board: Board, node_name: str, end: float) -> None:
    """Show every overlay of the node with the polygons of the same stamp, until `end` (time.monotonic).

    Raises
    ------
    DataError
        When ROS is not installed.
    """
    try:
        import rclpy
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

        from msg_adapters.messages import DiagnosticArray, Image, PolygonInstanceStamped
    except ImportError:
        raise DataError("listening to a node needs ROS 2: pip install 'room_layout_ros[ros]', or give INPUT") from None
    rclpy.init(args=[])
    try:
        node = rclpy.create_node("room_layout_dashboard")
        ears = _Ears(board)
        node.create_subscription(PolygonInstanceStamped, f"{node_name}/polygons", ears.on_polygon, 50)
        node.create_subscription(Image, f"{node_name}/overlay", ears.on_overlay, 2)
        node.create_subscription(DiagnosticArray, "/diagnostics", ears.on_diagnostics, 10)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while time.monotonic() < end and rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


class _Ears:
    """Collects messages by stamp; each overlay makes a room. Polygons come in the same burst, some of them later."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._polygons: OrderedDict[int, dict[int, list[list[float]]]] = OrderedDict()
        self._overlays: OrderedDict[int, bytes] = OrderedDict()
        self._numbers: dict[str, str] = {}
        self._stages: dict[str, float] = {}

    def on_polygon(self, message: Any) -> None:
        stamp = _stamp_ns(message)
        corners = [[p.x, p.y, p.z] for p in message.polygon.polygon.points]
        self._polygons.setdefault(stamp, {})[int(message.polygon.id)] = corners
        self._trim(self._polygons)
        if stamp in self._overlays:
            self._show(stamp)

    def on_overlay(self, message: Any) -> None:
        if message.encoding != "rgb8":
            return
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        pixels = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
        stamp = _stamp_ns(message)
        self._overlays[stamp] = encode_image(".jpg", np.ascontiguousarray(pixels), _JPEG_QUALITY)
        self._trim(self._overlays)
        self._show(stamp)

    def on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            self._numbers[str(status.name)[:60]] = str(status.message)[:120]
            for value in status.values:
                key, text = str(value.key), str(value.value)
                if key.startswith("stage_ms: "):
                    self._stages[key.removeprefix("stage_ms: ")] = _number(text)
                elif key in ("latency_p50_ms", "latency_p99_ms"):
                    self._numbers[key] = text

    def _show(self, stamp: int) -> None:
        polygons = sorted(self._polygons.get(stamp, {}).items())
        name = f"{stamp / 1e9:.3f} s"
        known = [(face, corners) for face, corners in polygons if 0 < face < len(LABEL_NAMES)]
        self._board.show(Room(name, self._overlays[stamp], b"", known, dict(self._numbers), dict(self._stages)))

    @staticmethod
    def _trim(kept: OrderedDict[int, Any]) -> None:
        while len(kept) > _KEPT:
            kept.popitem(last=False)


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
