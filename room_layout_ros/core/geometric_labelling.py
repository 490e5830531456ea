"""The simple labelling: a superpixel belongs to the face whose plane it lies on, else it is clutter."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import DepthGeometry, depth_sigma
from .labels import CLUTTER
from .layout import RoomCuboid

_ON_PLANE_M = 0.10
"""A wall carries pictures, sockets and door frames: nearer than this to its plane is the wall."""


def label_by_geometry(
    cuboid: RoomCuboid, layout: NDArray[np.uint8], geometry: DepthGeometry, superpixels: NDArray[np.int32], count: int
) -> NDArray[np.uint8]:
    """Label superpixels by their distance to the room.

    Parameters
    ----------
    cuboid : RoomCuboid
    layout : (H, W) uint8, its raster.
    geometry : DepthGeometry
    superpixels : (H, W) int32 index 0..count-1

    Returns
    -------
    (count,) uint8 labels 1..6: the face most of its pixels are on, clutter where most stand in front.
    Superpixels without depth take their layout face.
    """
    votes = _votes(cuboid.inverse_normals, layout, geometry.inverse_depth, geometry.camera.rays(), superpixels, count)
    labels = np.argmax(votes[:, 1:6], axis=1) + 1
    labels[votes[:, CLUTTER] > 0.5 * votes.sum(axis=1)] = CLUTTER
    return labels.astype(np.uint8)


@njit(cache=True, nogil=True)
def _votes(planes, layout, inverse, rays, index, count):  # type: ignore[no-untyped-def]
    votes = np.zeros((count, 7))
    height, width = layout.shape
    for y in range(height):
        for x in range(width):
            face = layout[y, x]
            if face == 0:
                continue
            w = inverse[y, x]
            if w <= 0:
                votes[index[y, x], face] += 0.01  # no depth: decides only where there is no other vote
                continue
            k = face - 1
            m = planes[k, 0] * rays[y, x, 0] + planes[k, 1] * rays[y, x, 1] + planes[k, 2]
            length = np.sqrt(planes[k, 0] ** 2 + planes[k, 1] ** 2 + planes[k, 2] ** 2)
            gap = (1.0 - m / w) / length  # metres in front of the plane, along its normal
            tolerance = _ON_PLANE_M + 2.0 * depth_sigma(1.0 / w)
            if gap > tolerance:
                votes[index[y, x], 6] += 1.0
            else:
                votes[index[y, x], face] += 1.0
    return votes
