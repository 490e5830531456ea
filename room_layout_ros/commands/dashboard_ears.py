"""The dashboard's ears: messages of a running node become rooms. Reads fields of messages, imports no ROS."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np

from room_layout_ros.core.labels import LABEL_NAMES
from room_layout_ros.datasets.images import encode_image
from room_layout_ros.listening import Listener

from .dashboard_plan import draw_plan
from .dashboard_server import Board, Room

_KEPT = 8
_JPEG_QUALITY = 85
_MOST_CELLS = 4_000_000


class Ears:
    """Collects messages by stamp; each overlay makes a room. Polygons come in the same burst, some of them later."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._polygons: OrderedDict[int, dict[int, list[list[float]]]] = OrderedDict()
        self._overlays: OrderedDict[int, bytes] = OrderedDict()
        self._numbers: dict[str, str] = {}
        self._stages: dict[str, float] = {}
        self._plan = b""

    def listeners(self, node: str) -> list[Listener]:
        """Return what to listen to for the node of this name."""
        return [
            Listener(f"{node}/polygons", "geometry_msgs/msg/PolygonInstanceStamped", 50, self.on_polygon),
            Listener(f"{node}/overlay", "sensor_msgs/msg/Image", 2, self.on_overlay),
            Listener(f"{node}/free_space", "nav_msgs/msg/OccupancyGrid", 2, self.on_free_space),
            Listener("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 10, self.on_diagnostics),
        ]

    def on_polygon(self, message: Any) -> None:
        """Take one face."""
        stamp = _stamp_ns(message)
        corners = [[p.x, p.y, p.z] for p in message.polygon.polygon.points]
        self._polygons.setdefault(stamp, {})[int(message.polygon.id)] = corners
        self._trim(self._polygons)
        if stamp in self._overlays:
            self._show(stamp)

    def on_overlay(self, message: Any) -> None:
        """Take the picture of a frame; it makes a room."""
        if message.encoding != "rgb8":
            return
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        pixels = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
        stamp = _stamp_ns(message)
        self._overlays[stamp] = encode_image(".jpg", np.ascontiguousarray(pixels), _JPEG_QUALITY)
        self._trim(self._overlays)
        self._show(stamp)

    def on_diagnostics(self, message: Any) -> None:
        """Take the node's numbers."""
        for status in message.status:
            self._numbers[str(status.name)[:60]] = str(status.message)[:120]
            for value in status.values:
                key, text = str(value.key), str(value.value)
                if key.startswith("stage_ms: "):
                    self._stages[key.removeprefix("stage_ms: ")] = _number(text)
                elif key in ("latency_p50_ms", "latency_p99_ms"):
                    self._numbers[key] = text

    def on_free_space(self, message: Any) -> None:
        """Take the newest free-space grid; its own picture, a frame older or newer than the overlay."""
        width, height = int(message.info.width), int(message.info.height)
        cells = np.asarray(message.data, np.int8)
        if not 0 < width * height == cells.size <= _MOST_CELLS:
            return
        self._plan = draw_plan(cells.reshape(height, width))

    def _show(self, stamp: int) -> None:
        polygons = sorted(self._polygons.get(stamp, {}).items())
        name = f"{stamp / 1e9:.3f} s"
        known = [(face, corners) for face, corners in polygons if 0 < face < len(LABEL_NAMES)]
        self._board.show(Room(name, self._overlays[stamp], self._plan, known, dict(self._numbers), dict(self._stages)))

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
