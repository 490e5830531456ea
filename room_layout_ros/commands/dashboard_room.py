"""What the dashboard shows of one frame, and the form in which the page gets it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.evaluation.floor_picture import FloorGrid

MOST_POINTS = 5000
"""Points of one frame on the page: more of them cost the browser more than they show."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points of a frame: points_m (n, 3) float32 in the camera frame, colors (n, 3) uint8 RGB."""

    points_m: NDArray[np.float32]
    colors: NDArray[np.uint8]

    def thinned(self) -> Cloud:
        """Return at most MOST_POINTS of them, evenly chosen."""
        step = max(1, -(-len(self.points_m) // MOST_POINTS))
        return Cloud(self.points_m[::step], self.colors[::step])


@dataclass(frozen=True, slots=True)
class Room:
    """What the page shows of one frame.

    Attributes
    ----------
    name : of the frame. overlay : JPEG bytes, empty where there is none.
    polygons : (face id, corners in metres) of the visible faces. grid, cloud : None where there is none.
    numbers : shown as they are.
    stages : milliseconds of each. milliseconds : wall time of the estimate, less than their sum as stages run beside
        each other; None where only the stages are known.
    metric : False where the scale is unknown: then one unit is the distance of the front wall. None where nothing told.
    """

    name: str
    overlay: bytes = b""
    polygons: Sequence[tuple[int, Sequence[Sequence[float]]]] = ()
    grid: FloorGrid | None = None
    cloud: Cloud | None = None
    numbers: Mapping[str, str] = field(default_factory=dict)
    stages: Mapping[str, float] = field(default_factory=dict)
    milliseconds: float | None = None
    metric: bool | None = None


def state_of(number: int, frames: int, room: Room) -> dict[str, Any]:
    """Return a room for JSON, with the running number of what is shown and the count of frames; arrays in base64."""
    return {
        "number": number,
        "frames": frames,
        "name": room.name,
        "metric": room.metric,
        "overlay": bool(room.overlay),
        "polygons": {str(face): points for face, points in room.polygons},
        "grid": None if room.grid is None else _grid(room.grid),
        "cloud": None if room.cloud is None else _cloud(room.cloud),
        "numbers": dict(room.numbers),
        "stages": dict(room.stages),
        "milliseconds": room.milliseconds,
    }


def _grid(grid: FloorGrid) -> dict[str, Any]:
    """Cells row by row ahead of the robot, as the page draws them, in each row from right to left."""
    ahead, left = grid.cells.shape[::-1]
    return {
        "cells": _base64(grid.cells.T, np.int8),
        "ahead": ahead,
        "left": left,
        "resolution": grid.resolution_m,
        "origin": list(grid.origin_m),
    }


def _cloud(cloud: Cloud) -> dict[str, str]:
    return {"points": _base64(cloud.points_m, "<f4"), "colors": _base64(cloud.colors, np.uint8)}


def _base64(array: NDArray[Any], kind: Any) -> str:
    return b64encode(np.ascontiguousarray(array, kind).tobytes()).decode()
