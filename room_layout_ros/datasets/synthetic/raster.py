"""Analytic ray casting of rectangles: each knows its place in the image, each pixel's depth is exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics

from .shapes import Surface

_NEAR_M = 0.01
_PATCH_BIAS = 1e-4
"""Relative inverse depth by which a patch is preferred to the wall it hangs on."""

Rectangles = NDArray[np.float64]


def camera_rectangles(surfaces: Sequence[Surface], T_world_camera: NDArray[np.float64]) -> Rectangles:
    """Return (n, 10) float64: origin, u, v in the camera frame and the patch flag."""
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    rows = np.empty((len(surfaces), 10))
    rows[:, 0:3] = (np.array([s.origin for s in surfaces]) - t) @ R
    rows[:, 3:6] = np.array([s.u for s in surfaces]) @ R
    rows[:, 6:9] = np.array([s.v for s in surfaces]) @ R
    rows[:, 9] = [s.patch for s in surfaces]
    return rows


def cast(rectangles: Rectangles, camera: CameraIntrinsics) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Cast one ray per pixel.

    Parameters
    ----------
    rectangles : (n, 10) float64, see `camera_rectangles`.

    Returns
    -------
    index : (H, W) int32 nearest rectangle, -1 where none is hit.
    depth_m : (H, W) float32 along the optical axis, inf where none is hit.
    """
    index = np.full((camera.height, camera.width), -1, np.int32)
    inverse = np.zeros((camera.height, camera.width))
    _cast_kernel(np.ascontiguousarray(rectangles), *camera.numbers, index, inverse)
    with np.errstate(divide="ignore"):
        return index, (1.0 / inverse).astype(np.float32)


@njit(cache=True, nogil=True)
def _window(corners, fx, fy, cx, cy, width, height):  # type: ignore[no-untyped-def]
    """Pixel range that holds the part of a convex polygon in front of the camera."""
    x0, y0, x1, y1 = width * 1.0, height * 1.0, -1.0, -1.0
    n = corners.shape[0]
    for i in range(n):
        j = (i + 1) % n
        for k in range(2):
            if k == 0:
                px, py, pz = corners[i, 0], corners[i, 1], corners[i, 2]
                if pz < _NEAR_M:
                    continue
            else:
                if (corners[i, 2] < _NEAR_M) == (corners[j, 2] < _NEAR_M):
                    continue
                s = (_NEAR_M - corners[i, 2]) / (corners[j, 2] - corners[i, 2])
                px = corners[i, 0] + s * (corners[j, 0] - corners[i, 0])
                py = corners[i, 1] + s * (corners[j, 1] - corners[i, 1])
                pz = _NEAR_M
            u, v = fx * px / pz + cx, fy * py / pz + cy
            x0, x1 = min(x0, u), max(x1, u)
            y0, y1 = min(y0, v), max(y1, v)
    left, top = int(max(0.0, np.floor(x0))), int(max(0.0, np.floor(y0)))
    right, bottom = int(min(width - 1.0, np.ceil(x1))), int(min(height - 1.0, np.ceil(y1)))
    return left, top, right, bottom


@njit(cache=True, nogil=True)
def _cast_kernel(rectangles, fx, fy, cx, cy, index, inverse):  # type: ignore[no-untyped-def]
    height, width = index.shape
    corners = np.empty((4, 3))
    for i in range(rectangles.shape[0]):
        o, u, v = rectangles[i, 0:3], rectangles[i, 3:6], rectangles[i, 6:9]
        for k in range(3):
            corners[0, k] = o[k]
            corners[1, k] = o[k] + u[k]
            corners[2, k] = o[k] + u[k] + v[k]
            corners[3, k] = o[k] + v[k]
        left, top, right, bottom = _window(corners, fx, fy, cx, cy, width, height)
        if left > right or top > bottom:
            continue
        n0 = u[1] * v[2] - u[2] * v[1]
        n1 = u[2] * v[0] - u[0] * v[2]
        n2 = u[0] * v[1] - u[1] * v[0]
        d = n0 * o[0] + n1 * o[1] + n2 * o[2]
        if abs(d) < 1e-12:
            continue
        uu = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        ou = (o[0] * u[0] + o[1] * u[1] + o[2] * u[2]) / uu
        ov = (o[0] * v[0] + o[1] * v[1] + o[2] * v[2]) / vv
        bias = 1.0 + _PATCH_BIAS * rectangles[i, 9]
        for y in range(top, bottom + 1):
            ry = (y - cy) / fy
            for x in range(left, right + 1):
                rx = (x - cx) / fx
                # All of these are affine in the pixel: w = 1/Z, and the place on the rectangle times w.
                w = (n0 * rx + n1 * ry + n2) / d
                if w * bias <= inverse[y, x]:
                    continue
                a = (rx * u[0] + ry * u[1] + u[2]) / uu - ou * w
                if a < 0.0 or a > w:
                    continue
                b = (rx * v[0] + ry * v[1] + v[2]) / vv - ov * w
                if b < 0.0 or b > w:
                    continue
                inverse[y, x] = w
                index[y, x] = i
