"""Frames in words: how many they are, and how many have no room, and why."""

from __future__ import annotations

from collections.abc import Mapping


def count_of_frames(count: int) -> str:
    """Return "1 frame" or "6 frames"."""
    return f"{count} frame{'' if count == 1 else 's'}"


def without_room(reasons: Mapping[str, int], of: int) -> str:
    """Return how many of so many frames have no room, as a sentence; "" where each has one.

    `reasons` : frames by reason.
    """
    count = sum(reasons.values())
    if not count:
        return ""
    who = "the frame has" if of == 1 else f"{count} of {of} frames {'has' if count == 1 else 'have'}"
    return f"{who} no room: {counted(reasons)}"


def counted(reasons: Mapping[str, int]) -> str:
    """Return the reasons with the number of frames behind each, the most frequent first."""
    ordered = sorted(reasons.items(), key=lambda item: -item[1])
    return ", ".join(f"{reason} ({count})" for reason, count in ordered if count)
