"""Random furnished rooms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .furniture import AT_WALL, FREE_STANDING, Maker, Thing, bookshelf, cabinet, small_object, wardrobe
from .paint import decoration, door_material, picture_material, window_material
from .room import KINDS, SyntheticRoom, cuboid_corners, empty_room, hang, l_corners, open_door, pillar
from .shading import Light
from .shapes import CARPET, Material, Solid, bounds

_GAP_M = 0.02
_WALL_GAP_M = 0.01
Box = tuple[float, float, float, float]


def random_scene(
    rng: np.random.Generator,
    kind: str = "cuboid",
    furniture: float = 1.0,
    wall_clutter: float = 0.0,
    same_color_walls: bool | None = None,
    small_objects: int = 0,
    decorate: bool = True,
) -> SyntheticRoom:
    """Make a room and furnish it.

    Parameters
    ----------
    rng : Generator
        The same state gives the same room.
    kind : str
        One of `room.KINDS`, or "random".
    furniture : float
        How full: 0 is empty, 1 is lived in, 2 is crammed.
    wall_clutter : float
        Share of the area of *every* wall that has something standing right before it, 0..0.6.
    same_color_walls : bool or None
        All walls and the ceiling in one plain colour; None lets chance decide about walls alone.
    small_objects : int
        Things of 3 to 10 cm lying on the floor.
    decorate : bool
        Doors, windows, pictures, rug.

    Raises
    ------
    ValueError
        When an option is out of its range.
    """
    if kind == "random":
        kind = str(rng.choice(KINDS))
    if not 0.0 <= wall_clutter <= 0.6:
        raise ValueError(f"wall_clutter is {wall_clutter}; allowed is 0 to 0.6")
    if not 0.0 <= furniture <= 3.0:
        raise ValueError(f"furniture is {furniture}; allowed is 0 to 3")
    room = _shell(rng, kind, same_color_walls)
    if decorate:
        room = _decorate(rng, room)
    placer = _Placer(room)
    for solid in room.solids:
        placer.taken.append(bounds([solid]))
    if wall_clutter > 0:
        for wall in range(len(room.corners)):
            placer.line_wall(rng, wall, wall_clutter)
    area = float(
        np.sum((room.floor_parts[:, 2] - room.floor_parts[:, 0]) * (room.floor_parts[:, 3] - room.floor_parts[:, 1]))
    )
    for _ in range(round(furniture * area * 0.32)):
        placer.at_wall(rng, AT_WALL)
    for _ in range(round(furniture * area * 0.1)):
        placer.free_standing(rng, FREE_STANDING)
    for _ in range(small_objects):
        placer.free_standing(rng, (small_object,), margin=0.05)
    return room.furnished(tuple(placer.solids))


def _shell(rng: np.random.Generator, kind: str, same_color_walls: bool | None) -> SyntheticRoom:
    length, width, height = rng.uniform(3.6, 6.5), rng.uniform(3.2, 5.2), rng.uniform(2.35, 2.9)
    corners, parts = cuboid_corners(length, width)
    if kind == "l_shape":
        corners, parts = l_corners(length + 1.0, width + 1.0, rng.uniform(1.4, 2.4), rng.uniform(1.3, 2.2))
    look = decoration(rng, len(corners), same_color_walls)
    lamps = [[rng.uniform(-0.8, 0.8), rng.uniform(-0.6, 0.6), height - 0.25, rng.uniform(0.45, 0.75)]]
    if rng.random() < 0.5:
        lamps.append([length / 2 - 0.3, rng.uniform(-1, 1), 1.6, rng.uniform(0.2, 0.45)])
    light = Light(float(rng.uniform(0.5, 0.66)), np.array(lamps))
    base = kind if kind in ("l_shape", "sloped") else "cuboid"
    slope = float(rng.uniform(0.5, 1.2)) if kind == "sloped" else 0.0
    room = empty_room(base, corners, parts, height, look, light, slope)
    if kind == "pillar":
        x, y = rng.uniform(-length / 4, length / 4), rng.uniform(-width / 4, width / 4)
        room = pillar(room, x, y, float(rng.uniform(0.25, 0.45)), look.walls[0])
    if kind == "open_door":
        wall = int(rng.integers(4))
        run = float(np.linalg.norm(room.wall(wall)[1] - room.wall(wall)[0]))
        room = open_door(room, wall, float(rng.uniform(0.4, run - 1.5)), look, float(rng.uniform(2.5, 4.0)))
    return room


def _decorate(rng: np.random.Generator, room: SyntheticRoom) -> SyntheticRoom:
    """Hang doors, windows and pictures; at most one thing to a place."""
    door_done = room.kind == "open_door"
    count = len(room.corners)
    for wall in range(count):
        start, end = room.wall(wall)
        run = float(np.linalg.norm(end - start))
        if run < 1.6:
            continue
        what = rng.choice(["door", "window", "pictures", "nothing"], p=[0.25, 0.3, 0.3, 0.15])
        if what == "door" and not door_done:
            room = hang(room, wall, float(rng.uniform(0.15, run - 1.1)), 0.0, 0.9, 2.05, 8, door_material(rng))
            door_done = True
        elif what == "window":
            wide = float(rng.uniform(0.9, min(2.0, run - 0.5)))
            s = float(rng.uniform(0.2, run - wide - 0.2))
            room = hang(room, wall, s, 0.95, wide, min(1.3, room.height - 1.15), 9, window_material(rng))
        elif what == "pictures":
            for s in np.arange(0.4, run - 1.0, rng.uniform(0.9, 1.6)):
                w, h = rng.uniform(0.3, 0.7, 2)
                room = hang(room, wall, float(s), 1.35, float(w), float(h), 11, picture_material(rng))
    if rng.random() < 0.4:
        room = _rug(rng, room)
    return room


def _rug(rng: np.random.Generator, room: SyntheticRoom) -> SyntheticRoom:
    x0, y0, x1, y1 = room.floor_parts[0]
    r, g, b = (int(v) for v in rng.integers(60, 200, 3))
    cloth = Material((r, g, b), (b, r, g), CARPET, 0.02, seed=int(rng.integers(1 << 20)))
    size_x, size_y = rng.uniform(1.2, 2.0), rng.uniform(0.9, 1.4)
    rug = Solid((x0 + x1) / 2, (y0 + y1) / 2, 0.0, size_x, size_y, 0.0, 0.008, 20, cloth, thing=999)
    return room.furnished((rug,))


class _Placer:
    """Puts things where nothing stands yet; axis-aligned bounds decide."""

    def __init__(self, room: SyntheticRoom) -> None:
        self.room = room
        self.taken: list[Box] = []
        self.solids: list[Solid] = []
        self.things = 0

    def _put(self, thing: Thing, x: float, y: float, yaw: float) -> bool:
        moved = tuple(part.moved(x, y, yaw, self.things) for part in thing)
        box = bounds(moved)
        if not self._inside(box) or any(_overlap(box, other) for other in self.taken):
            return False
        self.taken.append(box)
        self.solids += moved
        self.things += 1
        return True

    def _inside(self, box: Box) -> bool:
        """Whether all corners and edge middles lie over the floor."""
        x0, y0, x1, y1 = box
        parts = self.room.floor_parts
        points = [(x, y) for x in (x0, (x0 + x1) / 2, x1) for y in (y0, (y0 + y1) / 2, y1)]
        return all(
            np.any((parts[:, 0] <= x) & (x <= parts[:, 2]) & (parts[:, 1] <= y) & (y <= parts[:, 3])) for x, y in points
        )

    def _before(self, wall: int, s: float, depth: float) -> tuple[float, float, float]:
        """Return x, y, yaw of a thing of `depth` with its back to the wall, its middle at s along it."""
        start, end = self.room.wall(wall)
        along = (end - start) / np.linalg.norm(end - start)
        inward = np.array([-along[1], along[0]])
        x, y = start + along * s + inward * (depth / 2 + _WALL_GAP_M)
        return float(x), float(y), float(np.arctan2(along[1], along[0]) - np.pi)

    def at_wall(self, rng: np.random.Generator, makers: Sequence[Maker], tries: int = 12) -> None:
        thing = makers[int(rng.integers(len(makers)))](rng)
        x0, y0, x1, y1 = bounds(thing)
        for _ in range(tries):
            wall = int(rng.integers(len(self.room.corners)))
            start, end = self.room.wall(wall)
            run = float(np.linalg.norm(end - start))
            half = (x1 - x0) / 2 + _GAP_M
            if run > 2 * half and self._put(thing, *self._before(wall, rng.uniform(half, run - half), y1 - y0)):
                return

    def free_standing(
        self, rng: np.random.Generator, makers: Sequence[Maker], margin: float = 0.5, tries: int = 12
    ) -> None:
        thing = makers[int(rng.integers(len(makers)))](rng)
        low, high = self.room.corners.min(axis=0) + margin, self.room.corners.max(axis=0) - margin
        for _ in range(tries):
            x, y = rng.uniform(low, high)
            yaw = rng.integers(4) * np.pi / 2 + rng.normal(0, 0.12)
            if self._put(thing, float(x), float(y), float(yaw)):
                return

    def line_wall(self, rng: np.random.Generator, wall: int, share: float) -> None:
        """Stand closed things side by side before a wall until `share` of its area is hidden."""
        start, end = self.room.wall(wall)
        run = float(np.linalg.norm(end - start))
        margin = 0.48  # corners are left to the neighbouring wall's things
        usable, height = run - 2 * margin, self.room.height
        if usable < 0.4:
            return
        wanted = min(usable, share * run / 0.85)
        top = min(0.97, share * run / wanted) * height
        widths = rng.uniform(0.6, 1.0, max(1, round(wanted / 0.85)))
        widths *= wanted / widths.sum()
        gaps = rng.dirichlet(np.ones(len(widths) + 1)) * (usable - wanted)
        s = margin
        for gap, width in zip(gaps, widths, strict=False):
            s += gap + width / 2
            thing = _sized(rng, float(width) - _GAP_M, float(rng.uniform(0.28, 0.42)), top)
            self._put(thing, *self._before(wall, s, bounds(thing)[3] - bounds(thing)[1]))
            s += width / 2


def _sized(rng: np.random.Generator, width: float, depth: float, top: float) -> Thing:
    maker: Maker = (wardrobe, cabinet, bookshelf)[int(rng.integers(3))]
    part = maker(rng)[0]
    return (Solid(0.0, 0.0, 0.0, width, depth, 0.0, top, part.nyu40, part.material, part.front),)


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] + _GAP_M and b[0] < a[2] + _GAP_M and a[1] < b[3] + _GAP_M and b[1] < a[3] + _GAP_M
