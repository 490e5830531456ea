"""Furniture from boxes. Each function gives an object at the origin, its back towards +y, facing -y."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .shapes import BOOKS, CABINET, CARPET, PLANKS, SCREEN, SHINY, STRIPES, Material, Rgb, Solid

Thing = tuple[Solid, ...]
Maker = Callable[[np.random.Generator], Thing]

_WOODS: tuple[Rgb, ...] = ((150, 105, 66), (120, 80, 50), (190, 150, 105), (90, 62, 44), (205, 175, 135))
_CLOTHS: tuple[Rgb, ...] = ((70, 90, 130), (130, 60, 60), (95, 110, 80), (160, 150, 135), (60, 60, 66), (185, 165, 120))
_WHITE: Rgb = (228, 226, 220)
_METAL = Material((70, 72, 76), sensing=SHINY)


def _box(
    x: float, y: float, sx: float, sy: float, z0: float, z1: float, nyu40: int, material: Material,
    front: Material | None = None,
) -> Solid:  # fmt: skip
    return Solid(x, y, 0.0, sx, sy, z0, z1, nyu40, material, front)


def _pick(rng: np.random.Generator, colors: tuple[Rgb, ...]) -> Rgb:
    r, g, b = np.clip(np.array(colors[rng.integers(len(colors))]) + rng.integers(-14, 15), 12, 245)
    return int(r), int(g), int(b)


def _wood(rng: np.random.Generator) -> Material:
    color = _pick(rng, _WOODS)
    return Material(color, _darker(color), PLANKS, 0.14, seed=int(rng.integers(1 << 20)))


def _cloth(rng: np.random.Generator) -> Material:
    color = _pick(rng, _CLOTHS)
    return Material(color, _darker(color), CARPET, 0.012, seed=int(rng.integers(1 << 20)))


def _darker(color: Rgb) -> Rgb:
    r, g, b = color
    return int(r * 0.72), int(g * 0.72), int(b * 0.72)


def _legs(sx: float, sy: float, height: float, nyu40: int, material: Material, thick: float = 0.05) -> list[Solid]:
    return [
        _box(i * (sx - thick) / 2, j * (sy - thick) / 2, thick, thick, 0.0, height, nyu40, material)
        for i in (-1, 1)
        for j in (-1, 1)
    ]


def bed(rng: np.random.Generator) -> Thing:
    """Frame, mattress, blanket over its foot, one or two pillows, headboard."""
    width, length, wood = rng.uniform(0.9, 1.7), rng.uniform(1.9, 2.1), _wood(rng)
    sheet, blanket = Material(_WHITE), _cloth(rng)
    parts = [
        _box(0, 0, width, length, 0.08, 0.32, 4, wood),
        _box(0, -0.02, width - 0.04, length - 0.06, 0.32, 0.52, 4, sheet),
        _box(0, -length * 0.16, width + 0.02, length * 0.66, 0.28, 0.545, 4, blanket),
        _box(0, length / 2 - 0.03, width, 0.06, 0.0, rng.uniform(0.8, 1.15), 4, wood),
    ]
    places = (-width / 4, width / 4) if width > 1.3 else (0.0,)
    parts += [_box(x, length / 2 - 0.3, 0.5, 0.35, 0.52, 0.64, 18, Material((240, 238, 232))) for x in places]
    return tuple(parts)


def table(rng: np.random.Generator) -> Thing:
    """Top on four legs."""
    sx, sy, height, wood = rng.uniform(0.9, 1.7), rng.uniform(0.7, 0.95), rng.uniform(0.7, 0.78), _wood(rng)
    return (_box(0, 0, sx, sy, height - 0.04, height, 7, wood), *_legs(sx - 0.06, sy - 0.06, height - 0.04, 7, wood))


def desk(rng: np.random.Generator) -> Thing:
    """Top, side drawers, a monitor."""
    sx, sy, wood = rng.uniform(1.1, 1.5), rng.uniform(0.6, 0.75), _wood(rng)
    drawers = Material(wood.color, _darker(wood.color), CABINET, 0.2)
    return (
        _box(0, 0, sx, sy, 0.71, 0.74, 14, wood),
        _box(sx / 2 - 0.22, 0, 0.42, sy - 0.06, 0.0, 0.71, 14, wood, drawers),
        _box(-sx / 2 + 0.03, 0, 0.05, sy - 0.06, 0.0, 0.71, 14, wood),
        _box(-0.1, sy / 2 - 0.14, 0.5, 0.05, 0.84, 1.16, 25, _METAL, Material((24, 26, 30), (50, 60, 80), SCREEN)),
        _box(-0.1, sy / 2 - 0.14, 0.18, 0.14, 0.74, 0.84, 25, _METAL),
    )


def cabinet(rng: np.random.Generator) -> Thing:
    """Closed box with doors, low to tall."""
    sx, sy, top, wood = rng.uniform(0.6, 1.4), rng.uniform(0.35, 0.6), rng.uniform(0.8, 2.1), _wood(rng)
    doors = Material(wood.color, _darker(wood.color), CABINET, rng.uniform(0.35, 0.5))
    return (_box(0, 0, sx, sy, 0.0, top, 3, wood, doors),)


def wardrobe(rng: np.random.Generator) -> Thing:
    """Tall cabinet."""
    sx, sy, top, wood = rng.uniform(0.7, 1.3), rng.uniform(0.45, 0.62), rng.uniform(1.9, 2.25), _wood(rng)
    return (_box(0, 0, sx, sy, 0.0, top, 3, wood, Material(wood.color, _darker(wood.color), CABINET, 0.45)),)


def bookshelf(rng: np.random.Generator) -> Thing:
    """Shelves full of books."""
    sx, top, wood = rng.uniform(0.7, 1.1), rng.uniform(1.3, 2.1), _wood(rng)
    books = Material(wood.color, (120, 110, 100), BOOKS, 0.32, seed=int(rng.integers(1 << 20)))
    return (_box(0, 0, sx, 0.3, 0.0, top, 10, wood, books),)


def sofa(rng: np.random.Generator) -> Thing:
    """Seat, back and two arms, cushions of another cloth."""
    sx, sy, cloth, cushion = rng.uniform(1.4, 2.1), rng.uniform(0.8, 0.92), _cloth(rng), _cloth(rng)
    return (
        _box(0, -0.05, sx - 0.3, sy - 0.1, 0.06, 0.43, 6, cloth),
        _box(0, sy / 2 - 0.11, sx, 0.22, 0.06, 0.82, 6, cloth),
        _box(-sx / 2 + 0.09, 0, 0.18, sy, 0.04, 0.62, 6, cloth),
        _box(sx / 2 - 0.09, 0, 0.18, sy, 0.04, 0.62, 6, cloth),
        _box(-sx / 4, sy / 2 - 0.3, 0.4, 0.14, 0.43, 0.78, 18, cushion),
    )


def chair(rng: np.random.Generator) -> Thing:
    """Seat and back on four legs."""
    wood, height = _wood(rng) if rng.random() < 0.6 else _cloth(rng), rng.uniform(0.43, 0.48)
    return (
        _box(0, 0, 0.42, 0.42, height - 0.04, height, 5, wood),
        _box(0, 0.19, 0.42, 0.03, height, rng.uniform(0.82, 0.98), 5, wood),
        *_legs(0.42, 0.42, height - 0.04, 5, wood, 0.04),
    )


def toilet(_rng: np.random.Generator) -> Thing:
    """Bowl, lid and cistern."""
    white = Material((238, 238, 235), sensing=SHINY)
    return (
        _box(0, -0.08, 0.26, 0.4, 0.0, 0.3, 33, white),
        _box(0, -0.1, 0.37, 0.46, 0.3, 0.43, 33, white),
        _box(0, 0.22, 0.4, 0.18, 0.3, 0.8, 33, white),
    )


def dresser(rng: np.random.Generator) -> Thing:
    """Chest of drawers."""
    wood = _wood(rng)
    drawers = Material(wood.color, _darker(wood.color), STRIPES, 0.22)
    return (_box(0, 0, rng.uniform(0.8, 1.3), 0.45, 0.0, rng.uniform(0.75, 1.0), 17, wood, drawers),)


def night_stand(rng: np.random.Generator) -> Thing:
    """Small chest with a lamp."""
    wood, lamp = _wood(rng), Material((235, 220, 180))
    return (
        _box(0, 0, 0.45, 0.4, 0.0, 0.5, 32, wood, Material(wood.color, _darker(wood.color), CABINET, 0.45)),
        _box(0, 0, 0.06, 0.06, 0.5, 0.68, 35, _METAL),
        _box(0, 0, 0.24, 0.24, 0.68, 0.9, 35, lamp),
    )


def carton(rng: np.random.Generator) -> Thing:
    """Cardboard box."""
    sx, sy, top = rng.uniform(0.25, 0.6), rng.uniform(0.25, 0.5), rng.uniform(0.2, 0.55)
    return (_box(0, 0, sx, sy, 0.0, top, 29, Material((170, 135, 92), (150, 118, 80), STRIPES, 0.3)),)


def fridge(rng: np.random.Generator) -> Thing:
    """Refrigerator."""
    white = Material((222, 224, 226), (190, 192, 196), CABINET, 0.6, sensing=SHINY)
    return (_box(0, 0, 0.6, 0.62, 0.0, rng.uniform(1.4, 1.9), 24, white, white),)


def small_object(rng: np.random.Generator) -> Thing:
    """Something of 3 to 10 cm that lies on the floor."""
    side = rng.uniform(0.03, 0.1, 3)
    color = tuple(int(v) for v in rng.integers(40, 220, 3))
    return (_box(0, 0, side[0], side[1], 0.0, side[2], 40, Material((color[0], color[1], color[2]))),)


AT_WALL: tuple[Maker, ...] = (
    bed, cabinet, cabinet, wardrobe, bookshelf, sofa, sofa, toilet, dresser, desk, night_stand, carton, table, fridge,
)  # fmt: skip
FREE_STANDING: tuple[Maker, ...] = (table, chair, chair, chair, carton, sofa)
