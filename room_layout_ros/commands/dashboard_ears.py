"""The dashboard's ears: messages of a running node become rooms. Reads fields of messages, imports no ROS."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.labels import CLUTTER, FLOOR, LABEL_COLORS, LABEL_NAMES
from room_layout_ros.datasets.images import encode_image
from room_layout_ros.evaluation.face_text import says_metres
from room_layout_ros.evaluation.floor_picture import FloorGrid
from room_layout_ros.listening import Listener
from room_layout_ros.runtime.diagnosis import Level

from .dashboard_room import Cloud, Room
from .dashboard_server import Board

SETTLE_S = 0.1
"""The messages of one frame come one after another, within this time."""

_KEPT = 8
_SILENCE_S = 3.0
"""A node says how it is every second; without a word for so long what it said last is no longer true."""
_STAGE = "stage_ms: "
_JPEG_QUALITY = 85
_MOST_CELLS = 4_000_000
_OK = bytes([Level.OK])  # as messages have it
_FLOAT32 = 7  # sensor_msgs/PointField.FLOAT32


@dataclass(slots=True)
class _Heard:
    """The parts of one frame so far. points : (n, 3) float32 by label id. metric : None until a marker has told."""

    overlay: bytes = b""
    polygons: dict[int, list[list[float]]] = field(default_factory=dict)
    grid: FloorGrid | None = None
    points: dict[int, NDArray[np.float32]] = field(default_factory=dict)
    metric: bool | None = None


class Ears:
    """Collects messages by stamp; each overlay makes a room. The other parts come in the same burst, some later.

    Parameters
    ----------
    board : where the rooms are shown.
    node : name of the node to listen to, with its namespace.
    clock : the time in seconds.
    """

    def __init__(self, board: Board, node: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._board, self._node, self._clock = board, node, clock
        self._said: tuple[float, str] | None = None
        board.reason = self.reason
        self._heard: OrderedDict[int, _Heard] = OrderedDict()
        self._numbers: dict[str, str] = {}
        self._stages: dict[str, float] = {}

    def listeners(self) -> list[Listener]:
        """Return what to listen to."""
        node = self._node
        return [
            Listener(f"{node}/polygons", "geometry_msgs/msg/PolygonInstanceStamped", 50, self.on_polygon),
            Listener(f"{node}/markers", "visualization_msgs/msg/MarkerArray", 2, self.on_markers),
            Listener(f"{node}/overlay", "sensor_msgs/msg/Image", 2, self.on_overlay),
            Listener(f"{node}/free_space", "nav_msgs/msg/OccupancyGrid", 2, self.on_free_space),
            Listener(f"{node}/obstacles", "sensor_msgs/msg/PointCloud2", 2, self.on_obstacles),
            Listener(f"{node}/floor", "sensor_msgs/msg/PointCloud2", 2, self.on_floor),
            Listener("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 10, self.on_diagnostics),
        ]

    def reason(self) -> str:
        """Return what the node says of itself, its troubles alone where it has any; or that it says nothing."""
        said = self._said
        if said is None:
            return f"nothing is heard of a node {self._node}"
        silence = self._clock() - said[0]
        return said[1] if silence < _SILENCE_S else f"nothing is heard of {self._node} for {silence:.0f} s"

    def on_polygon(self, message: Any) -> None:
        """Take one face."""
        face = int(message.polygon.id)
        if 0 < face < len(LABEL_NAMES):
            corners = [[p.x, p.y, p.z] for p in message.polygon.polygon.points]
            self._parts_of(message).polygons[face] = corners
            self._show(message)

    def on_markers(self, message: Any) -> None:
        """Take from the names of the faces whether their distances are metres: no other message of a frame tells."""
        names = [marker for marker in message.markers if marker.ns == "names"]
        told = {says_metres(str(marker.text)) for marker in names}
        if len(told) == 1:
            self._parts_of(names[0]).metric = told.pop()
            self._show(names[0])

    def on_overlay(self, message: Any) -> None:
        """Take the picture of a frame; it makes a room."""
        if message.encoding != "rgb8":
            return
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        pixels = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
        self._parts_of(message).overlay = encode_image(".jpg", np.ascontiguousarray(pixels), _JPEG_QUALITY)
        self._show(message)

    def on_free_space(self, message: Any) -> None:
        """Take the free-space grid."""
        info = message.info
        if not 0 < info.width * info.height == len(message.data) <= _MOST_CELLS:
            return
        self._parts_of(message).grid = FloorGrid.of_message(message)
        self._show(message)

    def on_obstacles(self, message: Any) -> None:
        """Take the points of things."""
        self._take_points(message, CLUTTER)

    def on_floor(self, message: Any) -> None:
        """Take the points of free floor."""
        self._take_points(message, FLOOR)

    def on_diagnostics(self, message: Any) -> None:
        """Take the node's numbers. The topic is everybody's; our node's statuses are named "<node>: <what>"."""
        own = f"{self._node.strip('/')}: "
        ours = [status for status in message.status if str(status.name).startswith(own)]
        if ours:
            troubles = [status for status in ours if status.level != _OK]
            # Without trouble how the estimates go is more than how the camera does.
            words = troubles or [status for status in ours if status.name == f"{own}estimates"] or ours[:1]
            self._said = self._clock(), "; ".join(str(status.message)[:120] for status in words)
        for status in ours:
            self._numbers[str(status.name).removeprefix(own)[:60]] = str(status.message)[:120]
            self._take_values({str(value.key): str(value.value) for value in status.values})

    def _take_values(self, values: Mapping[str, str]) -> None:
        stages = {key.removeprefix(_STAGE): _number(text) for key, text in values.items() if key.startswith(_STAGE)}
        self._stages = stages or self._stages  # only one of the statuses has them
        self._numbers.update((key, values[key]) for key in ("latency_p50_ms", "latency_p99_ms") if key in values)

    def _take_points(self, message: Any, label: int) -> None:
        points = _points_of(message)
        if points is not None:
            self._parts_of(message).points[label] = points
            self._show(message)

    def _parts_of(self, message: Any) -> _Heard:
        heard = self._heard.setdefault(_stamp_ns(message), _Heard())
        while len(self._heard) > _KEPT:
            self._heard.popitem(last=False)
        return heard

    def _show(self, message: Any) -> None:
        stamp = _stamp_ns(message)
        heard = self._heard.get(stamp)
        if heard is None or not heard.overlay:
            return
        room = Room(
            name=f"{stamp / 1e9:.3f} s",
            overlay=heard.overlay,
            polygons=sorted(heard.polygons.items()),
            grid=heard.grid,
            cloud=_cloud(heard.points),
            numbers=dict(self._numbers),
            stages=dict(self._stages),
            metric=heard.metric,
        )
        self._board.show(room)


def _cloud(points: dict[int, NDArray[np.float32]]) -> Cloud | None:
    """Put the points of all labels together, in the colours of the labels."""
    if not points:
        return None
    colors = [np.repeat(LABEL_COLORS[[label]], len(p), axis=0) for label, p in points.items()]
    return Cloud(np.concatenate(list(points.values())), np.concatenate(colors)).thinned()


def _points_of(message: Any) -> NDArray[np.float32] | None:
    """(n, 3) x, y, z of a PointCloud2; None where it does not hold them as little-endian float32."""
    offsets = {f.name: int(f.offset) for f in message.fields if f.datatype == _FLOAT32}
    count, step = int(message.width) * int(message.height), int(message.point_step)
    if not offsets.keys() >= set("xyz") or message.is_bigendian or len(message.data) != count * step:
        return None
    if max(offsets[name] for name in "xyz") + 4 > step:
        return None
    kind = np.dtype(
        {"names": [*"xyz"], "formats": ["<f4"] * 3, "offsets": [offsets[n] for n in "xyz"], "itemsize": step}
    )
    rows = np.frombuffer(message.data, kind)
    return np.stack([rows[name] for name in "xyz"], axis=1).astype(np.float32)


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
