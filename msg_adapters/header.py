"""std_msgs/Header of everything that is published: stamp and frame of the depth image."""

from __future__ import annotations

from .messages import Header, Time
from .stamp import NS_PER_S


def encode_header(stamp_ns: int, frame_id: str) -> Header:
    """Return a new header (messages must not share one: rclpy keeps references)."""
    return Header(stamp=encode_time(stamp_ns), frame_id=frame_id)


def encode_time(stamp_ns: int) -> Time:
    """Return nanoseconds as builtin_interfaces/Time."""
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    return Time(sec=sec, nanosec=nanosec)
