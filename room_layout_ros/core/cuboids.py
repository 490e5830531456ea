"""Things as boxes that stand upright: touching clutter on the floor plan, with the class most of its pixels have."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry
from .estimate import RoomEstimate
from .floor.floor_frame import walls_on_floor
from .floor.floor_pixels import camera_height
from .freespace import FreeSpace
from .labels import CLUTTER

_STRIDE = 2
_LOWEST_M = 0.03
_BEFORE_WALL_M = 0.05
_MIN_CELL_POINTS, _CELL_PX = 4, 12.0
"""Points that a cell of a thing has; it is no smaller than so many of the looked-at pixels are at 1 m."""
_MAX_CELLS = 4_000_000
_TRIM = (1.0, 99.0)
"""Percentiles of the points that the box spans: the rest is noise."""

_BINS, _STRIPS = 1024, 256


@dataclass(frozen=True, slots=True)
class ObjectCuboid:
    """A box that stands upright.

    Attributes
    ----------
    center_m : (3,) float64 of the box, floor frame (x ahead, y left, z up).
    size_m : (3,) float64 along its own x, its own y and z; all above 0.
    yaw : float, radians, of its own x axis in the floor frame, -pi/4..pi/4.
    nyu40 : class of most of its classified pixels, 0 where none is classified.
    points : of the pixels that are looked at, one in four, those it is made of.
    """

    center_m: NDArray[np.float64]
    size_m: NDArray[np.float64]
    yaw: float
    nyu40: int
    points: int


def compute_object_cuboids(
    geometry: DepthGeometry, estimate: RoomEstimate, free_space: FreeSpace, config: EstimatorConfig
) -> tuple[ObjectCuboid, ...]:
    """Return the things in view as boxes, the largest first.

    Parameters
    ----------
    geometry, estimate : of one frame. free_space : FreeSpace of the same frame.
    config : EstimatorConfig
        `object_min_pixels` is the size below which a patch of clutter is no object.
    """
    camera, T = geometry.camera, free_space.T_camera_floor
    walls = walls_on_floor(estimate.cuboid if estimate.metric else None, T)
    points, classes = _clutter(geometry.inverse_depth, estimate.labels, estimate.furniture, camera.numbers, T, walls)
    if not len(points):
        return ()
    size = max(free_space.resolution_m, _CELL_PX * _STRIDE / camera.fx)
    low, shape = _bounds(points, size)
    if shape[0] * shape[1] > _MAX_CELLS:
        return ()
    plan, cell = _plan(points, low, size, shape)
    count, patch = cv2.connectedComponents(plan, connectivity=8)
    points, classes, start = _by_patch(points, classes, patch.ravel(), cell, count)
    boxes = []
    for k in range(1, count):
        mine = slice(start[k], start[k + 1])
        if (mine.stop - mine.start) * _STRIDE**2 >= config.object_min_pixels:
            boxes.append(_box(points[mine], classes[mine]))
    return tuple(sorted(boxes, key=lambda box: -box.points))


def _box(points: NDArray[np.float32], classes: NDArray[np.uint8]) -> ObjectCuboid:
    (_, _), (_, _), degrees = cv2.minAreaRect(_rim(points))
    yaw = float((np.deg2rad(degrees) + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    c, s = float(np.cos(yaw)), float(np.sin(yaw))
    low, high = _extent(points, c, s)
    middle, size = (low + high) / 2, np.maximum(high - low, 0.01)
    center = np.array([c * middle[0] - s * middle[1], s * middle[0] + c * middle[1], middle[2]])
    return ObjectCuboid(center, size, yaw, _most_frequent(classes), len(points))


@njit(cache=True, nogil=True)
def _most_frequent(classes):  # type: ignore[no-untyped-def]
    """The class that most classified pixels have; 0 where none is classified."""
    count = np.zeros(256, np.int64)
    for k in range(len(classes)):
        count[classes[k]] += 1
    count[0] = 0
    return np.argmax(count)


@njit(cache=True, nogil=True)
def _clutter(inverse, labels, furniture, intrinsics, T, walls):  # type: ignore[no-untyped-def]
    """Points (n, 3) in the floor frame and classes (n,) of clutter above the floor and before the walls."""
    fx, fy, cx, cy = intrinsics
    height, width = inverse.shape
    capacity = ((height + _STRIDE - 1) // _STRIDE) * ((width + _STRIDE - 1) // _STRIDE)
    points, classes = np.empty((capacity, 3), np.float32), np.empty(capacity, np.uint8)
    up = camera_height(T)
    count = 0
    for v in range(0, height, _STRIDE):
        ry = (v - cy) / fy
        for u in range(0, width, _STRIDE):
            if labels[v, u] != CLUTTER or inverse[v, u] <= 0.0:
                continue
            rx, z = (u - cx) / fx, 1.0 / inverse[v, u]
            h = up + (T[0, 2] * rx + T[1, 2] * ry + T[2, 2]) * z
            if h <= _LOWEST_M:
                continue
            x = (T[0, 0] * rx + T[1, 0] * ry + T[2, 0]) * z
            y = (T[0, 1] * rx + T[1, 1] * ry + T[2, 1]) * z
            inside = True
            for k in range(len(walls)):
                inside = inside and walls[k, 0] * x + walls[k, 1] * y < walls[k, 2] - _BEFORE_WALL_M
            if inside:
                points[count, 0], points[count, 1], points[count, 2] = x, y, h
                classes[count] = furniture[v, u]
                count += 1
    return points[:count], classes[:count]


@njit(cache=True, nogil=True)
def _bounds(points, size):  # type: ignore[no-untyped-def]
    """Lower corner (2,) of the points on the floor, and rows and columns of cells that hold them."""
    low, high = points[0, :2].copy(), points[0, :2].copy()
    for k in range(len(points)):
        for axis in range(2):
            low[axis], high[axis] = min(low[axis], points[k, axis]), max(high[axis], points[k, axis])
    return low, (int((high[1] - low[1]) * (1.0 / size)) + 1, int((high[0] - low[0]) * (1.0 / size)) + 1)


@njit(cache=True, nogil=True)
def _plan(points, low, size, shape):  # type: ignore[no-untyped-def]
    """Cells (rows, cols) uint8 with enough points, and the flat index (n,) of each point's cell."""
    count = np.zeros(shape[0] * shape[1], np.int32)
    cell = np.empty(len(points), np.int32)
    per_metre = 1.0 / size
    for k in range(len(points)):
        i, j = int((points[k, 1] - low[1]) * per_metre), int((points[k, 0] - low[0]) * per_metre)
        cell[k] = i * shape[1] + j
        count[cell[k]] += 1
    return (count >= _MIN_CELL_POINTS).astype(np.uint8).reshape(shape), cell


@njit(cache=True, nogil=True)
def _by_patch(points, classes, patch, cell, patches):  # type: ignore[no-untyped-def]
    """Points and classes in the order of their patch, and where each patch begins (patches + 1,)."""
    start = np.zeros(patches + 1, np.int64)
    for k in range(len(cell)):
        start[patch[cell[k]] + 1] += 1
    start = np.cumsum(start)
    fill = start[:-1].copy()
    sorted_points, sorted_classes = np.empty_like(points), np.empty_like(classes)
    for k in range(len(cell)):
        owner = patch[cell[k]]
        if owner > 0:
            at = fill[owner]
            sorted_points[at, 0], sorted_points[at, 1], sorted_points[at, 2] = points[k, 0], points[k, 1], points[k, 2]
            sorted_classes[at] = classes[k]
            fill[owner] += 1
    return sorted_points, sorted_classes, start


@njit(cache=True, nogil=True)
def _rim(points):  # type: ignore[no-untyped-def]
    """Points (m, 2) float32 that span the convex hull, to a 256th of its length: the outermost of strips along x."""
    low, high = points[:, 1].min(), points[:, 1].max()
    per_strip = _STRIPS / max(high - low, 1e-9)
    rim = np.empty((_STRIPS, 2, 2), np.float32)
    rim[:, 0, 0], rim[:, 1, 0] = np.inf, -np.inf
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        strip = min(int((y - low) * per_strip), _STRIPS - 1)
        if x < rim[strip, 0, 0]:
            rim[strip, 0, 0], rim[strip, 0, 1] = x, y
        if x > rim[strip, 1, 0]:
            rim[strip, 1, 0], rim[strip, 1, 1] = x, y
    flat = rim.reshape(-1, 2)
    return flat[np.isfinite(flat[:, 0])]


@njit(cache=True, nogil=True)
def _own_axes(point, c, s):  # type: ignore[no-untyped-def]
    x, y = np.float64(point[0]), np.float64(point[1])
    return c * x + s * y, c * y - s * x, np.float64(point[2])


@njit(cache=True, nogil=True)
def _extent(points, c, s):  # type: ignore[no-untyped-def]
    """Percentiles `_TRIM` (3,), (3,) along the box's own axes, to a thousandth of its length."""
    n = len(points)
    first, last = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(n):
        own = _own_axes(points[k], c, s)
        for axis in range(3):
            first[axis], last[axis] = min(first[axis], own[axis]), max(last[axis], own[axis])
    width = np.maximum(last - first, 1e-9) / _BINS
    per_metre = 1.0 / width
    count = np.zeros((3, _BINS), np.int32)
    for k in range(n):
        own = _own_axes(points[k], c, s)
        for axis in range(3):
            count[axis, min(int((own[axis] - first[axis]) * per_metre[axis]), _BINS - 1)] += 1
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        low[axis] = first[axis] + width[axis] * _rank(count[axis], 0.01 * _TRIM[0] * (n - 1) + 0.5)
        high[axis] = first[axis] + width[axis] * _rank(count[axis], 0.01 * _TRIM[1] * (n - 1) + 0.5)
    return low, high


@njit(cache=True, nogil=True)
def _rank(count, wanted):  # type: ignore[no-untyped-def]
    """Place in bins below which `wanted` of the counted lie, linear within the bin."""
    total = 0
    for k in range(len(count)):
        if total + count[k] >= wanted and count[k] > 0:
            return k + (wanted - total) / count[k]
        total += count[k]
    return float(len(count))
