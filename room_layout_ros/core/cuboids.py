"""Things in the room as boxes that stand upright: connected clutter, each part measured as far as it is seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry
from .estimate import RoomEstimate
from .labels import CLUTTER

_STRIDE = 2
_JUMP = 0.04
"""Neighbours whose distances differ by more than this share belong to different things (8 cm at 2 m)."""
_TAIL = 0.01
"""Share of the points left outside a box on each side: flying pixels."""
_ON_FLOOR_M = 0.1
"""What begins lower than this stands on the floor; its foot is hidden by itself or lost in the noise."""
_TURNED_GAIN = 0.75
"""A box across the room's axes is believed when its footprint is smaller than this share of the aligned one."""


@dataclass(frozen=True, slots=True)
class ObjectCuboid:
    """A thing as an upright box; only what is seen counts, so a cupboard seen from the front is thin.

    Attributes
    ----------
    T_camera_object : (4, 4) float64 pose of the centre; z up, x along the longer horizontal side.
    size_m : (3,) float64 along x, y, z of the box.
    nyu40 : class id, 0 where none is known.
    pixels : image pixels it covers, about.
    """

    T_camera_object: NDArray[np.float64]
    size_m: NDArray[np.float64]
    nyu40: int
    pixels: int


def find_objects(
    geometry: DepthGeometry, estimate: RoomEstimate, T_camera_floor: NDArray[np.float64], config: EstimatorConfig
) -> tuple[ObjectCuboid, ...]:
    """Find the things of a frame, the largest in the image first.

    Parameters
    ----------
    geometry : DepthGeometry
    estimate : RoomEstimate
        Of the same frame: clutter, furniture classes, the room's axes.
    T_camera_floor : (4, 4) float64
        Floor frame, z up (`FreeSpace.T_camera_floor`).
    config : EstimatorConfig

    Returns
    -------
    tuple of ObjectCuboid
        At most `config.object_max_count`, each covering `config.object_min_share` of the image or more.
    """
    labels, classes = estimate.labels[::_STRIDE, ::_STRIDE], estimate.furniture[::_STRIDE, ::_STRIDE]
    inverse = np.where(labels == CLUTTER, geometry.inverse_depth[::_STRIDE, ::_STRIDE], np.float32(0))
    part, count = _connected(inverse, np.ascontiguousarray(classes), _JUMP)
    if count == 0:
        return ()
    sizes = np.bincount(part[part >= 0], minlength=count)
    smallest = max(8, int(config.object_min_share * part.size))
    chosen = [int(k) for k in np.argsort(-sizes, kind="stable")[: config.object_max_count] if sizes[k] >= smallest]
    points = geometry.points(_STRIDE)
    yaw = _room_yaw(estimate, T_camera_floor)
    return tuple(_box(points[part == k], classes[part == k], T_camera_floor, yaw) for k in chosen)


def _room_yaw(estimate: RoomEstimate, T_camera_floor: NDArray[np.float64]) -> float | None:
    """Angle of the room's X axis in the floor frame, None without a room."""
    if estimate.cuboid is None:
        return None
    x, y, _ = T_camera_floor[:3, :3].T @ estimate.cuboid.R_room_camera[0]
    return float(np.arctan2(y, x))


def _box(
    points: NDArray[np.float32], classes: NDArray[np.uint8], T_camera_floor: NDArray[np.float64], yaw: float | None
) -> ObjectCuboid:
    on_floor = (points - T_camera_floor[:3, 3]) @ T_camera_floor[:3, :3]
    footprint = on_floor[:, :2]
    (_, _), (_, _), turn = cv2.minAreaRect(_trimmed(footprint).astype(np.float32))
    turned = float(np.deg2rad(turn))
    best = turned if yaw is None or _area(footprint, turned) < _TURNED_GAIN * _area(footprint, yaw) else yaw
    low, high = _extent(footprint, best)
    size, middle = high - low, 0.5 * (low + high)
    if size[1] > size[0]:  # x is the longer side
        best, size, middle = best + np.pi / 2, size[::-1], np.array([middle[1], -middle[0]])
    bottom, top = np.quantile(on_floor[:, 2], (_TAIL, 1.0 - _TAIL))
    bottom = 0.0 if bottom < _ON_FLOOR_M else bottom
    top = max(float(top), float(bottom) + 1e-3)
    c, s = np.cos(best), np.sin(best)
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = (c * middle[0] - s * middle[1], s * middle[0] + c * middle[1], 0.5 * (bottom + top))
    named = np.bincount(classes)
    return ObjectCuboid(
        T_camera_object=T_camera_floor @ pose,
        size_m=np.array([size[0], size[1], top - bottom]),
        nyu40=int(named.argmax()),
        pixels=len(points) * _STRIDE**2,
    )


def _trimmed(footprint: NDArray[np.floating]) -> NDArray[np.floating]:
    """Leave out the points farthest from the median, which would turn a smallest rectangle."""
    distance = np.abs(footprint - np.median(footprint, axis=0)).max(axis=1)
    return footprint[distance <= np.quantile(distance, 1.0 - 2 * _TAIL)]


def _extent(footprint: NDArray[np.floating], yaw: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper corner (2,) in axes turned by `yaw`, without the tails."""
    c, s = np.cos(yaw), np.sin(yaw)
    along = footprint @ np.array([[c, -s], [s, c]])
    low, high = np.quantile(along, (_TAIL, 1.0 - _TAIL), axis=0)
    return low, np.maximum(high, low + 1e-3)


def _area(footprint: NDArray[np.floating], yaw: float) -> float:
    low, high = _extent(footprint, yaw)
    return float(np.prod(high - low))


@njit(cache=True, nogil=True)
def _connected(inverse, classes, jump):  # type: ignore[no-untyped-def]
    """Number the connected parts; 4-neighbours of one class whose distances agree are connected."""
    height, width = inverse.shape
    part = np.full((height, width), -1, np.int32)
    stack = np.empty(height * width, np.int32)
    count = 0
    for y0 in range(height):
        for x0 in range(width):
            if part[y0, x0] >= 0 or inverse[y0, x0] <= 0.0:
                continue
            part[y0, x0] = count
            stack[0] = y0 * width + x0
            left = 1
            while left > 0:
                left -= 1
                y, x = stack[left] // width, stack[left] % width
                w = inverse[y, x]
                for k in range(4):
                    v, u = y + (k == 0) - (k == 1), x + (k == 2) - (k == 3)
                    if not (0 <= v < height and 0 <= u < width) or part[v, u] >= 0:
                        continue
                    other = inverse[v, u]
                    if other > 0.0 and classes[v, u] == classes[y, x] and abs(other - w) <= jump * max(other, w):
                        part[v, u] = count
                        stack[left] = v * width + u
                        left += 1
            count += 1
    return part, count
