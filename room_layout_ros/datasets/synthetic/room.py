"""Empty rooms: cuboids, L shapes, sloped ceilings, an open door into the next room."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .shading import Light
from .shapes import Material, Solid, Surface

KINDS = ("cuboid", "l_shape", "pillar", "sloped", "open_door")
WALL, FLOOR, CEILING, DOOR, OTHER_STRUCTURE = 1, 2, 22, 8, 38

Point = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SyntheticRoom:
    """A furnished room; what the ray caster sees and what is true of it.

    Attributes
    ----------
    kind : one of `KINDS`.
    corners : (n, 2) float64 floor polygon, counter-clockwise, edges parallel to x or y.
    floor_parts : (m, 4) float64 rectangles x0, y0, x1, y1 that make up the floor.
    height : of the walls (of the lowest wall under a sloped ceiling).
    shell : the closed empty room, normals outward: what the layout is made of.
    structure : what is seen of it: walls with openings, doors, windows, the room behind an open door.
    solids : everything that stands in it.
    light : lamps.
    """

    kind: str
    corners: Point
    floor_parts: Point
    height: float
    shell: tuple[Surface, ...]
    structure: tuple[Surface, ...]
    solids: tuple[Solid, ...]
    light: Light

    @property
    def is_cuboid(self) -> bool:
        """Whether the shell has four walls and a level ceiling."""
        return self.kind in ("cuboid", "pillar", "open_door")

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Everything the rays can hit."""
        return self.structure + tuple(surface for solid in self.solids for surface in solid.surfaces())

    def furnished(self, solids: tuple[Solid, ...]) -> SyntheticRoom:
        """Return the room with these solids added."""
        return replace(self, solids=self.solids + solids)

    def wall(self, i: int) -> tuple[Point, Point]:
        """Return start and end of wall `i`; the room lies to its left."""
        return self.corners[i], self.corners[(i + 1) % len(self.corners)]


@dataclass(frozen=True, slots=True)
class Decoration:
    """Materials of the shell: one per wall."""

    walls: tuple[Material, ...]
    floor: Material
    ceiling: Material


def wall_piece(start: Point, end: Point, s0: float, s1: float, t0: float, t1: float,
               nyu40: int, material: Material, patch: bool = False) -> Surface:  # fmt: skip
    """Return the part s0..s1 along and t0..t1 up of the wall from `start` to `end`, normal outward."""
    along = (end - start) / np.linalg.norm(end - start)
    origin = np.append(start + along * s0, t0)
    return Surface(origin, np.append(along * (s1 - s0), 0.0), np.array([0, 0, t1 - t0]), nyu40, material, patch=patch)


def _level(part: Point, z: float, nyu40: int, material: Material) -> Surface:
    """Return a floor (normal down) or a ceiling (normal up)."""
    x0, y0, x1, y1 = part
    ex, ey = np.array([x1 - x0, 0.0, 0.0]), np.array([0.0, y1 - y0, 0.0])
    u, v = (ey, ex) if nyu40 == FLOOR else (ex, ey)
    return Surface(np.array([x0, y0, z]), u, v, nyu40, material)


def cuboid_corners(length: float, width: float) -> tuple[Point, Point]:
    """Return corners and floor parts of a rectangular room around the origin."""
    x, y = length / 2, width / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), np.array([[-x, -y, x, y]])


def l_corners(length: float, width: float, cut_x: float, cut_y: float) -> tuple[Point, Point]:
    """Return corners and floor parts of a rectangle whose +x +y corner of cut_x by cut_y is missing."""
    x, y = length / 2, width / 2
    corners = [[-x, -y], [x, -y], [x, y - cut_y], [x - cut_x, y - cut_y], [x - cut_x, y], [-x, y]]
    return np.array(corners), np.array([[-x, -y, x, y - cut_y], [-x, y - cut_y, x - cut_x, y]])


def empty_room(kind: str, corners: Point, parts: Point, height: float, look: Decoration, light: Light,
               slope_m: float = 0.0) -> SyntheticRoom:  # fmt: skip
    """Build a room without openings or furniture.

    Parameters
    ----------
    slope_m : how much higher the ceiling is at the +y side ("sloped" only).

    Raises
    ------
    ValueError
        When the kind is unknown.
    """
    if kind not in KINDS:
        raise ValueError(f"room kind is {kind!r}; allowed are {', '.join(KINDS)}")
    surfaces = []
    for i in range(len(corners)):
        start, end = corners[i], corners[(i + 1) % len(corners)]
        length = float(np.linalg.norm(end - start))
        # Under a slope the walls run up behind the ceiling: it hides what is too high.
        surfaces.append(wall_piece(start, end, 0.0, length, 0.0, height + slope_m, WALL, look.walls[i]))
    for part in parts:
        surfaces.append(_level(part, 0.0, FLOOR, look.floor))
        ceiling = _level(part, height, CEILING, look.ceiling)
        surfaces.append(replace(ceiling, v=ceiling.v + np.array([0.0, 0.0, slope_m])))
    shell = tuple(surfaces)
    return SyntheticRoom(kind, corners, parts, height, shell, shell, (), light)


def hang(room: SyntheticRoom, wall: int, s: float, t: float, width: float, height: float,
         nyu40: int, material: Material) -> SyntheticRoom:  # fmt: skip
    """Hang a door, window or picture flat on a wall; s along the wall, t up, of its lower corner."""
    piece = wall_piece(*room.wall(wall), s, s + width, t, t + height, nyu40, material, patch=True)
    return replace(room, structure=(*room.structure, piece))


def open_door(room: SyntheticRoom, wall: int, s: float, look: Decoration, depth: float,
              width: float = 0.95, height: float = 2.05) -> SyntheticRoom:  # fmt: skip
    """Cut an open door into a wall and put another room behind it."""
    start, end = room.wall(wall)
    length, material = float(np.linalg.norm(end - start)), room.structure[wall].material
    pieces = [
        wall_piece(start, end, 0.0, s, 0.0, room.height, WALL, material),
        wall_piece(start, end, s + width, length, 0.0, room.height, WALL, material),
        wall_piece(start, end, s, s + width, height, room.height, WALL, material),
    ]
    along = (end - start) / length
    outward = np.array([along[1], -along[0]])
    # The next room starts at a wall thickness behind; reveals and threshold close the gap.
    left, right = start + along * (s - 1.0), start + along * (s + width + 1.0)
    jamb, far = outward * 0.12, outward * depth
    quad = np.array([left + jamb, left + far, right + far, right + jamb])
    for a, b in ((0, 1), (1, 2), (2, 3)):
        pieces.append(wall_piece(quad[a], quad[b], 0.0, float(np.linalg.norm(quad[b] - quad[a])), 0.0, room.height,
                                 WALL, look.walls[a % len(look.walls)]))  # fmt: skip
    lows, highs = quad.min(axis=0), quad.max(axis=0)
    part = np.array([*lows, *highs])
    pieces += [_level(part, 0.0, FLOOR, look.floor), _level(part, room.height, CEILING, look.ceiling)]
    frame = Material((214, 208, 196))
    for where in (s, s + width):
        foot = start + along * where
        pieces.append(wall_piece(foot, foot + jamb, 0.0, 0.12, 0.0, height, DOOR, frame))
    sill = np.array([start + along * s, start + along * (s + width) + jamb])
    part = np.array([*sill.min(axis=0), *sill.max(axis=0)])
    pieces += [_level(part, 0.0, FLOOR, look.floor), _level(part, height, DOOR, frame)]
    kept = room.structure[:wall] + room.structure[wall + 1 :]
    return replace(room, kind="open_door", structure=kept + tuple(pieces))


def pillar(room: SyntheticRoom, x: float, y: float, side: float, material: Material) -> SyntheticRoom:
    """Put a pillar from floor to ceiling; its class is other structure, clutter by definition."""
    return replace(room, kind="pillar").furnished(
        (Solid(x, y, 0.0, side, side, 0.0, room.height, OTHER_STRUCTURE, material, thing=1000),)
    )
