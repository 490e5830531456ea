"""Small holes in the depth that something else closes: the picture on the floor, their own rims on things.

Stereo loses depth where the picture has no texture. Exactly there the picture itself tells that nothing stands, for
a thing has an outline: an unmeasured pixel is bridged where it is labelled floor and no edge parts it from floor that
was measured. Nothing is suspected there; seen it is not. What has no depth because it is black, shiny or of glass
keeps its outline and stays unknown, as does any hole without a picture. In a thing, a hole is as flat as what
surrounds it: its inverse depth is linear between the rims.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..labels import CLUTTER, FLOOR

MEASURED, BRIDGED, GAP = range(3)
"""Of a pixel: it has a depth; it has none and is floor by the picture; it has none and nothing tells what it is."""

_WINDOW = np.ones((5, 5), np.uint8)
_RIM_PX = 4
"""Rows around the holes that the window and the blur before it look at."""

_MAX_CONTRAST = 18
"""Levels of a colour between the most and the least in a window, above which an outline may run through it."""

_LONGEST_PX, _ONE_SIDED_PX = 60, 40
_SAME_SURFACE = 0.1
"""Share by which the inverse depths of a hole's rims may differ."""


@dataclass(frozen=True, slots=True)
class DepthHoles:
    """The depth with its small holes closed.

    Attributes
    ----------
    kind : (H, W) uint8, `MEASURED`, `BRIDGED` or `GAP`.
    inverse_depth : (H, W) float32, 1/m; holes in things filled, 0 elsewhere where nothing was measured.
    """

    kind: NDArray[np.uint8]
    inverse_depth: NDArray[np.float32]


def close_holes(
    inverse_depth: NDArray[np.float32], labels: NDArray[np.uint8], color: NDArray[np.uint8] | None
) -> DepthHoles:
    """Close what can be closed.

    Parameters
    ----------
    inverse_depth : (H, W) float32, 0 where nothing was measured.
    labels : (H, W) uint8 of the estimate.
    color : (H, W, 3) uint8 RGB, or None: without a picture no hole in the floor is closed.
    """
    kind, filled, part = _find_holes(inverse_depth, labels)
    if color is not None and part[1] > part[0]:
        rows, cols = slice(part[0], part[1]), slice(part[2], part[3])
        # whole arrays: for parts of them numba would compile another kernel
        piece, label = np.ascontiguousarray(kind[rows, cols]), np.ascontiguousarray(labels[rows, cols])
        _bridge(piece, label, _contrast(color[rows, cols]))
        kind[rows, cols] = piece
    return DepthHoles(kind, filled)


def _contrast(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W) uint8 levels between the most and the least in a window, of the colour in which they differ most."""
    apart = cv2.morphologyEx(cv2.blur(color, (3, 3)), cv2.MORPH_GRADIENT, _WINDOW)
    red, green, blue = cv2.split(apart)
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)


@njit(cache=True, nogil=True)
def _find_holes(inverse, labels):  # type: ignore[no-untyped-def]
    """Kinds with all holes open, the depth with those in things filled, and the part that has holes in the floor: its
    rows and columns, none where the floor has no hole.
    """
    height, width = inverse.shape
    kind = np.zeros((height, width), np.uint8)
    filled = inverse.copy()
    first_row, last_row, first_col, last_col = height, -1, width, -1
    for v in range(height):
        if _is_measured(inverse[v]):
            continue
        u = 0
        while u < width:
            if inverse[v, u] > 0.0:
                u += 1
                continue
            first, label = u, labels[v, u]
            while u < width and inverse[v, u] <= 0.0 and labels[v, u] == label:
                kind[v, u] = GAP
                u += 1
            if label == CLUTTER:
                _fill_run(filled[v], labels[v], first, u)
            elif label == FLOOR:
                first_row, last_row = min(first_row, v), max(last_row, v)
                first_col, last_col = min(first_col, first), max(last_col, u)
    if last_row < 0:
        return kind, filled, (0, 0, 0, 0)
    part = (
        max(first_row - _RIM_PX, 0), min(last_row + 1 + _RIM_PX, height),
        max(first_col - _RIM_PX, 0), min(last_col + _RIM_PX, width),
    )  # fmt: skip
    return kind, filled, part


@njit(cache=True, nogil=True)
def _is_measured(row):  # type: ignore[no-untyped-def]
    """Whether all of a row has depth; by itself, so that it runs on vectors."""
    holes = 0
    for u in range(len(row)):
        holes += row[u] <= 0.0
    return holes == 0


@njit(cache=True, nogil=True)
def _fill_run(row, labels, first, last):  # type: ignore[no-untyped-def]
    """Fill a run of unmeasured clutter in a row: between two rims linear, from one rim on as it is."""
    n = last - first
    before = row[first - 1] if first > 0 and labels[first - 1] == CLUTTER else 0.0
    after = row[last] if last < len(row) and labels[last] == CLUTTER else 0.0
    if before > 0.0 and after > 0.0:
        if n <= _LONGEST_PX and abs(before - after) < _SAME_SURFACE * after:
            for k in range(n):
                row[first + k] = before + (after - before) * (k + 1) / (n + 1)
    elif n <= _ONE_SIDED_PX:
        for k in range(n):
            row[first + k] = max(before, after)


@njit(cache=True, nogil=True)
def _bridge(kind, labels, contrast):  # type: ignore[no-untyped-def]
    """Mark as `BRIDGED` the plain floor without depth that plain floor with depth touches: flood from the rims."""
    height, width = kind.shape
    stack = np.empty((height * width, 2), np.int32)
    count = 0
    for v in range(height):
        for u in range(width):
            if kind[v, u] != GAP or labels[v, u] != FLOOR or contrast[v, u] > _MAX_CONTRAST:
                continue
            for m in range(max(v - 1, 0), min(v + 2, height)):
                for n in range(max(u - 1, 0), min(u + 2, width)):
                    plain = labels[m, n] == FLOOR and contrast[m, n] <= _MAX_CONTRAST
                    if plain and kind[m, n] == MEASURED and kind[v, u] == GAP:
                        kind[v, u] = BRIDGED
                        stack[count, 0], stack[count, 1] = v, u
                        count += 1
    while count > 0:
        count -= 1
        v0, u0 = stack[count, 0], stack[count, 1]
        for side in range(4):
            v = v0 + (side == 0) - (side == 1)
            u = u0 + (side == 2) - (side == 3)
            if v < 0 or u < 0 or v >= height or u >= width:
                continue
            if kind[v, u] == GAP and labels[v, u] == FLOOR and contrast[v, u] <= _MAX_CONTRAST:
                kind[v, u] = BRIDGED
                stack[count, 0], stack[count, 1] = v, u
                count += 1
