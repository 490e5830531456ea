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
from .working_size import resize_estimate, resize_frame

_SHIFT = 4
"""Sub-pixel bits of OpenCV's line drawing."""
_LEGEND_SCALE = 3
_EDGE_DARK, _EDGE_LIGHT = (20, 20, 20), (255, 255, 255)
_TEXT, _CARD = (235, 235, 235), 28
_HATCH, _RIM = 7, 8
_SMALL_PX, _DRAWN_PX = 320, 640


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
    (H, W, 3) uint8 array, RGB. Clutter keeps its colours under a grey hatch, its rim is a thin dark line. A frame whose
    longer side is below `_SMALL_PX` is drawn larger, by a whole factor: the legend would hide it.
    """
    if max(frame.camera.width, frame.camera.height) < _SMALL_PX:
        frame, estimate = resize_frame(frame, _DRAWN_PX), resize_estimate(estimate, frame.camera, _DRAWN_PX)
    ground = frame.color if frame.color is not None else _depth_picture(frame.depth_m)
    picture = np.empty_like(ground)
    _blend(np.ascontiguousarray(ground), np.ascontiguousarray(estimate.labels), _mixtures(), picture)
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
    rows += ((CLUTTER, f"{LABEL_NAMES[CLUTTER]} (hatched)"),)
    status = estimate.status.value
    title = f"{status}, {estimate.confidence:.0%}" if estimate.cuboid else f"no estimate: {status}"
    card, alpha = _legend(title, rows if estimate.cuboid else (), scale)
    h, w = min(card.shape[0], picture.shape[0] - 8), min(card.shape[1], picture.shape[1] - 8)
    if h <= 0 or w <= 0:
        return
    spot = picture[8 : 8 + h, 8 : 8 + w]
    _lay(card, np.float32(alpha), 1.0 - alpha, spot)


def _legend(title: str, rows: tuple[tuple[int, str], ...], scale: int) -> tuple[NDArray[np.float32], float]:
    """Return the card as (h, w, 3) and its opacity."""
    lines = [_line(title, None, scale), *(_line(text, label, scale) for label, text in rows)]
    height, width = lines[0].shape[0], max(line.shape[1] for line in lines)
    card = np.full((height * len(lines) + 2 * scale, width, 3), _CARD, np.float32)
    for i, line in enumerate(lines):
        card[i * height : (i + 1) * height, : line.shape[1]] = line
    return card, 0.8


@lru_cache(maxsize=512)
def _line(text: str, label: int | None, scale: int) -> NDArray[np.float32]:
    """(h, w, 3) a line of the card, with a square in the label's colour; drawn large and shrunk, for smooth letters."""
    big = _LEGEND_SCALE * scale
    font, size, thick = cv2.FONT_HERSHEY_SIMPLEX, 0.38 * big, max(1, round(1.1 * big))
    left, bottom = (6 * big, 13 * big) if label is None else (20 * big, 12 * big + big // 2)
    width = left + cv2.getTextSize(text, font, size, thick)[0][0] + 6 * big
    line = np.full((15 * big, -(-width // big) * big, 3), _CARD, np.uint8)
    if label is not None:
        color = tuple(int(c) for c in LABEL_COLORS[label])
        cv2.rectangle(line, (6 * big, 4 * big), (15 * big, 13 * big), color, -1)
    cv2.putText(line, text, (left, bottom), font, size, _TEXT, thick, cv2.LINE_AA)
    small = cv2.resize(line, (line.shape[1] // big * scale, 15 * scale), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32)


@lru_cache(maxsize=1)
def _mixtures() -> NDArray[np.uint8]:
    """(16, 3, 256) uint8 new value of each old one, by label, `_HATCH` and `_RIM`.

    Faces 45 % colour; clutter 30 % grey with a diagonal hatch; a dark pixel where clutter ends.
    """
    weights = np.array([0, 115, 115, 115, 115, 115, 64, 140])[:, None, None]  # of 256
    colors = LABEL_COLORS[[*range(CLUTTER + 1), CLUTTER]].astype(np.int64)[:, :, None]
    mixed = (np.arange(256) * (256 - weights) + colors * weights) >> 8
    return np.concatenate([mixed, mixed // 3]).astype(np.uint8)


@njit(cache=True, nogil=True)
def _blend(ground, labels, mixtures, picture):  # type: ignore[no-untyped-def]
    height, width = labels.shape
    kinds = np.empty(width, np.uint8)
    for y in range(height):
        below = labels[min(y + 1, height - 1)]
        _row_kinds(labels[y, :-1], labels[y, 1:], below, y, kinds)
        _row_kinds(labels[y, -1:], labels[y, -1:], below[-1:], y + width - 1, kinds[-1:])
        _mix(ground[y], kinds, mixtures, picture[y])


@njit(cache=True, nogil=True)
def _row_kinds(labels, right, below, diagonal, kinds):  # type: ignore[no-untyped-def]
    """Write which mixture the pixels of a row have; `diagonal` is the sum of the coordinates of the first."""
    for x in range(len(labels)):
        clutter = labels[x] == CLUTTER
        hatched = clutter & (((x + diagonal) & 7) < 2)
        rim = (clutter != (right[x] == CLUTTER)) | (clutter != (below[x] == CLUTTER))
        kinds[x] = (np.uint8(_HATCH) if hatched else labels[x]) + (np.uint8(_RIM) if rim else np.uint8(0))


@njit(cache=True, nogil=True)
def _mix(ground, kinds, mixtures, picture):  # type: ignore[no-untyped-def]
    for x in range(len(kinds)):
        kind = kinds[x]
        picture[x, 0] = mixtures[kind, 0, ground[x, 0]]
        picture[x, 1] = mixtures[kind, 1, ground[x, 1]]
        picture[x, 2] = mixtures[kind, 2, ground[x, 2]]


@njit(cache=True, nogil=True)
def _lay(card, alpha, rest, spot):  # type: ignore[no-untyped-def]
    """Lay a card over a spot of a picture, as opaque as `alpha`; what it does not cover of it stays."""
    for y in range(spot.shape[0]):
        for x in range(spot.shape[1]):
            for c in range(3):
                spot[y, x, c] = np.uint8(np.float64(spot[y, x, c]) * rest + np.float64(card[y, x, c] * alpha))
