"""Contact sheet and moving picture of a run."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.images import write_atomically, write_image
from room_layout_ros.evaluation import pictures
from room_layout_ros.extras import install_hint

Image = NDArray[np.uint8]
SHEET_FRAMES = 24
FLOOR_FRAMES = 12
ANIMATION_FRAMES = 120
"""More frames are thinned out evenly: a page should open at once."""

_TILE_PX = 360
"""Shorter side of a tile. Smaller, the legend of a 640x480 overlay reads wrong: a 0 as an 8."""
_SMALL_TILE_PX = 150
"""Of the sheets with all frames: to find one, not to read."""
ANIMATION_TILE = (480, 360)
"""Width and height of what has no shape of its own: the free space."""


def evenly(count: int, wanted: int) -> list[int]:
    """Return at most `wanted` indices spread evenly over 0..count - 1."""
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, wanted)).round()})


def write_sheets(path: Path, frames: Sequence[tuple[str, Image]], columns: int = 4) -> list[Path]:
    """Write contact sheets: `path` with an even choice of frames; if there are more, path-all-N with all of them."""
    chosen = [frames[i] for i in evenly(len(frames), SHEET_FRAMES)]
    write_image(path, _tiles(chosen, min(columns, len(chosen)), _TILE_PX))
    written = [path]
    if len(frames) > SHEET_FRAMES:
        per_sheet = 60
        for number, start in enumerate(range(0, len(frames), per_sheet), 1):
            sheet = path.with_name(f"{path.stem}-all-{number}.jpg")
            write_image(sheet, _tiles(frames[start : start + per_sheet], 10, _SMALL_TILE_PX), 88)
            written.append(sheet)
    return written


def write_floors(path: Path, frames: Sequence[tuple[str, Image]], columns: int = 4) -> None:
    """Write the free space of an even choice of frames."""
    chosen = [frames[i] for i in evenly(len(frames), FLOOR_FRAMES)]
    write_image(path, _tiles(chosen, min(columns, len(chosen)), _TILE_PX))


def _tiles(frames: Sequence[tuple[str, Image]], columns: int, shorter_px: int) -> Image:
    """Return pictures in rows, all of them in the shape of the first."""
    return pictures.tiles(frames, columns, pictures.tile_size(frames[0][1], shorter_px))


def shrink(image: Image) -> Image:
    """Return a picture at the size of a tile."""
    return pictures.fit(image, pictures.tile_size(image, _TILE_PX))


def side_by_side(*images: Image) -> Image:
    """Return pictures beside each other, each in its own shape."""
    shrunk = [shrink(image) for image in images]
    height = max(image.shape[0] for image in shrunk)
    return np.hstack([pictures.fit(image, (image.shape[1], height)) for image in shrunk])


def write_animation(path: Path, frames: Sequence[Image], seconds: float) -> None:
    """Write an animated WebP: plays in every browser without a codec, and lies inside the page as an image.

    Raises
    ------
    DataError
        When Pillow is missing.
    """
    try:
        from PIL import Image as Pillow
    except ImportError:
        raise DataError(f"the moving picture needs Pillow: {install_hint('viz')}") from None
    height, width = frames[0].shape[:2]
    chosen = [Pillow.fromarray(pictures.fit(frames[i], (width, height))) for i in evenly(len(frames), ANIMATION_FRAMES)]
    out = io.BytesIO()
    each_ms = max(40, round(1000 * seconds / len(chosen)))
    chosen[0].save(out, "webp", save_all=True, append_images=chosen[1:], duration=each_ms, loop=0, quality=72, method=2)
    write_atomically(path, out.getvalue())
