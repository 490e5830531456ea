"""What the node published, read back from the recorded MCAP."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.datasets import DataError

Image = NDArray[np.uint8]
_CHANNELS = {"mono8": 1, "rgb8": 3}


@dataclass(frozen=True, slots=True)
class Recording:
    """The recorded topics, and per stamp of the input the pictures that came back.

    Attributes
    ----------
    topics : (name, type, messages) in the order of their names.
    overlay, layout, labels : by stamp in nanoseconds; (H, W, 3) and (H, W) uint8.
    """

    topics: tuple[tuple[str, str, int], ...]
    overlay: dict[int, Image]
    layout: dict[int, Image]
    labels: dict[int, Image]


def read_recording(path: Path) -> Recording:
    """Read a recorded MCAP.

    Raises
    ------
    DataError
        When it is missing, damaged, or holds no overlay.
    """
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    pictures: dict[str, dict[int, Image]] = {"overlay": {}, "layout": {}, "labels": {}}
    counts: Counter[tuple[str, str]] = Counter()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            for connection, _, raw in reader.messages():
                counts[connection.topic, connection.msgtype] += 1
                kind = connection.topic.rpartition("/")[2]
                if kind in pictures and connection.msgtype == "sensor_msgs/msg/Image":
                    message = reader.deserialize(raw, connection.msgtype)
                    pictures[kind][stamp_ns(message)] = pixels(message)
    except (AnyReaderError, OSError) as error:
        raise DataError(f"{path} cannot be read: {error}") from None
    topics = tuple((topic, kind, count) for (topic, kind), count in sorted(counts.items()))
    if not pictures["overlay"]:
        seen = ", ".join(f"{t} ({n})" for t, _, n in topics) or "nothing"
        raise DataError(f"{path} holds no overlay picture; recorded was {seen}")
    return Recording(topics, **pictures)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message with a header."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


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
