"""What a synthetic world is made of: rectangles with a material, and boxes that are six of them.

World frame: x and y level, z up, floor at z = 0, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]
Vector = NDArray[np.float64]

PLAIN, TILES, PLANKS, CARPET, WINDOW, PICTURE, DOOR, STRIPES, SLATS, CABINET, BOOKS, SCREEN = range(12)
"""Patterns; `shading.py` draws them."""

MATTE, SHINY, GLASS = range(3)
"""How a depth sensor sees it: well, with dropouts, hardly."""


@dataclass(frozen=True, slots=True)
class Material:
    """Look of a surface: two colours mixed by a pattern of a size in metres."""

    color: Rgb
    second: Rgb = (0, 0, 0)
    pattern: int = PLAIN
    scale_m: float = 0.3
    sensing: int = MATTE
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Surface:
    """A rectangle.

    Attributes
    ----------
    origin, u, v : (3,) corner and the two edges from it, at right angles; metres.
    nyu40 : class. material : look. thing : index of the object it belongs to, -1 for the room.
    patch : True for what hangs flat on another surface (door leaf, window): it wins where both are level.
    """

    origin: Vector
    u: Vector
    v: Vector
    nyu40: int
    material: Material
    thing: int = -1
    patch: bool = False

    @property
    def normal(self) -> Vector:
        """Unit normal u x v."""
        normal = np.cross(self.u, self.v)
        return np.asarray(normal / np.linalg.norm(normal))


@dataclass(frozen=True, slots=True)
class Solid:
    """A box that stands level, turned about the vertical.

    Attributes
    ----------
    x, y : centre. yaw : of its own x axis. size_x, size_y : full widths. bottom, top : heights.
    front : material of the side towards its -y (cabinet doors, screens); `material` elsewhere.
    """

    x: float
    y: float
    yaw: float
    size_x: float
    size_y: float
    bottom: float
    top: float
    nyu40: int
    material: Material
    front: Material | None = None
    thing: int = -1

    @property
    def axes(self) -> NDArray[np.float64]:
        """(2, 2) rows: unit vectors of its own x and y in the world's plane."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, s], [-s, c]])

    def surfaces(self) -> tuple[Surface, ...]:
        """Return its sides with normals outward; no bottom where it stands on the floor."""
        ex, ey = (np.append(axis, 0.0) for axis in self.axes)
        up = np.array([0.0, 0.0, self.top - self.bottom])
        centre = np.array([self.x, self.y, self.bottom])
        dx, dy = ex * self.size_x, ey * self.size_y
        low = centre - dx / 2 - dy / 2
        make = lambda origin, u, v, material: Surface(origin, u, v, self.nyu40, material, self.thing)  # noqa: E731
        sides = [
            make(low, dx, up, self.front or self.material),
            make(low + dx, dy, up, self.material),
            make(low + dx + dy, -dx, up, self.material),
            make(low + dy, -dy, up, self.material),
            make(low + up, dx, dy, self.material),
        ]
        if self.bottom > 0.001:
            sides.append(make(low, dy, dx, self.material))
        return tuple(sides)

    def moved(self, x: float, y: float, yaw: float, thing: int) -> Solid:
        """Return the box after its object is turned by `yaw` about the origin and moved to (x, y)."""
        c, s = np.cos(yaw), np.sin(yaw)
        return replace(
            self, x=x + c * self.x - s * self.y, y=y + s * self.x + c * self.y, yaw=self.yaw + yaw, thing=thing
        )

    def footprint(self) -> NDArray[np.float64]:
        """(4, 2) corners on the floor."""
        half = self.axes * np.array([[self.size_x], [self.size_y]]) / 2
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.asarray(np.array([self.x, self.y]) + signs @ half)


def bounds(solids: Sequence[Solid]) -> tuple[float, float, float, float]:
    """Return x_min, y_min, x_max, y_max of the footprints."""
    corners = np.concatenate([solid.footprint() for solid in solids])
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    return float(x0), float(y0), float(x1), float(y1)
