"""Text of unknown origin, made fit for a log line: `room_layout_ros.decoding.text`."""

from __future__ import annotations

from room_layout_ros.decoding.text import MAX_NAME, MAX_SHOWN, clean_text

__all__ = ["MAX_NAME", "MAX_SHOWN", "clean_text"]
