"""The axes of a room: how they are named, and how far two frames of axes are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .axes_refinement import cross

AXIS_TURNS: NDArray[np.float64] = Rotation.create_group("O").as_matrix().round()
"""(24, 3, 3) rotations of the cube: they map axes onto axes."""


def name_axes(R: NDArray[np.float64], gravity: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Order and sign three orthogonal rows as X right, Y down, Z front (the one nearest the optical axis).

    `gravity` : (3,) float64 down in the camera frame, of any length; without it the camera is taken to be upright.
    """
    down = np.array([0.0, 1.0, 0.0]) if gravity is None else gravity
    k = int(np.argmax(np.abs(R @ down)))
    y = R[k] * np.sign(R[k] @ down)
    horizontal = [R[j] for j in range(3) if j != k]
    z = max(horizontal, key=lambda v: abs(v[2]))
    z = z if z[2] >= 0 else -z
    return np.array([cross(y, z), y, z])


def other_front(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the frame with the other horizontal axis as front (towards the camera's view)."""
    x, y, _ = R
    z = x if x[2] >= 0 else -x
    return np.array([cross(y, z), y, z])


def angle_between_axes(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle in radians between two frames of axes (3, 3), whatever the axes are called; at most 62.8 deg."""
    trace = np.einsum("kij,ji->k", AXIS_TURNS, first @ second.T).max()
    return float(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))
