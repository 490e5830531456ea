"""What the node published, read back from the recorded MCAP."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.commands.frame_words import counted
from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.bag import open_reader, raw_messages
from room_layout_ros.datasets.bag_messages import IMAGE, OCCUPANCY_GRID, decode, stamp_of
from room_layout_ros.evaluation.floor_picture import FloorGrid
from room_layout_ros.runtime.diagnosis import Level

Image = NDArray[np.uint8]
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
_ESTIMATES = ": estimates"
_CHANNELS = {"mono8": 1, "rgb8": 3}
_NO_ESTIMATE, _DROPPED = "no estimate: ", "dropped: "
_WORDS = {f"{_DROPPED}newer frame": "left out for a newer frame as the node was late"}
"""What the node counts, where its words for it say little outside /diagnostics."""


@dataclass(frozen=True, slots=True)
class Recording:
    """The recorded topics, and per stamp of the input the pictures that came back.

    Attributes
    ----------
    topics : (name, type, messages) in the order of their names.
    overlay, layout, labels : by stamp in nanoseconds; (H, W, 3) and (H, W) uint8.
    free_space : by stamp; of frames with floor in view.
    health : what the node last said of itself on /diagnostics ("latency_p50_ms": "41.2"); empty without a node.
    doubts : the last warning there about its estimates, if any.
    """

    topics: tuple[tuple[str, str, int], ...]
    overlay: dict[int, Image]
    layout: dict[int, Image]
    labels: dict[int, Image]
    free_space: dict[int, FloorGrid]
    health: dict[str, str]
    doubts: tuple[str, ...]

    @property
    def rooms(self) -> set[int]:
        """Stamps of the frames that came back as rooms."""
        return {stamp for stamp, layout in self.layout.items() if layout.any()}

    @property
    def no_room(self) -> dict[str, int]:
        """How many frames have no room, by the reason that the node gives; empty without a node."""
        return no_room(self.health)


def read_recording(path: Path) -> Recording:
    """Read a recorded MCAP.

    Raises
    ------
    DataError
        When it is missing, damaged, or holds no overlay: with what the node says of the frames.
    """
    pictures: dict[str, dict[int, Image]] = {"overlay": {}, "layout": {}, "labels": {}}
    counts: Counter[tuple[str, str]] = Counter()
    health: dict[str, str] = {}
    doubts: tuple[str, ...] = ()
    free_space: dict[int, FloorGrid] = {}
    with open_reader(path) as reader:
        for connection, _, raw in raw_messages(reader, {c.topic for c in reader.connections}, path):
            counts[connection.topic, connection.msgtype] += 1
            kind = connection.topic.rpartition("/")[2]
            if kind in pictures and connection.msgtype == IMAGE:
                message = decode(raw, IMAGE)
                pictures[kind][stamp_of(message)] = pixels(message)
            elif kind == "free_space" and connection.msgtype == OCCUPANCY_GRID:
                message = decode(raw, OCCUPANCY_GRID)
                free_space[stamp_of(message)] = FloorGrid.of_message(message)
            elif connection.msgtype == DIAGNOSTICS:
                statuses = decode(raw, DIAGNOSTICS).status
                health |= {value.key: value.value for status in statuses for value in status.values}
                warned = [s for s in statuses if s.name.endswith(_ESTIMATES) and s.level == Level.WARN]
                doubts = (f"the node warned: {warned[-1].message}",) if warned else doubts
    topics = tuple((topic, kind, count) for (topic, kind), count in sorted(counts.items()))
    if not pictures["overlay"]:
        seen = ", ".join(f"{t} ({n})" for t, _, n in topics) or "nothing"
        why = counted(no_room(health)) or "the node does not say why"
        raise DataError(f"{path} holds no room: {why}; recorded was {seen}")
    return Recording(topics, **pictures, free_space=free_space, health=health, doubts=doubts)


def no_room(health: Mapping[str, str]) -> dict[str, int]:
    """Return how many frames have no room, by the reason, of what the node said of itself last."""
    return {
        _WORDS.get(key, key.removeprefix(_NO_ESTIMATE)): int(count)
        for key, count in health.items()
        if key.startswith((_NO_ESTIMATE, _DROPPED))
    }


def pixels(message: Any) -> Image:
    """Return the pixels of a mono8 or rgb8 image message.

    Raises
    ------
    DataError
        For another encoding.
    """
    channels = _CHANNELS.get(message.encoding)
    if channels is None:
        raise DataError(f"recorded image is {message.encoding}; the node publishes {', '.join(_CHANNELS)}")
    rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)[:, : message.width * channels]
    return rows.reshape((message.height, message.width, 3) if channels == 3 else (message.height, message.width)).copy()
