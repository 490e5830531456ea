"""What is free on the floor, exactly: boxes and walls against cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.datasets.sample import FloorMap

from .room import SyntheticRoom
from .shapes import Solid

Footprints = NDArray[np.float64]

_FLAT_M = 0.02
"""What is lower than this lies on the floor and is no obstacle (a rug)."""


def footprints(solids: Sequence[Solid], lowest_m: float, highest_m: float) -> Footprints:
    """Return (n, 7) float64 x, y, cos, sin, half sizes, top of the solids that reach into lowest..highest."""
    rows = [
        [s.x, s.y, *s.axes[0], s.size_x / 2, s.size_y / 2, s.top]
        for s in solids
        if s.top > max(lowest_m, _FLAT_M) and s.bottom < highest_m
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def is_free(room: SyntheticRoom, x: float, y: float, margin: float) -> bool:
    """Whether a disc of radius `margin` on the floor touches neither wall nor furniture."""
    parts = room.floor_parts
    inside = (parts[:, 0] <= x) & (x <= parts[:, 2]) & (parts[:, 1] <= y) & (y <= parts[:, 3])
    if not inside.any():
        return False
    for i in range(len(room.corners)):
        start, end = room.wall(i)
        along = end - start
        t = np.clip(np.dot([x, y] - start, along) / (along @ along), 0.0, 1.0)
        if np.hypot(*(start + t * along - [x, y])) < margin:
            return False
    for row in footprints(room.solids, 0.0, 3.0):
        dx, dy = x - row[0], y - row[1]
        outside_x = max(0.0, abs(dx * row[2] + dy * row[3]) - row[4])
        outside_y = max(0.0, abs(dy * row[2] - dx * row[3]) - row[5])
        if np.hypot(outside_x, outside_y) < margin:
            return False
    return True


def rug_height(room: SyntheticRoom, x: float, y: float) -> float:
    """Height in m of what lies flat on the floor at a place, 0.0 on the bare floor: there stands what stands."""
    tops = [0.0]
    for s in room.solids:
        if s.top <= _FLAT_M:
            cos, sin, dx, dy = np.cos(s.yaw), np.sin(s.yaw), x - s.x, y - s.y
            if abs(dx * cos + dy * sin) <= s.size_x / 2 and abs(dy * cos - dx * sin) <= s.size_y / 2:
                tops.append(s.top)
    return max(tops)


def floor_map(
    room: SyntheticRoom,
    T_world_camera: NDArray[np.float64],
    cell_m: float = 0.05,
    forward_m: tuple[float, float] = (0.0, 6.0),
    right_m: tuple[float, float] = (-3.0, 3.0),
    lowest_m: float = 0.02,
    highest_m: float = 2.0,
) -> FloorMap:
    """Return the true floor map around a camera; see `FloorMap` for its axes.

    A cell is occupied when any part of it lies under a solid between `lowest_m` and `highest_m`, on a wall
    or outside the room.
    """
    rows, columns = (round((hi - lo) / cell_m) for lo, hi in (forward_m, right_m))
    forward = T_world_camera[:2, 2] / np.linalg.norm(T_world_camera[:2, 2])
    axes = np.array([forward, [forward[1], -forward[0]]])
    foot = T_world_camera[:2, 3]
    boxes = footprints(room.solids, lowest_m, highest_m)
    starts = room.corners
    walls = np.concatenate([starts, np.roll(starts, -1, axis=0)], axis=1)
    cells = np.zeros((rows, columns), np.uint8)
    height = np.zeros((rows, columns), np.float32)
    _fill(cells, height, foot, axes, forward_m[0], right_m[0], cell_m, boxes, walls, room.floor_parts)
    return FloorMap(cells, height, cell_m, forward_m[0], right_m[0])


@njit(cache=True, nogil=True)
def _apart(cx, cy, a0, a1, b0, b1, half, x, y, c, s, hx, hy):  # type: ignore[no-untyped-def]
    """Whether a square cell (axes a, b) and a turned rectangle are apart: separating axis theorem."""
    dx, dy = x - cx, y - cy
    ca, cb = abs(c * a0 + s * a1), abs(c * b0 + s * b1)
    sa, sb = abs(-s * a0 + c * a1), abs(-s * b0 + c * b1)
    if abs(dx * a0 + dy * a1) >= half + hx * ca + hy * sa:
        return True
    if abs(dx * b0 + dy * b1) >= half + hx * cb + hy * sb:
        return True
    if abs(dx * c + dy * s) >= hx + half * (ca + cb):
        return True
    return abs(dy * c - dx * s) >= hy + half * (sa + sb)


@njit(cache=True, nogil=True)
def _fill(cells, height, foot, axes, f0, r0, cell, boxes, walls, parts):  # type: ignore[no-untyped-def]
    a0, a1, b0, b1 = axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1]
    half = cell / 2
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            f, r = f0 + (i + 0.5) * cell, r0 + (j + 0.5) * cell
            x, y = foot[0] + f * a0 + r * b0, foot[1] + f * a1 + r * b1
            inside = False
            for k in range(parts.shape[0]):
                if parts[k, 0] <= x <= parts[k, 2] and parts[k, 1] <= y <= parts[k, 3]:
                    inside = True
            for k in range(walls.shape[0]):
                wx, wy = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
                n = np.sqrt(wx * wx + wy * wy)
                mx, my = (walls[k, 0] + walls[k, 2]) / 2, (walls[k, 1] + walls[k, 3]) / 2
                if not _apart(x, y, a0, a1, b0, b1, half, mx, my, wx / n, wy / n, n / 2, 0.0):
                    inside = False
            if not inside:
                cells[i, j], height[i, j] = 1, np.inf
                continue
            for k in range(boxes.shape[0]):
                if not _apart(x, y, a0, a1, b0, b1, half, boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3],
                              boxes[k, 4], boxes[k, 5]):  # fmt: skip
                    cells[i, j] = 1
                    height[i, j] = max(height[i, j], boxes[k, 6])
