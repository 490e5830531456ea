"""Things of another making than `datasets/synthetic`, and the scene that they are put into; world frame, metres.

A room lies at 0 <= x <= length_m, 0 <= y <= width_m with the floor at z = 0. The camera stands near x = 0 and looks
along x, so y = 0 is the right wall. Every thing is 5 cm or higher.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks import _ray_caster as rc

Vector = Sequence[float] | NDArray[np.float64]
Rotation = NDArray[np.float64]
Place = tuple[float, float, float]
"""x, y and yaw."""


@dataclass(frozen=True, slots=True)
class Look:
    color: tuple[float, ...] = (0.6, 0.6, 0.6)
    pattern: int = rc.PLAIN
    role: int = rc.THING
    optics: int = rc.MATTE


DARK, PALE, STEEL = Look((0.1, 0.1, 0.1)), Look((0.88, 0.88, 0.86)), Look((0.3, 0.3, 0.3))
CLEAR_GLASS, SILVERED = Look(role=rc.WALL, optics=rc.GLASS), Look(role=rc.WALL, optics=rc.MIRROR)
OF_CEILING = replace(PALE, role=rc.CEILING)
_FLOORS = (
    Look((0.5, 0.36, 0.24), rc.PLANKS, rc.FLOOR),
    Look((0.62, 0.6, 0.58), rc.TILES, rc.FLOOR),
    Look((0.45, 0.45, 0.48), rc.CARPET, rc.FLOOR),
    Look((0.36, 0.3, 0.26), rc.PLANKS, rc.FLOOR),
    Look((0.5, 0.5, 0.5), rc.PLAIN, rc.FLOOR),
)
_WALLS = ((0.78, 0.76, 0.72), (0.7, 0.72, 0.75), (0.62, 0.68, 0.62), (0.85, 0.85, 0.85), (0.72, 0.6, 0.52))


@dataclass
class Scene:
    """A room that is being furnished; metres and radians.

    Attributes
    ----------
    rng : chance. half_view : half the camera's horizontal field of view. floor_from_m : so far from the camera's foot
        the lower edge of the picture meets the floor. eye, yaw : where the camera stands and looks.
    is_cuboid : whether the empty room is a cuboid, with a layout. names : of the things, by index.
    """

    rng: np.random.Generator
    half_view: float
    floor_from_m: float
    is_cuboid: bool = True
    names: list[str] = field(default_factory=list)
    _rows: list[tuple[object, ...]] = field(default_factory=list)
    _used: list[tuple[float, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.length_m, self.width_m, self.height_m = (self.between(*r) for r in ((4.0, 6.5), (3.2, 5.5), (2.4, 3.0)))
        self.eye = np.array([self.between(0.35, 0.65), self.width_m * self.between(0.3, 0.7)])
        self.yaw = self.between(-0.3, 0.3)
        self.floor = _FLOORS[self.rng.integers(len(_FLOORS))]
        self.wall = Look(_WALLS[self.rng.integers(len(_WALLS))], rc.PLAIN, rc.WALL)

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def maybe(self, chance: float = 0.5) -> bool:
        return bool(self.rng.random() < chance)

    def paint(self, pattern: int = rc.PLAIN, low: float = 0.15, high: float = 0.9) -> Look:
        """Return a look of a colour between two levels of brightness."""
        return Look(tuple(0.5 * (self.rng.uniform(low, high, 3) + self.rng.uniform(low, high))), pattern)

    def ahead(self) -> float:
        """Return an x before which some floor is in the picture: without it nothing tells on what the camera stands."""
        return min(self.eye[0] + max(1.2, self.floor_from_m + 0.4) + self.between(0.0, 1.4), self.length_m - 0.8)

    def lamp(self) -> NDArray[np.float64]:
        """(4,) place and power of the only lamp."""
        x, y = self.length_m * self.between(0.3, 0.7), self.width_m * self.between(0.3, 0.7)
        return np.array([x, y, self.height_m - 0.05, self.between(2.2, 3.5)])

    def solids(self) -> rc.Solids:
        return rc.Solids(*(np.array(column) for column in zip(*self._rows, strict=True)))

    def add(self, shape: int, centre: Vector, half: Vector, R: Rotation, look: Look) -> None:
        """Add a part of the thing begun last; columns of R are its axes in the world."""
        row = shape, np.array(centre, float), np.ascontiguousarray(R.T), np.array(half, float), np.linalg.norm(half)
        look_of_it = look.role, look.optics, np.array(look.color), look.pattern, int(self.rng.integers(1, 1000))
        self._rows.append((*row, *look_of_it, len(self.names) - 1))

    def thing(self, name: str, place: Place = (0.0, 0.0, 0.0)) -> Part:
        """Begin a thing; its parts are placed in its own frame."""
        self.names.append(name)
        return Part(self, place)

    def place(self, radius_m: float, near_m: float = 0.9, far_m: float = 3.2) -> Place | None:
        """Find a place in view that is free and inside the room."""
        for _ in range(200):
            distance, bearing = self.between(near_m, far_m), self.yaw + self.between(-0.85, 0.85) * self.half_view
            x, y = self.eye + distance * np.array([np.cos(bearing), np.sin(bearing)])
            inside = min(x, y, self.length_m - x, self.width_m - y) > radius_m + 0.03
            apart = all(np.hypot(x - a, y - b) > radius_m + r + 0.05 for a, b, r in self._used)
            if inside and apart and distance > radius_m + 0.45:
                self._used.append((x, y, radius_m))
                return float(x), float(y), self.between(0.0, 2 * np.pi)
        return None


@dataclass(frozen=True, slots=True)
class Part:
    """Puts solids into a scene, in the frame of one thing: x, y from its middle, turned with it; z from the floor."""

    scene: Scene
    at: Place

    def world(self, x: float, y: float, z: float) -> NDArray[np.float64]:
        return rotation(self.at[2]) @ [x, y, z] + [self.at[0], self.at[1], 0.0]

    def box(
        self, x: float, y: float, low: float, high: float, long: float, wide: float, look: Look, yaw: float = 0.0
    ) -> None:
        centre, half = self.world(x, y, (low + high) / 2), (long / 2, wide / 2, (high - low) / 2)
        self.scene.add(rc.BOX, centre, half, rotation(self.at[2] + yaw), look)

    def post(self, x: float, y: float, low: float, high: float, radius: float, look: Look) -> None:
        centre = self.world(x, y, (low + high) / 2)
        self.scene.add(rc.CYLINDER, centre, (radius, radius, (high - low) / 2), np.eye(3), look)

    def rod(self, start: Sequence[float], end: Sequence[float], radius: float, look: Look) -> None:
        a, b = self.world(*start), self.world(*end)
        along = (b - a) / np.linalg.norm(b - a)
        across = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        R = np.column_stack([across, np.cross(along, across), along])
        self.scene.add(rc.CYLINDER, (a + b) / 2, (radius, radius, float(np.linalg.norm(b - a)) / 2), R, look)

    def egg(self, x: float, y: float, z: float, radii: Sequence[float], look: Look) -> None:
        self.scene.add(rc.ELLIPSOID, self.world(x, y, z), radii, rotation(self.at[2]), look)

    def legs(self, long: float, wide: float, high: float, thick: float, look: Look) -> None:
        for i in (-0.5, 0.5):
            for j in (-0.5, 0.5):
                self.box(i * (long - thick), j * (wide - thick), 0, high, thick, thick, look)


def rotation(yaw: float) -> Rotation:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def round_table(s: Scene, at: Place) -> None:
    part, radius, high = s.thing("round table", at), s.between(0.3, 0.6), s.between(0.45, 0.76)
    part.post(0, 0, high - 0.03, high, radius, s.paint())
    part.post(0, 0, 0.03, high - 0.03, s.between(0.025, 0.05), STEEL)
    part.post(0, 0, 0, 0.03, radius * s.between(0.4, 0.7), STEEL)


def table(s: Scene, at: Place) -> None:
    part, look, long, wide, high = s.thing("table", at), s.paint(), s.between(1, 1.8), s.between(0.6, 0.9), 0.72
    part.box(0, 0, high - 0.03, high, long, wide, look)
    part.legs(long - 0.05, wide - 0.05, high - 0.03, 0.05, look)


def chair(s: Scene, at: Place) -> None:
    part, look, wide, seat = s.thing("chair", at), s.paint(), s.between(0.38, 0.46), s.between(0.43, 0.48)
    part.box(0, 0, seat - 0.03, seat, wide, wide, look)
    part.legs(wide, wide, seat - 0.03, 0.03, look)
    for side in (-0.5, 0.5):
        part.box(-0.5 * wide + 0.015, side * (wide - 0.03), seat, 0.9, 0.03, 0.03, look)
    for low in (0.6, 0.75):
        part.box(-0.5 * wide + 0.015, 0, low, low + 0.08, 0.02, wide - 0.03, look)


def swivel_chair(s: Scene, at: Place) -> None:
    part, look, seat = s.thing("swivel chair", at), s.paint(rc.CARPET, 0.05, 0.5), s.between(0.42, 0.52)
    for angle in np.arange(5) * 2 * np.pi / 5:
        x, y = 0.3 * np.cos(angle), 0.3 * np.sin(angle)
        part.rod((0, 0, 0.11), (x, y, 0.075), 0.02, DARK)
        part.egg(x, y, 0.03, (0.03, 0.03, 0.03), DARK)
    part.post(0, 0, 0.08, seat - 0.06, 0.03, STEEL)
    part.egg(0, 0, seat - 0.02, (0.25, 0.25, 0.05), look)
    part.rod((0, 0, seat - 0.04), (0.25, 0, seat), 0.015, DARK)
    part.rod((0.25, 0, seat), (0.25, 0, seat + 0.2), 0.015, DARK)
    part.egg(0.25, 0, seat + 0.35, (0.05, 0.21, 0.26), look)


def bin_(s: Scene, at: Place) -> None:
    s.thing("bin", at).post(0, 0, 0, s.between(0.2, 0.4), s.between(0.09, 0.16), s.paint())


def ball(s: Scene, at: Place) -> None:
    radius = s.between(0.025, 0.125)
    s.thing("ball", at).egg(0, 0, radius, (radius, radius, radius), s.paint())


def bottle(s: Scene, at: Place) -> None:
    part, radius, look = s.thing("lying bottle", at), s.between(0.025, 0.035), s.paint()
    part.rod((-0.11, 0, radius), (0.08, 0, radius), radius, look)
    part.rod((0.08, 0, radius), (0.14, 0, radius), 0.014, look)


def shoe(s: Scene, at: Place) -> None:
    part, look = s.thing("shoe", at), s.paint()
    part.egg(0, 0, 0.035, (0.14, 0.05, 0.035), look)
    part.egg(-0.07, 0, 0.055, (0.065, 0.042, 0.05), look)


def carton(s: Scene, at: Place) -> None:
    s.thing("carton", at).box(0, 0, 0, s.between(0.1, 0.8), s.between(0.2, 0.6), s.between(0.2, 0.6), s.paint())


def shelf(s: Scene, at: Place) -> None:
    part, look, boards = s.thing("shelf", at), s.paint(), int(s.rng.integers(3, 6))
    wide, deep, high = s.between(0.7, 1.1), s.between(0.28, 0.38), s.between(1.2, 2.0)
    for side in (-0.5, 0.5):
        part.box(0, side * (wide - 0.02), 0, high, deep, 0.02, look)
    for z in np.linspace(0.06, high - 0.02, boards):
        part.box(0, 0, z, z + 0.02, deep, wide - 0.02, look)
        y = -0.5 * wide + 0.05
        while z < high - 0.3 and y < 0.5 * wide - 0.1:
            thick = s.between(0.02, 0.05)
            if s.maybe(0.6):
                part.box(s.between(-0.05, 0.05), y, z + 0.02, z + s.between(0.15, 0.22), 0.6 * deep, thick, s.paint())
            y += thick + 0.005


def sofa(s: Scene, at: Place) -> None:
    part, look = s.thing("sofa", at), s.paint(rc.CARPET)
    wide, gap = s.between(1.2, 1.9), s.between(0.08, 0.15)
    part.box(0, 0, gap, 0.42, 0.8, wide, look)
    part.box(-0.3, 0, 0.42, 0.8, 0.2, wide, look)
    for side in (-0.5, 0.5):
        part.rod((-0.4, side * wide, 0.52), (0.4, side * wide, 0.52), 0.12, look)
        part.box(0, side * wide, gap, 0.52, 0.8, 0.2, look)
    part.legs(0.74, wide - 0.06, gap, 0.05, DARK)


def bed(s: Scene, at: Place) -> None:
    part, wood, wide = s.thing("bed", at), s.paint(), s.between(0.9, 1.5)
    gap = float(s.rng.choice([0.0, 0.12, 0.25]))
    part.box(0, 0, gap, 0.3, 2.0, wide, wood)
    part.box(0, 0, 0.3, 0.5, 1.96, wide - 0.04, s.paint(rc.CARPET, 0.4))
    part.egg(0.75, 0, 0.53, (0.2, 0.35 * wide, 0.09), PALE)
    part.box(1.0, 0, 0, s.between(0.7, 1.0), 0.05, wide, wood)
    if gap:
        part.legs(1.94, wide, gap, 0.06, wood)


def person(s: Scene, at: Place) -> None:
    part, skin, trousers, shirt = (
        s.thing("person", at),
        Look((0.75, 0.55, 0.45)),
        s.paint(rc.CARPET),
        s.paint(rc.CARPET),
    )
    stride = s.between(0.0, 0.25)
    for side in (-1, 1):
        x, y = side * stride, side * 0.12
        part.rod((x, y, 0.08), (0, side * 0.1, 0.88), 0.065, trousers)
        part.egg(x + 0.06, y, 0.045, (0.13, 0.05, 0.045), DARK)
        hand = s.between(-0.1, 0.3)
        part.rod((0, side * 0.2, 1.4), (hand, side * 0.27, 0.85), 0.04, shirt)
        part.egg(hand, side * 0.27, 0.82, (0.05, 0.05, 0.05), skin)
    part.egg(0, 0, 0.9, (0.15, 0.15, 0.15), trousers)
    part.rod((0, 0, 0.9), (0, 0, 1.4), 0.155, shirt)
    part.egg(0, 0, 1.42, (0.16, 0.16, 0.16), shirt)
    part.egg(0, 0, 1.68, (0.09, 0.08, 0.12), skin)


def column(s: Scene, at: Place) -> None:
    part, thick = s.thing("column", at), s.between(0.2, 0.4)
    if s.maybe():
        part.post(0, 0, 0, s.height_m, thick / 2, replace(s.wall, role=rc.THING))
    else:
        part.box(0, 0, 0, s.height_m, thick, thick, replace(s.wall, role=rc.THING))


def hanging_lamp(s: Scene, at: Place) -> None:
    part, low = s.thing("hanging lamp", at), s.between(1.1, 1.8)
    part.post(0, 0, low, low + 0.25, s.between(0.12, 0.25), Look((1.0, 0.95, 0.8)))
    part.post(0, 0, low + 0.25, s.height_m, 0.006, DARK)


def black_mat(s: Scene, at: Place) -> None:
    look = Look((0.03, 0.03, 0.03), rc.PLAIN, rc.FLOOR, rc.BLACK)
    s.thing("black mat", at).box(0, 0, -0.01, 0.002, s.between(0.4, 0.9), s.between(0.4, 0.9), look)


def black_box(s: Scene, at: Place) -> None:
    look = Look((0.02, 0.02, 0.02), optics=rc.BLACK)
    s.thing("black box", at).box(0, 0, 0, s.between(0.06, 0.3), 0.25, 0.25, look)
