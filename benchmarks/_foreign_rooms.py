"""Kinds of scenes with the things of `_foreign_things`, one function each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks import _foreign_things as things
from benchmarks import _ray_caster as rc
from benchmarks._foreign_things import DARK, PALE, Place, Scene

_BEYOND_M = 3.0
"""Depth of the rooms behind open doors."""

Furnish = Callable[[Scene, Place], None]
Pair = tuple[float, float]
"""A place, or from and to."""

_DOOR_M = 2.05
"""Height of openings, which are from and to along a wall."""


def ground(s: Scene, x: Pair, y: Pair, top: float = 0.0, look: things.Look | None = None) -> None:
    part = s.thing("floor")
    part.box(sum(x) / 2, sum(y) / 2, top - 2.0, top, x[1] - x[0], y[1] - y[0], look or s.floor)


def put_wall(s: Scene, start: Pair, end: Pair, openings: Sequence[Pair] = (), skirt: bool = False) -> None:
    """Build a wall, the room on the left of its way from start to end."""
    along = np.subtract(end, start)
    long = float(np.hypot(*along))
    part = s.thing("wall", (*start, float(np.arctan2(along[1], along[0]))))

    def piece(a: float, b: float, low: float) -> None:
        part.box((a + b) / 2, -0.05, low, s.height_m, b - a, 0.1, s.wall)
        if skirt and low < 0:
            part.box((a + b) / 2, 0.006, 0, 0.08, b - a, 0.012, replace(PALE, role=rc.WALL))

    done = -0.1
    for a, b in openings:
        piece(done, a, -2.0)
        piece(a, b, _DOOR_M)
        done = b
    piece(done, long + 0.1, -2.0)


def enclose(
    s: Scene, openings: Sequence[Sequence[Pair]] = ((), (), ()), beyond_m: float = 0.0, skirt: bool = True
) -> None:
    """Build walls and ceiling, with openings of the right, front and left wall; other walls `beyond_m` behind these."""
    x, y = s.length_m, s.width_m
    corners = (0.0, 0.0), (x, 0.0), (x, y), (0.0, y)
    for k in range(4):
        put_wall(s, corners[k], corners[(k + 1) % 4], (*openings, ())[k], skirt)
    out = beyond_m + 0.2
    s.thing("ceiling").box(x / 2, y / 2, s.height_m, s.height_m + 0.1, x + 2 * out, y + 2 * out, things.OF_CEILING)
    if beyond_m:
        corners = (-out, -out), (x + out, -out), (x + out, y + out), (-out, y + out)
        for k in range(4):
            put_wall(s, corners[k], corners[(k + 1) % 4])


def room(s: Scene, rug: bool = True) -> None:
    ground(s, (-0.1, s.length_m + 0.1), (-0.1, s.width_m + 0.1))
    enclose(s)
    if rug and s.maybe():
        x, y = s.eye + s.between(1.2, 2.6) * np.array([np.cos(s.yaw), np.sin(s.yaw)])
        at = float(np.clip(x, 1.0, s.length_m - 1.0)), float(np.clip(y, 1.0, s.width_m - 1.0)), s.between(-0.4, 0.4)
        look = replace(s.paint(rc.CARPET), role=rc.FLOOR)
        s.thing("rug", at).box(0, 0, -0.01, s.between(0.001, 0.008), s.between(0.8, 1.6), s.between(0.6, 1.2), look)


def put(s: Scene, furnish: Furnish, count: int, radius: float, near: float = 0.9) -> None:
    for _ in range(count):
        if at := s.place(radius, near):
            furnish(s, at)


def _some(furnish: Furnish, low: int, high: int, radius: float, near: float = 0.9) -> Callable[[Scene], None]:
    def build(s: Scene) -> None:
        room(s)
        put(s, furnish, int(s.rng.integers(low, high + 1)), radius, near)

    return build


def cut_table(s: Scene) -> None:
    """A table that a side of the picture cuts off."""
    room(s)
    bearing = s.yaw + float(s.rng.choice([-1, 1])) * s.half_view * s.between(0.8, 1.25)
    x, y = s.eye + s.between(0.9, 2.2) * np.array([np.cos(bearing), np.sin(bearing)])
    things.table(s, (float(x), float(np.clip(y, 0.35, s.width_m - 0.35)), s.between(0.0, np.pi)))


def lying_things(s: Scene) -> None:
    room(s)
    put(s, things.bottle, 2, 0.2)
    put(s, things.shoe, 2, 0.2)


def wall_shelves(s: Scene) -> None:
    room(s)
    things.shelf(s, (s.between(1.6, s.length_m - 0.7), 0.2, np.pi / 2))
    things.shelf(s, (s.length_m - 0.2, s.between(0.8, s.width_m - 0.8), np.pi))


def beds(s: Scene) -> None:
    room(s)
    if at := s.place(1.2, 1.6):
        things.bed(s, (*at[:2], float(s.rng.choice([0.0, np.pi / 2]))))


def l_room(s: Scene) -> None:
    """A corner of the room is walled off, or, the other way round, an arm of it goes on behind a corner."""
    room(s)
    s.is_cuboid = False
    long, wide = s.between(1.2, 0.5 * s.length_m), s.between(1.0, 0.45 * s.width_m)
    y = wide / 2 if s.maybe() else s.width_m - wide / 2
    s.thing("wall").box(s.length_m - long / 2, y, -0.1, s.height_m, long, wide, s.wall)
    put(s, things.bin_, 2, 0.16)


def oblique_wall(s: Scene) -> None:
    room(s)
    s.is_cuboid = False
    a, b = s.length_m - s.between(1.0, 2.2), s.between(1.0, 2.2)
    if s.maybe():
        put_wall(s, (a, 0.0), (s.length_m, b))
    else:
        put_wall(s, (s.length_m, s.width_m - b), (a, s.width_m))
    put(s, things.bin_, 2, 0.16)


def corridor(s: Scene) -> None:
    """Open doors on both sides."""
    s.width_m, s.length_m = s.between(1.3, 2.2), s.between(5.0, 8.0)
    s.eye, s.yaw = np.array([0.5, s.width_m * s.between(0.35, 0.65)]), s.between(-0.14, 0.14)
    out = _BEYOND_M + 0.2
    ground(s, (-out, s.length_m + out), (-out, s.width_m + out))
    right, left = ([(a, a + 0.9) for a in (s.between(1.3, 1.8), s.between(3.0, 3.8))] for _ in "rl")
    enclose(s, (right, (), left), _BEYOND_M)
    put(s, things.bin_, 1, 0.16)


def stairs_down(s: Scene) -> None:
    s.is_cuboid = False
    edge, low = s.ahead(), s.between(0.0, 0.3) * s.width_m
    high = low + s.between(0.5, 0.7) * s.width_m
    ground(s, (-0.1, edge), (-0.1, s.width_m + 0.1))
    ground(s, (edge, s.length_m + 0.1), (-0.1, low))
    ground(s, (edge, s.length_m + 0.1), (high, s.width_m + 0.1))
    rise, run = s.between(0.15, 0.19), s.between(0.25, 0.3)
    for k in range(7):
        end = edge + run if k < 6 else s.length_m + 0.1
        ground(s, (edge, end), (low, high), -(k + 1) * rise)
        edge = end
        if edge > s.length_m:
            break
    enclose(s, skirt=False)


def stairs_up(s: Scene) -> None:
    room(s, rug=False)
    start, low = s.ahead(), s.between(0.0, 0.4) * s.width_m
    high = min(low + s.between(0.8, 1.6), s.width_m)
    rise, run, look, part = s.between(0.15, 0.19), s.between(0.25, 0.3), s.paint(), s.thing("stairs")
    for k, x in enumerate(np.arange(start, s.length_m, run)[:10]):
        part.box((x + s.length_m) / 2, (low + high) / 2, k * rise, (k + 1) * rise, s.length_m - x, high - low, look)


def _step(sign: int) -> Callable[[Scene], None]:
    def build(s: Scene) -> None:
        s.is_cuboid = False
        edge, across = s.ahead(), (-0.1, s.width_m + 0.1)
        ground(s, (-0.1, edge), across)
        look = s.floor if s.maybe() else replace(s.paint(), role=rc.FLOOR)
        ground(s, (edge, s.length_m + 0.1), across, sign * s.between(0.06, 0.15), look)
        enclose(s, skirt=False)

    return build


def ramp(s: Scene) -> None:
    room(s, rug=False)
    s.is_cuboid = False
    tilt, start = np.deg2rad(s.between(5.0, 10.0)), s.ahead()
    low, wide = s.between(0.0, 0.4) * s.width_m, s.between(0.9, 1.8)
    long, c, d = s.length_m - start + 0.5, np.cos(tilt), np.sin(tilt)
    R = np.array([[c, 0.0, -d], [0.0, 1.0, 0.0], [d, 0.0, c]])
    s.thing("ramp")
    centre = start + c * long / 2 + d * 0.25, low + wide / 2, d * long / 2 - c * 0.25
    s.add(rc.BOX, centre, (long / 2, wide / 2, 0.25), R, replace(s.floor, role=rc.RAMP))


def glass_door(s: Scene) -> None:
    """Depth goes through it, as far as it is not lost."""
    out = _BEYOND_M + 0.2
    ground(s, (-out, s.length_m + out), (-out, s.width_m + out))
    a = s.width_m * s.between(0.2, 0.4)
    b = a + s.between(0.9, 1.6)
    enclose(s, ((), [(a, b)], ()), _BEYOND_M)
    part, frame = s.thing("glass door"), replace(DARK if s.maybe() else PALE, role=rc.WALL)
    part.box(s.length_m + 0.05, (a + b) / 2, 0.06, 1.99, 0.01, b - a - 0.1, things.CLEAR_GLASS)
    for low, high in ((0.0, 0.06), (1.99, _DOOR_M)):
        part.box(s.length_m + 0.05, (a + b) / 2, low, high, 0.05, b - a, frame)
    for y in (a + 0.025, b - 0.025):
        part.box(s.length_m + 0.05, y, 0, _DOOR_M, 0.05, 0.05, frame)
    put(s, things.bin_, 1, 0.16)


def mirror(s: Scene) -> None:
    room(s)
    low, wide = 0.0 if s.maybe() else s.between(0.3, 0.9), s.between(0.6, 1.6)
    if s.maybe():
        at = s.length_m - 0.01, s.width_m * s.between(0.35, 0.65), np.pi / 2
    else:
        at = s.between(1.8, s.length_m - 1.0), 0.01 if s.maybe() else s.width_m - 0.01, 0.0
    s.thing("mirror", at).box(0, 0, low, 2.0, wide, 0.03, things.SILVERED)
    put(s, things.bin_, 2, 0.16)


def black_things(s: Scene) -> None:
    """They swallow the sensor's light: no depth."""
    room(s)
    put(s, things.black_mat, 1, 0.45)
    put(s, things.black_box, 1, 0.2)
    put(s, things.bin_, 1, 0.16)


def overhang(s: Scene) -> None:
    """A board or a cupboard that hangs on a wall."""
    room(s)
    low, deep, wide = s.between(0.4, 1.5), s.between(0.3, 0.6), s.between(0.8, 1.8)
    high, look = low + float(s.rng.choice([0.03, 0.05, 0.3, 0.6])), s.paint()
    if s.maybe():
        s.thing("overhang").box(s.length_m - deep / 2, s.width_m / 2, low, high, deep, wide, look)
    else:
        y = deep / 2 if s.maybe() else s.width_m - deep / 2
        s.thing("overhang").box(s.between(1.6, s.length_m - 1.2), y, low, high, wide, deep, look)
    put(s, things.bin_, 1, 0.16)


def mixed(s: Scene) -> None:
    room(s)
    large = (things.sofa, 1.0), (things.round_table, 0.6), (things.carton, 0.42), (things.person, 0.35)
    small = (things.swivel_chair, 0.34), (things.chair, 0.32), (things.shoe, 0.2), (things.bin_, 0.16)
    for furnish, radius in (*large, *small, (things.ball, 0.13)):
        if s.maybe(0.7):
            put(s, furnish, 1, radius, 1.0)


KINDS: dict[str, Callable[[Scene], None]] = {
    "empty": room,
    "round tables": _some(things.round_table, 1, 3, 0.6, 1.0),
    "table cut off": cut_table,
    "chairs": _some(things.chair, 2, 4, 0.32),
    "swivel chairs": _some(things.swivel_chair, 1, 3, 0.34),
    "bins": _some(things.bin_, 2, 5, 0.16),
    "balls": _some(things.ball, 3, 7, 0.13),
    "bottles, shoes": lying_things,
    "cartons askew": _some(things.carton, 2, 4, 0.42),
    "shelves at walls": wall_shelves,
    "shelf askew": _some(things.shelf, 1, 1, 0.6, 1.6),
    "sofas askew": _some(things.sofa, 1, 2, 1.0, 1.4),
    "beds": beds,
    "persons": _some(things.person, 1, 2, 0.35, 1.0),
    "columns": _some(things.column, 1, 2, 0.25, 1.0),
    "hanging lamps": _some(things.hanging_lamp, 1, 2, 0.25),
    "overhang": overhang,
    "L-shaped": l_room,
    "oblique wall": oblique_wall,
    "corridor, doors": corridor,
    "stairs down": stairs_down,
    "stairs up": stairs_up,
    "step down": _step(-1),
    "step up": _step(1),
    "ramp": ramp,
    "glass door": glass_door,
    "mirror": mirror,
    "black things": black_things,
    "mixed": mixed,
}
