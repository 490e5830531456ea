"""Stamps of messages <-> nanoseconds."""

from __future__ import annotations

from room_layout_ros.decoding.protocols import StampLike

NS_PER_S = 1_000_000_000


def decode_stamp(stamp: StampLike) -> int:
    """Return the time in nanoseconds, above 0.

    Raises
    ------
    ValueError
        When the stamp is zero or negative, or its nanoseconds are not below one second.
    """
    sec, nanosec = int(stamp.sec), int(stamp.nanosec)
    if not 0 <= nanosec < NS_PER_S:
        raise ValueError(f"stamp has nanosec {nanosec}; allowed is 0 to 999999999")
    if sec < 0 or sec + nanosec == 0:
        raise ValueError(f"stamp is {sec}.{nanosec:09d} s; it must be above 0")
    return sec * NS_PER_S + nanosec
