"""Pictures of what was estimated, for people: labels over colour, outlines, depth, tiles with captions."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import FACES, FURNITURE_NYU40, LABEL_COLORS

Image = NDArray[np.uint8]

TRUTH_COLOR = (235, 40, 40)
ESTIMATE_COLOR = (40, 110, 255)
CAPTION_PX = 26
_LONGEST_SHAPE = 16 / 9
_INK, _PAPER = (30, 34, 40), (255, 255, 255)


def base_image(frame: RgbdFrame) -> Image:
    """Return the colour image, or the depth in grey where there is no colour."""
    if frame.color is not None:
        return frame.color
    assert frame.depth_m is not None
    return np.repeat(cv2.cvtColor(paint_depth(frame.depth_m), cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)


def paint_labels(image: Image, labels: Image, opacity: float = 0.55) -> Image:
    """Return the picture with each labelled pixel tinted in its label's colour; unknown (0) is darkened."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None].astype(np.float32)
    tinted = opacity * LABEL_COLORS[labels] + (1 - opacity) * grey
    return np.where(labels[..., None] > 0, tinted, 0.35 * grey).astype(np.uint8)


def paint_classes(image: Image, classes: Image) -> Image:
    """Return the picture with NYU40 classes tinted, one fixed hue a class; 0 stays grey."""
    grey = np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    palette = class_colors()
    return np.where(classes[..., None] > 0, 0.6 * palette[classes] + 0.4 * grey, 0.6 * grey).astype(np.uint8)


def class_colors() -> Image:
    """Return (256, 3) the hue of each NYU40 class; by 29 those of the furniture lie farthest apart."""
    hue = (np.arange(256) * 29 % 180).astype(np.uint8)
    hsv = np.stack([hue, np.full(256, 190, np.uint8), np.full(256, 255, np.uint8)], axis=1)[None]
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0], np.uint8)


def furniture_legend() -> list[tuple[str, tuple[int, int, int]]]:
    """Return the furniture classes with their colours."""
    colors = class_colors().tolist()
    return [(name, tuple(colors[k])) for k, name in FURNITURE_NYU40.items()]


def draw_legend(image: Image, entries: Sequence[tuple[str, Sequence[int]]]) -> Image:
    """Return the picture with names and their colours on a card in its upper left corner."""
    out, line, wide = image.copy(), 20, 110
    cv2.rectangle(out, (6, 6), (6 + wide, 12 + line * len(entries)), _PAPER, -1)
    for row, (name, color) in enumerate(entries):
        y = 12 + line * row
        cv2.rectangle(out, (12, y), (25, y + 13), tuple(int(c) for c in color), -1)
        cv2.putText(out, name, (32, y + 12), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    return out


def paint_depth(depth_m: NDArray[np.float32], nearest: float | None = None, farthest: float | None = None) -> Image:
    """Return the depth in colours (near red, far blue), black where nothing was measured."""
    seen = np.isfinite(depth_m) & (depth_m > 0)
    if not seen.any():
        return np.zeros((*depth_m.shape, 3), np.uint8)
    low = float(np.percentile(depth_m[seen], 1)) if nearest is None else nearest
    high = float(np.percentile(depth_m[seen], 99)) if farthest is None else farthest
    share = np.clip((np.where(seen, depth_m, low) - low) / max(high - low, 1e-6), 0, 1)
    colors = cv2.cvtColor(
        cv2.applyColorMap(((1 - share) * 255).astype(np.uint8), cv2.COLORMAP_TURBO), cv2.COLOR_BGR2RGB
    )
    return np.where(seen[..., None], colors, 0).astype(np.uint8)


def draw_outlines(image: Image, layout: Image, color: tuple[int, int, int], width: int = 3) -> Image:
    """Return the picture with the borders between the layout's faces drawn over it."""
    border = np.zeros(layout.shape, np.uint8)
    for face in FACES:
        mask = (layout == face).astype(np.uint8)
        border |= mask & (cv2.erode(mask, np.ones((3, 3), np.uint8), borderValue=1) == 0)
    thick = cv2.dilate(border, np.ones((width, width), np.uint8))
    out = image.copy()
    out[thick > 0] = color
    return out


def draw_superpixels(image: Image, index: NDArray[np.int32], color: tuple[int, int, int] = (255, 255, 255)) -> Image:
    """Return the picture with the borders of superpixels drawn, one pixel wide."""
    border = np.zeros(index.shape, bool)
    border[:, 1:] |= index[:, 1:] != index[:, :-1]
    border[1:] |= index[1:] != index[:-1]
    out = image.copy()
    out[border] = color
    return out


def tile_size(image: Image, shorter_px: int) -> tuple[int, int]:
    """Return (width, height) of a tile in the shape of the picture, by its shorter side; 16:9 is the longest shape."""
    height, width = image.shape[:2]
    factor, longest_px = shorter_px / min(width, height), round(_LONGEST_SHAPE * shorter_px)
    return min(round(factor * width), longest_px), min(round(factor * height), longest_px)


def fit(image: Image, size: tuple[int, int]) -> Image:
    """Return the picture as large as (width, height) `size` takes it, unstretched, with margins where it is left."""
    height, width = image.shape[:2]
    factor = min(size[0] / width, size[1] / height)
    within = max(1, round(factor * width)), max(1, round(factor * height))
    left, above = (size[0] - within[0]) // 2, (size[1] - within[1]) // 2
    sheet = np.full((size[1], size[0], 3), _PAPER, np.uint8)
    sheet[above : above + within[1], left : left + within[0]] = cv2.resize(image, within, interpolation=cv2.INTER_AREA)
    return sheet


def caption(image: Image, text: str, size: tuple[int, int]) -> Image:
    """Return the picture fitted into (width, height) under a line of text."""
    strip = np.full((CAPTION_PX, size[0], 3), _PAPER, np.uint8)
    cv2.putText(strip, text, (4, CAPTION_PX - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    return np.vstack([strip, fit(image, size)])


def tiles(pictures: Sequence[tuple[str, Image]], columns: int, size: tuple[int, int] = (320, 240)) -> Image:
    """Return captioned pictures in rows of `columns`, each fitted into (width, height) `size`."""
    gap = 6
    cells = [
        cv2.copyMakeBorder(caption(p, t, size), 0, gap, 0, gap, cv2.BORDER_CONSTANT, value=_PAPER) for t, p in pictures
    ]
    cells += [np.full_like(cells[0], 255)] * (-len(cells) % columns)
    rows = [np.hstack(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    return np.vstack(rows)
