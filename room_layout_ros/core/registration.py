"""Depth of one camera as another camera would see it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics

_MAX_SPLAT_PX = 16
"""No depth pixel covers more than this of the other image in either direction, or more than `_TIMES_PX` of what a pixel
of such a coarse sensor covers there."""
_TIMES_PX = 2

_SAME_SURFACE = 0.1
"""Part of its depth by which a pixel may be nearer or farther than its neighbour on the same surface."""


def register_depth(
    depth_m: NDArray[np.float32],
    depth_camera: CameraIntrinsics,
    color_camera: CameraIntrinsics,
    T_color_depth: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return the depth image in the view of the colour camera.

    Each measured pixel is a small piece of surface: its corners, each at the mean depth of the pixels of that surface
    that meet there, are carried over and the box around them is filled, the nearest piece winning. So no holes appear
    where the colour image has more pixels, nor between the rows of a floor that is seen flat.

    Parameters
    ----------
    depth_m : (h, w) float32 array
        Metres in the depth camera; NaN or not above 0 where nothing was measured.
    depth_camera, color_camera : CameraIntrinsics
    T_color_depth : (4, 4) float64 array
        Takes points of the depth camera's optical frame to the colour camera's.

    Returns
    -------
    (H, W) float32 array, metres along the colour camera's axis, NaN where nothing was measured or seen.

    Raises
    ------
    ValueError
        When the image is not the depth camera's or the transform is not rigid.
    """
    if depth_m.shape != (depth_camera.height, depth_camera.width):
        raise ValueError(f"depth image has shape {depth_m.shape}; its camera says {depth_camera}")
    rotation = T_color_depth[:3, :3]
    if T_color_depth.shape != (4, 4) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
        raise ValueError("transform from depth to colour is not rigid; a rotation and a translation are needed")
    nearest = np.full((color_camera.height, color_camera.width), np.inf, np.float32)
    # p = K_c (R K_d^-1 (x, y, 1) z + t)
    per_pixel = color_camera.matrix @ rotation @ np.linalg.inv(depth_camera.matrix)
    offset = color_camera.matrix @ T_color_depth[:3, 3]
    larger = max(color_camera.fx / depth_camera.fx, color_camera.fy / depth_camera.fy)
    limit = max(_MAX_SPLAT_PX, _TIMES_PX * int(np.ceil(larger)))
    _splat(np.ascontiguousarray(depth_m, dtype=np.float32), per_pixel, offset, limit, nearest)
    nearest[np.isinf(nearest)] = np.nan
    return nearest


@njit(cache=True, nogil=True)
def _splat(depth_m, per_pixel, offset, limit, nearest):  # type: ignore[no-untyped-def]
    height, width = nearest.shape
    for y in range(depth_m.shape[0]):
        for x in range(depth_m.shape[1]):
            if not 0.0 < depth_m[y, x] < np.inf:
                continue
            left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
            behind = False
            for k in range(4):
                z = _corner_depth(depth_m, x, y, 2 * (k % 2) - 1, 2 * (k // 2) - 1)
                dx, dy = x - 0.5 + (k % 2), y - 0.5 + (k // 2)
                p = per_pixel[0, 0] * dx + per_pixel[0, 1] * dy + per_pixel[0, 2]
                q = per_pixel[1, 0] * dx + per_pixel[1, 1] * dy + per_pixel[1, 2]
                r = per_pixel[2, 0] * dx + per_pixel[2, 1] * dy + per_pixel[2, 2]
                far = r * z + offset[2]
                if far <= 1e-6:
                    behind = True
                    break
                u, v = (p * z + offset[0]) / far, (q * z + offset[1]) / far
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
            if behind or right - left > limit or bottom - top > limit:
                continue
            far = (per_pixel[2, 0] * x + per_pixel[2, 1] * y + per_pixel[2, 2]) * depth_m[y, x] + offset[2]
            # pixels whose centres lie in the box; the half-open end keeps neighbours apart
            for v_px in range(max(0, int(np.ceil(top))), min(height, int(np.ceil(bottom)))):
                for u_px in range(max(0, int(np.ceil(left))), min(width, int(np.ceil(right)))):
                    if far < nearest[v_px, u_px]:
                        nearest[v_px, u_px] = far


@njit(cache=True, nogil=True)
def _corner_depth(depth_m, x, y, right, down):  # type: ignore[no-untyped-def]
    """Mean depth of a pixel and of those of its surface at one of its corners; `right` and `down` are 1 or -1."""
    z = depth_m[y, x]
    total, count = np.float64(z), 1
    for n in range(1, 4):
        u, v = x + (n % 2) * right, y + (n // 2) * down
        if 0 <= u < depth_m.shape[1] and 0 <= v < depth_m.shape[0]:
            other = depth_m[v, u]
            if abs(other - z) < _SAME_SURFACE * z:
                total += other
                count += 1
    return total / count
