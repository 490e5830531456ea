"""The slow obvious twin of what hides floor below level things: pixel by pixel, in Python."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.floor.floor_pixels import FLYING_PIXEL, NOTHING, OBSTACLE_PIXEL
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import CLUTTER, FLOOR

Ray = NDArray[np.float64]
"""Ahead, to the left and up in the room, per metre of depth."""


@dataclass
class Thing:
    """What a column follows: heights of its first and last pixel, distances of the first, reached, and from where
    without depth.
    """

    begin: float
    lowest: float
    height: float
    reached: float
    depth_m: float
    underside: float = np.inf
    lost_from: float | None = None
    wide: bool = False
    deep: float | None = None
    pixels: int = 1


def naive_below(
    inverse: NDArray[np.float32],
    kind: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T: NDArray[np.float64],
    corner: tuple[float, float, float],
    shape: tuple[int, int],
) -> NDArray[np.bool_]:
    """(rows, cols) bool: cells over which two columns of the picture, whose down is down, tell of a thing."""
    columns: dict[tuple[int, int], set[int]] = defaultdict(set)
    stands = float(-T[:3, 2] @ T[:3, 3])

    def ray(u: int, v: int) -> Ray:
        return np.asarray(T[:3, :3].T @ ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0))

    def mark(u: int, way: Ray, near: float, far: float) -> None:
        toward = way[:2] / np.hypot(*way[:2])
        for r in np.linspace(near, far, int(2 * abs(far - near) / corner[2]) + 2):
            j, i = (int(np.floor(c)) for c in (toward * r - corner[:2]) / corner[2])
            if 0 <= i < shape[0] and 0 <= j < shape[1]:
                columns[i, j].add(u)

    behind = np.zeros(camera.width)
    """How far behind the first pixel of what each column followed last a thing below it ended."""

    def run(u: int, v: int, strays: int = 0) -> tuple[int, int]:
        """First and last column of what is joined in a row."""

        def joined(a: int, b: int) -> bool:
            both = kind[v, a] == OBSTACLE_PIXEL and kind[v, b] == OBSTACLE_PIXEL
            return bool(both and abs(1 / inverse[v, a] - 1 / inverse[v, b]) < corner[2])

        left = right = u
        while to_left := [k for k in range(left - 1, left - 2 - strays, -1) if k >= 0 and joined(left, k)]:
            left = to_left[0]
        while to_right := [k for k in range(right + 1, right + 2 + strays) if k < camera.width and joined(right, k)]:
            right = to_right[0]
        return left, right

    def width(left: int, right: int, w: float) -> float:
        return (right - left + 1) / camera.fx / w

    def is_wide(u: int, v: int) -> bool:
        left, right = run(u, v)
        return width(left, right, float(inverse[v, u])) * 2 ** ((left == 0) + (right == camera.width - 1)) >= 0.8

    def how_deep(u: int, v: int) -> float:
        left, right = run(u, v)
        wide = width(left, right, float(inverse[v, u]))
        deep = max(1.2, 2.0 * wide) if 0.6 <= wide <= 1.0 else 1.2
        left, right = run(u, v, strays=2)
        at = left + np.flatnonzero(behind[left : right + 1] > 0.0)
        legs = [leg for leg in np.split(at, np.flatnonzero(np.diff(at) > 3) + 1) if len(leg)]
        pixels_per_m = camera.fx * float(inverse[v, u])
        narrow = [behind[leg].max() for leg in legs if leg[-1] - leg[0] + 1 <= 0.15 * pixels_per_m]
        found = [far + 0.2 for far in narrow if far <= 2.0]
        return max([deep, *found])

    def leave(thing: Thing | None, u: int, way: Ray, beyond: float) -> None:
        if thing is None or thing.pixels < 2 or min(thing.height, thing.lowest) < 0.12 or beyond < thing.reached:
            return
        thin = thing.height - thing.lowest < 0.1
        front = thing.lowest < stands and thing.wide
        deep = 2.0 if front and thing.lowest < 0.4 else (thing.deep or 1.2) if thin else 0.9 if front else 0.1
        far = thing.reached + deep
        if way[2] < -1e-6 and thing.height < stands:
            far = min(far, np.hypot(*way[:2]) * (thing.height - stands) / way[2])
        if thing.lowest > stands:
            far = min(far, thing.underside)
        mark(u, way, thing.reached, min(far, beyond))

    def leave_picture(thing: Thing, u: int) -> None:
        if thing.pixels < 2 or thing.lost_from is not None or min(thing.height, thing.lowest) < 0.12:
            return
        seen = thing.begin - thing.reached
        if thing.wide and thing.lowest < stands:
            mark(u, ray(u, 0), thing.reached, thing.reached + 0.9)
        elif thing.height - thing.lowest < 0.1 and seen > 0:
            mark(u, ray(u, 0), max(thing.reached - min(0.6, 6 * seen), 0.0), thing.reached)

    def meet(thing: Thing | None, u: int, v: int) -> Thing:
        way, depth = ray(u, v), 1.0 / float(inverse[v, u])
        before = thing
        r, h = float(np.hypot(*way[:2])) * depth, stands + way[2] * depth
        if thing is not None:
            closer = thing.lost_from is None and abs(depth - thing.depth_m) < 0.5 * corner[2]
            if closer and v % 16 == 0 and thing.lowest >= 0.12:
                thing.wide = thing.wide or is_wide(u, v)
            if closer and thing.lowest >= 0.12 and thing.deep is None:
                thing.deep = how_deep(u, v)
            below, step = ray(u, v + 1), 0.0
            if way[2] < -1e-6 and h < stands - 1e-6:
                step = min(1.5 * (r - float(np.hypot(*below[:2])) * (h - stands) / below[2]), 1.8)
            near = r > thing.reached - 0.1
            if thing.lost_from is None:
                near = thing.reached - 0.5 < r < thing.reached + max(0.5, step)
            if not closer and not (near and abs(h - thing.height) < 0.08):
                leave(thing, u, way, r)
                thing = None
        if thing is None:
            behind[u] = ends_behind(before, r, h)
            thing, under = Thing(r, h, h, r, depth), v + 1
            while under < camera.height and inverse[under, u] <= 0 and labels[under, u] != FLOOR:
                under += 1
            below = ray(u, under)
            if h > stands and below[2] > 1e-6:
                thing.underside = float(np.hypot(*below[:2])) * (h - stands) / below[2]
        else:
            thing.pixels += 1
            if h >= 0.12:
                mark(u, way, thing.reached, r)
        thing.height, thing.reached, thing.depth_m, thing.lost_from = h, r, depth, None
        return thing

    def ends_behind(thing: Thing | None, r: float, h: float) -> float:
        if thing is None or thing.pixels < 2 or h - thing.lowest < 0.2:
            return 0.0
        return max((thing.reached if thing.lost_from is None else thing.lost_from) - r, 0.0)

    def may_be_its(label: int, thing: Thing) -> bool:
        return label == CLUTTER or (label != FLOOR and thing.height - thing.lowest < 0.1)

    def go_on(thing: Thing, u: int, way: Ray) -> Thing | None:
        if thing.height < 0.12 or thing.pixels < 2:
            return None
        thing.lost_from = thing.reached if thing.lost_from is None else thing.lost_from
        r = float(np.hypot(*way[:2])) * (thing.height - stands) / way[2] if way[2] < -1e-6 else -1.0
        if not 0 < r < thing.lost_from + 1.5:
            mark(u, way, thing.reached, thing.lost_from + 1.2)
            return None
        mark(u, way, thing.reached, max(r, thing.reached))
        thing.reached = max(r, thing.reached)
        return thing

    things: list[Thing | None] = [None] * camera.width
    for v, u in product(range(camera.height - 1, -1, -1), range(camera.width)):
        thing, w, way = things[u], float(inverse[v, u]), ray(u, v)
        flies = kind[v, u] == FLYING_PIXEL
        higher = kind[v, u] == NOTHING and w > 0 and thing is not None and thing.lost_from is None
        if higher and thing is not None:
            higher = abs(1 / w - thing.depth_m) < 0.5 * corner[2]
        if kind[v, u] == OBSTACLE_PIXEL or higher:
            things[u] = meet(thing, u, v)
        elif thing is not None and (w <= 0 or flies) and may_be_its(int(labels[v, u]), thing):
            things[u] = go_on(thing, u, way)
        elif thing is not None:
            leave(thing, u, way, float(np.hypot(*way[:2])) / w if w > 0 and not flies else np.inf)
            things[u] = None
    for u, thing in enumerate(things):
        if thing is not None:
            leave_picture(thing, u)
    hidden = np.zeros(shape, np.bool_)
    for cell, seen_by in columns.items():
        hidden[cell] = len(seen_by) > 1
    begun, beside = hidden.copy(), round(0.3 / corner[2])
    for (i, j), seen_by in columns.items():
        if begun[i, j] and 0 in seen_by:
            hidden[i : i + beside + 1, j] = True
        if begun[i, j] and camera.width - 1 in seen_by:
            hidden[max(i - beside, 0) : i + 1, j] = True
    return hidden
