"""The paper's depth cues of superpixels: six cosines and six distances (paper 3.2; docs/evidence.md)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..superpixels import Superpixels

DIRECTIONS = np.array([[0, -1, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, -1]], dtype=np.float64)
"""Outward room directions of ceiling, floor, left, front and right face, and backwards as the sixth."""


def compute_depth_cues(
    superpixels: Superpixels, R_room_camera: NDArray[np.float64], camera: CameraIntrinsics
) -> NDArray[np.float64]:
    """Compute the paper's twelve depth features.

    Parameters
    ----------
    superpixels : Superpixels
        With planes; those without one have no cue.
    R_room_camera : (3, 3) float64
    camera : CameraIntrinsics

    Returns
    -------
    (K, 12) float64
        Columns 0..5: cosine between the superpixel's normal (away from the camera) and each of `DIRECTIONS`;
        6..11: metres from its centroid to that of the superpixel farthest along each. All 0 where there is no
        plane: in an energy that is linear in them, 0 says nothing.
    """
    return np.asarray(_cues(*superpixel_planes(superpixels, camera), np.ascontiguousarray(DIRECTIONS @ R_room_camera)))


@njit(cache=True, nogil=True)
def _cues(normal, _, centroid, directions):  # type: ignore[no-untyped-def]
    cues, farthest = np.zeros((len(normal), 12)), np.full(6, -np.inf)
    for k in range(len(normal)):
        if centroid[k, 0] == centroid[k, 0]:
            for d in range(6):
                x, y, z = directions[d, 0], directions[d, 1], directions[d, 2]
                cues[k, d] = normal[k, 0] * x + normal[k, 1] * y + normal[k, 2] * z
                cues[k, 6 + d] = centroid[k, 0] * x + centroid[k, 1] * y + centroid[k, 2] * z
                farthest[d] = max(farthest[d], cues[k, 6 + d])
    for k in range(len(normal)):
        if centroid[k, 0] == centroid[k, 0]:
            for d in range(6):
                cues[k, 6 + d] = farthest[d] - cues[k, 6 + d]
    return cues


def superpixel_planes(
    superpixels: Superpixels, camera: CameraIntrinsics
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the planes of superpixels in the camera frame.

    Returns
    -------
    normal : (K, 3) unit, away from the camera. distance : (K,) m of the plane to the camera.
    centroid : (K, 3) m, where the ray of the superpixel's centre meets its plane.
        NaN without a plane, or where that ray does not meet it.
    """
    normal, distance, centroid = _planes(superpixels.plane, superpixels.center_px, *camera.numbers)
    return normal, distance, centroid


@njit(cache=True, nogil=True, error_model="numpy")
def _planes(plane, centre, fx, fy, cx, cy):  # type: ignore[no-untyped-def]
    count = len(plane)
    normal, distance, centroid = np.empty((count, 3)), np.empty(count), np.full((count, 3), np.nan)
    for k in range(count):
        a, b, c = plane[k, 0], plane[k, 1], plane[k, 2]
        mx, my, mz = a * fx, b * fy, c + a * cx + b * cy  # n / d, method.md 3
        distance[k] = 1.0 / np.sqrt(mx * mx + my * my + mz * mz)
        normal[k, 0], normal[k, 1], normal[k, 2] = mx * distance[k], my * distance[k], mz * distance[k]
        x, y = float(centre[k, 0]), float(centre[k, 1])
        inverse = a * x + b * y + c
        if inverse > 0.0:
            z = 1.0 / inverse
            centroid[k, 0], centroid[k, 1], centroid[k, 2] = (x - cx) / fx * z, (y - cy) / fy * z, z
    return normal, distance, centroid
