"""Things as boxes that stand upright: touching clutter on the floor plan, with the class most of its pixels have."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry
from .estimate import RoomEstimate
from .floor_frame import walls_on_floor
from .freespace import FreeSpace
from .labels import CLUTTER

_STRIDE = 2
_LOWEST_M = 0.03
_BEFORE_WALL_M = 0.05
_MIN_CELL_POINTS = 4
_MAX_CELLS = 4_000_000
_TRIM = (1.0, 99.0)
"""Percentiles of the points that the box spans: the rest is noise."""


@dataclass(frozen=True, slots=True)
class ObjectCuboid:
    """A box that stands upright.

    Attributes
    ----------
    center_m : (3,) float64 of the box, floor frame (x ahead, y left, z up).
    size_m : (3,) float64 along its own x, its own y and z; all above 0.
    yaw : float, radians, of its own x axis in the floor frame, -pi/4..pi/4.
    nyu40 : class of most of its classified pixels, 0 where none is classified.
    share : of its pixels that have that class, 0..1.
    points : number of pixels it is made of (one in four is looked at).
    """

    center_m: NDArray[np.float64]
    size_m: NDArray[np.float64]
    yaw: float
    nyu40: int
    share: float
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
    points, classes = _clutter(geometry, estimate, free_space)
    if not len(points):
        return ()
    size = free_space.resolution_m
    low = points[:, :2].min(axis=0)
    cell = ((points[:, :2] - low) / size).astype(int)
    shape = (int(cell[:, 1].max()) + 1, int(cell[:, 0].max()) + 1)
    if shape[0] * shape[1] > _MAX_CELLS:
        return ()
    plan = np.zeros(shape, np.int32)
    np.add.at(plan, (cell[:, 1], cell[:, 0]), 1)
    count, patch = cv2.connectedComponents((plan >= _MIN_CELL_POINTS).astype(np.uint8), connectivity=8)
    owner = patch[cell[:, 1], cell[:, 0]]
    boxes = []
    for k in range(1, count):
        mine = owner == k
        if mine.sum() * _STRIDE**2 >= config.object_min_pixels:
            boxes.append(_box(points[mine], classes[mine]))
    return tuple(sorted(boxes, key=lambda box: -box.points))


def _clutter(
    geometry: DepthGeometry, estimate: RoomEstimate, free_space: FreeSpace
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Points (n, 3) in the floor frame and classes (n,) of clutter above the floor and before the walls."""
    labels = estimate.labels[::_STRIDE, ::_STRIDE]
    inverse = geometry.inverse_depth[::_STRIDE, ::_STRIDE]
    chosen = (labels == CLUTTER) & (inverse > 0)
    T = free_space.T_camera_floor
    camera = geometry.camera.rays()[::_STRIDE, ::_STRIDE][chosen] / inverse[chosen][:, None]
    points = (camera - T[:3, 3]) @ T[:3, :3]
    keep = points[:, 2] > _LOWEST_M
    for a, b, c, _ in walls_on_floor(estimate.cuboid if estimate.metric else None, T):
        keep &= a * points[:, 0] + b * points[:, 1] < c - _BEFORE_WALL_M
    return points[keep], estimate.furniture[::_STRIDE, ::_STRIDE][chosen][keep]


def _box(points: NDArray[np.float64], classes: NDArray[np.uint8]) -> ObjectCuboid:
    (_, _), (_, _), degrees = cv2.minAreaRect(points[:, :2].astype(np.float32))
    yaw = float((np.deg2rad(degrees) + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    c, s = np.cos(yaw), np.sin(yaw)
    own = np.stack([c * points[:, 0] + s * points[:, 1], c * points[:, 1] - s * points[:, 0], points[:, 2]], axis=1)
    low, high = np.percentile(own, _TRIM, axis=0)
    middle, size = (low + high) / 2, np.maximum(high - low, 0.01)
    center = np.array([c * middle[0] - s * middle[1], s * middle[0] + c * middle[1], middle[2]])
    known = np.bincount(classes[classes > 0], minlength=1)
    nyu40 = int(np.argmax(known)) if known.sum() else 0
    share = float(known[nyu40] / len(classes)) if nyu40 else 0.0
    return ObjectCuboid(center, size, yaw, nyu40, share, len(points))
