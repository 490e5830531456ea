"""How a face is named with its distance, wherever a person reads it; the node's markers have the same text."""

from __future__ import annotations

import re

from room_layout_ros.core.labels import LABEL_NAMES

_METRES = " m"
_NAMED = re.compile(rf"(?:{'|'.join(LABEL_NAMES)}) -?\d+\.\d\d({_METRES})?")


def distance_text(distance: float, metric: bool) -> str:
    """Return the distance of a face, "2.31 m", or "2.31" where the scale is unknown and the front wall is at 1."""
    return f"{distance:.2f}{_METRES if metric else ''}"


def face_text(face: int, distance: float, metric: bool) -> str:
    """Return name and distance of a face: "front wall 2.31 m"."""
    return f"{LABEL_NAMES[face]} {distance_text(distance, metric)}"


def says_metres(text: str) -> bool | None:
    """Return whether a text of `face_text` is in metres, None where it is no such text."""
    told = _NAMED.fullmatch(text)
    return None if told is None else told[1] is not None
