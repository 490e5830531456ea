"""Colours and patterns of the shell and what hangs on it."""

from __future__ import annotations

import numpy as np

from .room import Decoration
from .shapes import CARPET, DOOR, GLASS, PICTURE, PLAIN, PLANKS, SLATS, STRIPES, TILES, WINDOW, Material, Rgb

_PAINTS: tuple[Rgb, ...] = (
    (226, 222, 212),
    (214, 200, 176),
    (196, 208, 212),
    (205, 214, 190),
    (222, 190, 160),
    (168, 182, 200),
    (232, 214, 150),
)


def decoration(rng: np.random.Generator, walls: int, same_color: bool | None = None) -> Decoration:
    """Return materials of a shell with `walls` walls; `same_color` as in `random_scene`."""
    paint = _varied(rng, _PAINTS[rng.integers(len(_PAINTS))], 8)
    seed = int(rng.integers(1 << 20))
    if same_color:
        plain = Material(paint, seed=seed)
        return Decoration((plain,) * walls, _floor(rng), plain)
    uniform = rng.random() < 0.6
    materials = []
    for i in range(walls):
        color = paint if uniform else _varied(rng, _PAINTS[rng.integers(len(_PAINTS))], 8)
        striped = not uniform and rng.random() < 0.3
        second = _varied(rng, color, 14)
        materials.append(Material(color, second, SLATS if striped else PLAIN, 0.16, seed=seed + i))
    return Decoration(tuple(materials), _floor(rng), Material(_varied(rng, (236, 234, 228), 6), seed=seed + 9))


def _floor(rng: np.random.Generator) -> Material:
    seed = int(rng.integers(1 << 20))
    kind = rng.integers(4)
    if kind == 0:
        return Material(
            _varied(rng, (176, 172, 164), 20), (110, 108, 104), TILES, float(rng.uniform(0.25, 0.5)), seed=seed
        )
    if kind <= 2:
        color = _varied(rng, ((158, 112, 70), (118, 82, 54), (190, 152, 108))[rng.integers(3)], 10)
        return Material(color, (70, 48, 32), PLANKS, float(rng.uniform(0.09, 0.16)), seed=seed)
    color = _varied(rng, ((120, 112, 104), (92, 98, 116), (150, 130, 108))[rng.integers(3)], 12)
    return Material(color, _varied(rng, color, 30), CARPET, 0.012, seed=seed)


def door_material(rng: np.random.Generator) -> Material:
    """Door leaf, white or wood."""
    color: Rgb = (228, 224, 214) if rng.random() < 0.5 else _varied(rng, (146, 100, 62), 12)
    return Material(color, (64, 56, 48), DOOR)


def window_material(rng: np.random.Generator) -> Material:
    """Window with daylight, or drawn blinds."""
    if rng.random() < 0.25:
        return Material((226, 222, 210), (180, 174, 160), STRIPES, 0.05)
    return Material((236, 236, 232), (205, 222, 240), WINDOW, sensing=GLASS, seed=int(rng.integers(1 << 20)))


def picture_material(rng: np.random.Generator) -> Material:
    """Framed picture."""
    frame = _varied(rng, (52, 40, 30), 20)
    return Material(frame, _varied(rng, (140, 130, 110), 80), PICTURE, seed=int(rng.integers(1 << 20)))


def _varied(rng: np.random.Generator, color: Rgb, spread: int) -> Rgb:
    r, g, b = np.clip(np.array(color) + rng.integers(-spread, spread + 1, 3), 8, 250)
    return int(r), int(g), int(b)
