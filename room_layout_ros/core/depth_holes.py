"""Small holes in the depth that something else closes: the picture on the floor, their own rims on things.

Stereo loses depth where the picture has no texture. Exactly there the picture itself tells that nothing stands, for
a thing has an outline: an unmeasured pixel counts as floor where it is labelled floor and no edge parts it from floor
that was measured. What has no depth because it is black, shiny or of glass keeps its outline and stays unknown, as
does any hole without a picture. In a thing, a hole is as flat as what surrounds it: its inverse depth is linear
between the rims.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .labels import CLUTTER, FLOOR

MEASURED, BRIDGED, GAP = range(3)
"""Of a pixel: it has a depth; it has none and is floor by the picture; it has none and nothing tells what it is."""

_WINDOW = np.ones((5, 5), np.uint8)
_RIM_PX = 4
"""Rows around the holes that the window and the blur before it look at."""

_NEXT = np.ones((3, 3), np.uint8)
_MAX_CONTRAST = 18
"""Grey levels between the brightest and the darkest of a window, above which an outline may run through it."""

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
    hole = inverse_depth <= 0.0
    kind = np.where(hole, np.uint8(GAP), np.uint8(MEASURED))
    floor = labels == FLOOR
    rows = np.flatnonzero((hole & floor).any(axis=1))
    if color is not None and len(rows):
        part = slice(max(int(rows[0]) - _RIM_PX, 0), int(rows[-1]) + 1 + _RIM_PX)
        kind[part][_is_floor_by_picture(hole[part], floor[part], color[part])] = BRIDGED
    return DepthHoles(kind, _fill_things(inverse_depth, labels))


def _is_floor_by_picture(
    hole: NDArray[np.bool_], floor: NDArray[np.bool_], color: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    grey = cv2.blur(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), (3, 3))
    plain = floor & (cv2.morphologyEx(grey, cv2.MORPH_GRADIENT, _WINDOW) <= _MAX_CONTRAST)
    count, part = cv2.connectedComponents((hole & plain).astype(np.uint8), connectivity=4)
    beside = cv2.dilate((plain & ~hole).astype(np.uint8), _NEXT) > 0
    joined = np.zeros(count, bool)
    joined[part[beside]] = True
    joined[0] = False  # what is no hole
    return np.asarray(joined[part])


@njit(cache=True, nogil=True)
def _fill_things(inverse, labels):  # type: ignore[no-untyped-def]
    """Fill runs of unmeasured clutter along the rows: between two rims linear, from one rim on as it is."""
    filled = inverse.copy()
    height, width = inverse.shape
    for v in range(height):
        u = 0
        while u < width:
            if inverse[v, u] > 0.0 or labels[v, u] != CLUTTER:
                u += 1
                continue
            first = u
            while u < width and inverse[v, u] <= 0.0 and labels[v, u] == CLUTTER:
                u += 1
            n = u - first
            before = inverse[v, first - 1] if first > 0 and labels[v, first - 1] == CLUTTER else 0.0
            after = inverse[v, u] if u < width and labels[v, u] == CLUTTER else 0.0
            if before > 0.0 and after > 0.0:
                if n <= _LONGEST_PX and abs(before - after) < _SAME_SURFACE * after:
                    for k in range(n):
                        filled[v, first + k] = before + (after - before) * (k + 1) / (n + 1)
            elif n <= _ONE_SIDED_PX:
                for k in range(n):
                    filled[v, first + k] = max(before, after)
    return filled
