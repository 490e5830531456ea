"""Pictures for people: the estimate drawn over the frame."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .estimate import RoomEstimate
from .frame import RgbdFrame
from .labels import CLUTTER, FACES, LABEL_COLORS, LABEL_NAMES
from .layout import FacePolygon

_SHIFT = 4
"""Sub-pixel bits of OpenCV's line drawing."""
_LEGEND_SCALE = 3
_EDGE_DARK, _EDGE_LIGHT = (20, 20, 20), (255, 255, 255)
_TEXT = (235, 235, 235)


def draw_overlay(frame: RgbdFrame, estimate: RoomEstimate) -> NDArray[np.uint8]:
    """Return the frame with labels, face borders and a legend.

    Parameters
    ----------
    frame : RgbdFrame
        Its colour image is the ground, or its depth in grey where there is no colour.
    estimate : RoomEstimate
        Of this frame.

    Returns
    -------
    (H, W, 3) uint8 array, RGB. Clutter is grey and hatched, the rim of the clutter a thin dark line.
    """
    ground = frame.color if frame.color is not None else _depth_picture(frame.depth_m)
    picture = np.empty_like(ground)
    _blend(np.ascontiguousarray(ground), np.ascontiguousarray(estimate.labels), LABEL_COLORS, picture)
    scale = max(1, round(min(picture.shape[:2]) / 480))
    for dark in (True, False):  # all dark rims first, so that no face's rim covers another's line
        for polygon in estimate.polygons:
            _draw_border(picture, polygon, scale, dark)
    _draw_legend(picture, estimate, scale)
    return picture


def _depth_picture(depth: NDArray[np.float32] | None) -> NDArray[np.uint8]:
    if depth is None:
        raise ValueError("frame has neither colour nor depth; there is nothing to draw on")
    depth_m = np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0)
    near = np.where(depth_m > 0, 1.0 / np.maximum(depth_m, 0.5), 0.0)  # inverse depth shows near things well
    grey = np.clip(near * 255.0, 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def _draw_border(picture: NDArray[np.uint8], polygon: FacePolygon, scale: int, dark: bool) -> None:
    limit = 8.0 * max(picture.shape[:2])
    corners = np.clip(polygon.pixels, -limit, limit)
    fixed = np.round(corners * (1 << _SHIFT)).astype(np.int32).reshape(-1, 1, 2)
    color, width = (_EDGE_DARK, 3 * scale) if dark else (_EDGE_LIGHT, scale)
    cv2.polylines(picture, [fixed], True, color, width, cv2.LINE_AA, _SHIFT)


def _draw_legend(picture: NDArray[np.uint8], estimate: RoomEstimate, scale: int) -> None:
    faces = {p.face: p.distance for p in estimate.polygons}
    rows = tuple((k, f"{LABEL_NAMES[k]} {faces[k]:.1f}{' m' if estimate.metric else ''}") for k in FACES if k in faces)
    rows += ((CLUTTER, LABEL_NAMES[CLUTTER]),)
    status = estimate.status.value
    title = f"{status}, {estimate.confidence:.0%}" if estimate.cuboid else f"no estimate: {status}"
    card, alpha = _legend(title, rows if estimate.cuboid else (), scale)
    h, w = min(card.shape[0], picture.shape[0] - 8), min(card.shape[1], picture.shape[1] - 8)
    if h <= 0 or w <= 0:
        return
    spot = picture[8 : 8 + h, 8 : 8 + w]
    spot[:] = (spot * (1.0 - alpha) + card[:h, :w] * alpha).astype(np.uint8)


@lru_cache(maxsize=64)
def _legend(title: str, rows: tuple[tuple[int, str], ...], scale: int) -> tuple[NDArray[np.float32], float]:
    """Return the card as (h, w, 3) and its opacity; drawn large and shrunk, for smooth letters."""
    big, line = _LEGEND_SCALE * scale, 15 * _LEGEND_SCALE * scale
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.38 * big
    texts = [title, *(text for _, text in rows)]
    thick = max(1, round(1.1 * big))
    width = max(cv2.getTextSize(t, font, size, thick)[0][0] for t in texts) + 26 * big
    card = np.full((line * len(texts) + 6 * big, -(-width // big) * big, 3), 28, np.uint8)
    cv2.putText(card, title, (6 * big, line - 2 * big), font, size, _TEXT, thick, cv2.LINE_AA)
    for i, (label, text) in enumerate(rows, start=1):
        top = i * line + 4 * big
        color = tuple(int(c) for c in LABEL_COLORS[label])
        cv2.rectangle(card, (6 * big, top), (15 * big, top + 9 * big), color, -1)
        cv2.putText(card, text, (20 * big, top + 9 * big - big // 2), font, size, _TEXT, thick, cv2.LINE_AA)
    small = cv2.resize(card, (card.shape[1] // big * scale, card.shape[0] // big * scale), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32), 0.8


@njit(cache=True, nogil=True)
def _blend(ground, labels, colors, picture):  # type: ignore[no-untyped-def]
    """Faces 45 % colour; clutter 30 % grey with a diagonal hatch; a dark pixel where clutter ends."""
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            label = labels[y, x]
            a = 115  # of 256
            if label == 0:
                a = 0
            elif label == 6:
                a = 140 if (x + y) % 8 < 2 else 64
            rim = (x + 1 < width and (labels[y, x + 1] == 6) != (label == 6)) or (
                y + 1 < height and (labels[y + 1, x] == 6) != (label == 6)
            )
            for c in range(3):
                value = (ground[y, x, c] * (256 - a) + colors[label, c] * a) >> 8
                picture[y, x, c] = value // 3 if rim else value
