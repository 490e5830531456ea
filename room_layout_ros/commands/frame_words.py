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
    return f"{who_has(count, of)} no room: {counted(reasons)}" if count else ""


def who_has(count: int, of: int) -> str:
    """Return "the frame has", "1 of 6 frames has" or "2 of 6 frames have"."""
    return "the frame has" if of == 1 else f"{count} of {of} frames {'has' if count == 1 else 'have'}"


def counted(reasons: Mapping[str, int]) -> str:
    """Return the reasons with the number of frames behind each, the most frequent first."""
    ordered = sorted(reasons.items(), key=lambda item: -item[1])
    return ", ".join(f"{reason} ({count})" for reason, count in ordered if count)
