"""The axes of a room: how they are named, how far two frames of axes are apart, and how they turn."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

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


@njit(cache=True, nogil=True)
def nearest_rotation(R):  # type: ignore[no-untyped-def]
    """The rotation nearest to a matrix that is nearly one (3, 3): many small turns add up their rounding."""
    u, _, vt = np.linalg.svd(R)
    return u @ vt


@njit(cache=True, nogil=True, inline="always")
def cross(a, b):  # type: ignore[no-untyped-def]
    """Cross product as three numbers; numpy's allocates."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def rotate_rows(R, vector):  # type: ignore[no-untyped-def]
    """Rotate each row of R by a rotation vector (Rodrigues)."""
    angle = np.sqrt((vector**2).sum())
    if angle < 1e-12:
        return R
    u = vector / angle
    c, s = np.cos(angle), np.sin(angle)
    turned = np.empty((3, 3))
    for k in range(3):
        dot = (u * R[k]).sum()
        turned[k] = c * R[k] + s * np.array(cross(u, R[k])) + (1.0 - c) * dot * u
    return turned
