"""The paper's depth cues of superpixels: six cosines and six distances (paper 3.2; docs/evidence.md)."""

from __future__ import annotations

import numpy as np
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
    normal, _, centroid = superpixel_planes(superpixels, camera)
    cosines = normal @ R_room_camera.T @ DIRECTIONS.T
    along = centroid @ R_room_camera.T @ DIRECTIONS.T
    known = np.isfinite(along[:, 0])
    cues = np.zeros((superpixels.count, 12))
    if known.any():
        cues[known, :6] = cosines[known]
        cues[known, 6:] = along[known].max(axis=0) - along[known]
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
    a, b, c = superpixels.plane.T
    m = np.stack([a * camera.fx, b * camera.fy, c + a * camera.cx + b * camera.cy], axis=1)  # n / d, method.md 3
    length = np.linalg.norm(m, axis=1)
    x, y = superpixels.center_px[:, 0].astype(np.float64), superpixels.center_px[:, 1].astype(np.float64)
    inverse = a * x + b * y + c
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(inverse > 0, 1.0 / inverse, np.nan)
        ray = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=1)
        return m / length[:, None], 1.0 / length, ray * z[:, None]
