"""Dark holes in the depth, and where they stand on the floor: below their feet floor begins.

Black leather and varnish swallow the sensor's light. What hangs together of such pixels is a hole, with an upper and a
lower edge in each of its columns; a foot that has depth, of steel, goes on from the lower edge down to where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .depth_holes import GAP
from .floor_pixels import FLOOR_PIXEL, FLYING_PIXEL, OBSTACLE_PIXEL, camera_height, pixel_rays

_DARK = 90
"""Level of the brightest channel up to which a pixel is dark."""

_LEAST_AREA = 1.2e-3
"""Solid angle in sr of a hole that counts: a black shoe at 2.5 m."""

_OPENING = np.ones((3, 3), np.uint8)
"""Holes that hang together by less are two."""

BLUR_PX = 3
"""The floor below a foot begins no more than so many rows farther down."""

_LEAST_FEET = 3
"""Columns of a hole below which floor is; a hole with fewer hangs on a wall."""

FOOT_M = 0.15
"""A foot that has depth is no wider."""

LEVEL = -1e-3
"""Rays that do not fall by more per metre meet no floor."""

_NEAREST_Z_M = 0.1


@dataclass(frozen=True, slots=True)
class DarkHole:
    """A dark hole in the depth.

    Attributes
    ----------
    first : its first column. highest, lowest : (n,) int64 row of its edges in each of its n columns.
    on_floor : (n,) bool, whether floor is measured right below.
    """

    first: int
    highest: NDArray[np.int64]
    lowest: NDArray[np.int64]
    on_floor: NDArray[np.bool_]


def find_dark_holes(
    hole_kind: NDArray[np.uint8],
    kind: NDArray[np.uint8],
    inverse_depth: NDArray[np.float32],
    color: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
) -> list[DarkHole]:
    """Return the dark holes that are large enough and stand on floor that is seen.

    Parameters
    ----------
    hole_kind, kind : (H, W) uint8 of `close_holes` and `sum_floor_cells`.
    inverse_depth : (H, W) float32, 0 where nothing was measured. color : (H, W, 3) uint8 RGB.
    """
    least = max(int(_LEAST_AREA * camera.fx * camera.fy), 1)
    dark, (top, bottom, left, right), count = _dark_pixels(hole_kind, color)
    if count < least:
        return []
    part = np.asarray(cv2.morphologyEx(dark[top:bottom, left:right], cv2.MORPH_OPEN, _OPENING), np.uint8)
    parts, patch, boxes = _patches(part, least, left == 0, right == dark.shape[1])
    holes = []
    for k, box in boxes.items():
        edges = _edges(parts, patch == k, box, (top, left), kind)
        _go_on_over_feet(edges, box[2] + left, inverse_depth, kind, camera.numbers, T_camera_floor)
        if np.count_nonzero(edges[2]) >= _LEAST_FEET:
            holes.append(DarkHole(int(box[2] + left), *edges))
    return holes


def _patches(
    dark: NDArray[np.uint8], least: int, at_left: bool, at_right: bool
) -> tuple[NDArray[np.int32], NDArray[np.int64], dict[int, NDArray[np.int64]]]:
    """(H, W) int32 parts that hang together, the patch of each part, and rows and columns of patches of enough pixels.

    Parts that one side of the picture cuts off may hang together beyond it, as the legs of a table do: they are one
    patch. `at_left`, `at_right` : whether `dark` reaches that side.
    """
    n, labelled = cv2.connectedComponents(dark, connectivity=8)
    parts = np.asarray(labelled, np.int32)
    box, area = _boxes(parts, dark, n)
    patch = np.arange(n)
    for reaches, cut in ((at_left, box[1:, 2] == 0), (at_right, box[1:, 3] == dark.shape[1])):
        joined = np.unique(patch[1:][cut])
        if reaches and len(joined) > 1:
            patch[np.isin(patch, joined)] = joined[0]
    boxes = {}
    for k in np.flatnonzero(np.bincount(patch, area) >= least):
        own = patch == k
        boxes[int(k)] = np.ravel([box[own, 0::2].min(axis=0), box[own, 1::2].max(axis=0)], order="F")
    return parts, patch, boxes


@njit(cache=True, nogil=True)
def _dark_pixels(hole_kind, color):  # type: ignore[no-untyped-def]
    """(H, W) uint8 dark pixels without depth; their rows and columns, with one beside them; and how many they are."""
    height, width = hole_kind.shape
    dark = np.zeros((height, width), np.uint8)
    top, bottom, left, right, count = height, 0, width, 0, 0
    for v in range(height):
        if not _has_any(hole_kind[v], GAP):
            continue
        for u in range(width):
            if hole_kind[v, u] != GAP or max(color[v, u, 0], color[v, u, 1], color[v, u, 2]) > _DARK:
                continue
            dark[v, u] = 1
            top, bottom, left, right = min(top, v), v + 1, min(left, u), max(right, u + 1)
            count += 1
    return dark, (max(top - 1, 0), min(bottom + 1, height), max(left - 1, 0), min(right + 1, width)), count


@njit(cache=True, nogil=True)
def _boxes(parts, dark, count):  # type: ignore[no-untyped-def]
    """(count, 4) int64 rows and columns of parts, and (count,) int64 how many pixels they have; of number 0 none."""
    height, width = parts.shape
    box, area = np.empty((count, 4), np.int64), np.zeros(count, np.int64)
    box[:, 0], box[:, 1], box[:, 2], box[:, 3] = height, 0, width, 0
    for v in range(height):
        if not _has_any(dark[v], 1):
            continue
        for u in range(width):
            k = parts[v, u]
            if k > 0:
                box[k, 0], box[k, 1] = min(box[k, 0], v), v + 1
                box[k, 2], box[k, 3] = min(box[k, 2], u), max(box[k, 3], u + 1)
                area[k] += 1
    return box, area


@njit(cache=True, nogil=True)
def _has_any(row, value):  # type: ignore[no-untyped-def]
    """Whether a value is in a row; by itself, without a way out, so that it runs on vectors."""
    count = 0
    for u in range(len(row)):
        count += row[u] == value
    return count > 0


@njit(cache=True, nogil=True)
def _edges(parts, own, box, offset, kind):  # type: ignore[no-untyped-def]
    """Highest and lowest row of a patch in each of its columns, and whether floor with depth is below it.

    `own` : of each part whether it belongs to the patch. `box` : rows and columns of the patch in `parts`, which begin
    at row and column `offset` of the picture.
    """
    top, bottom, left, right = box
    highest, lowest = np.empty(right - left, np.int64), np.empty(right - left, np.int64)
    on_floor = np.zeros(right - left, np.bool_)
    for u in range(left, right):
        high, low = top, bottom - 1
        while not own[parts[high, u]]:
            high += 1
        while not own[parts[low, u]]:
            low -= 1
        high, low = high + offset[0], low + offset[0]
        highest[u - left], lowest[u - left] = high, low
        on_floor[u - left] = low + 1 == len(kind)
        for v in range(low + 1, min(low + 1 + BLUR_PX, len(kind))):
            on_floor[u - left] |= kind[v, u + offset[1]] == FLOOR_PIXEL
    return highest, lowest, on_floor


@njit(cache=True, nogil=True)
def _go_on_over_feet(edges, first, inverse, kind, intrinsics, T):  # type: ignore[no-untyped-def]
    """Let a patch go on down over feet that have depth: narrow things that end at its lower edge."""
    _, lowest, on_floor = edges
    feet, n = np.full(len(lowest), -1, np.int64), len(lowest)
    for k in range(n):
        if not on_floor[k]:
            feet[k] = _end_of_foot(inverse, kind, lowest[k], first + k, intrinsics, T)
    begin = 0
    for k in range(n + 1):
        if k < n and feet[k] >= 0:
            continue
        if k > begin and begin >= BLUR_PX and k + BLUR_PX <= n:
            before, after = lowest[begin - BLUR_PX], lowest[k + BLUR_PX - 1]
            least, most = min(before, after) - BLUR_PX, max(before, after) + BLUR_PX
            even = lowest[begin:k].min() >= least and lowest[begin:k].max() <= most
            z = depth_of_floor(T, intrinsics, first + 0.5 * (begin + k - 1), feet[begin:k].max() + 1.0)
            if even and (k - begin) * z <= FOOT_M * intrinsics[0]:
                lowest[begin:k], on_floor[begin:k] = feet[begin:k], True
        begin = k + 1


@njit(cache=True, nogil=True)
def _end_of_foot(inverse, kind, low, u, intrinsics, T):  # type: ignore[no-untyped-def]
    """Lowest row of what stands below a pixel in its column, if floor follows it; else -1.

    The last centimetres of a foot are sorted with the floor: it ends where its lowest pixel stands.
    """
    v, last, seen = low + 1, low, False
    while v < len(kind) and v - last <= BLUR_PX:
        if kind[v, u] == FLOOR_PIXEL:
            return _row_below(inverse[last, u], last, u, intrinsics, T) if seen else -1
        if kind[v, u] in (OBSTACLE_PIXEL, FLYING_PIXEL):
            last, seen = v, True
        v += 1
    return -1


@njit(cache=True, nogil=True)
def _row_below(inverse, v, u, intrinsics, T):  # type: ignore[no-untyped-def]
    """Last row over the floor right below the point of a pixel, no higher than that pixel."""
    fx, fy, cx, cy = intrinsics
    z = 1.0 / inverse
    x, y = (u - cx) / fx * z - T[0, 3], (v - cy) / fy * z - T[1, 3]
    high = T[0, 2] * x + T[1, 2] * y + T[2, 2] * (z - T[2, 3])
    foot = (y + T[1, 3] - high * T[1, 2]) / max(z - high * T[2, 2], _NEAREST_Z_M)
    return max(int(np.ceil(foot * fy + cy)) - 1, v)


@njit(cache=True, nogil=True)
def depth_of_floor(T, intrinsics, u, v):  # type: ignore[no-untyped-def]
    """Depth in m at which the ray of a pixel meets the floor, inf where it does not fall."""
    _, _, _, _, az0, az1 = pixel_rays(T, intrinsics, v)
    rise = az0 + az1 * u
    above_floor = camera_height(T)
    return above_floor / -rise if rise < LEVEL else np.inf
