"""The slow obvious twin of `core.registration`: intersect each pixel's ray of the colour camera with the squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics


def register_depth(
    depth_m: NDArray[np.float32], depth_camera: CameraIntrinsics, color_camera: CameraIntrinsics, T: NDArray[np.float64]
) -> NDArray[np.float32]:
    """For each colour pixel, the nearest depth pixel whose carried-over box holds the pixel's centre."""
    registered = np.full((color_camera.height, color_camera.width), np.nan, np.float32)
    for y in range(depth_camera.height):
        for x in range(depth_camera.width):
            z = depth_m[y, x]
            if not np.isfinite(z) or z <= 0:
                continue
            corners = [
                carry(x + 0.5 * i, y + 0.5 * j, corner_depth(depth_m, x, y, i, j), depth_camera, T)
                for i in (-1, 1)
                for j in (-1, 1)
            ]
            if min(p[2] for p in corners) <= 0:
                continue
            pixels = np.array([project(p, color_camera) for p in corners])
            low, high = pixels.min(axis=0), pixels.max(axis=0)
            far = carry(x, y, z, depth_camera, T)[2]
            for v in range(color_camera.height):
                for u in range(color_camera.width):
                    inside = low[0] <= u < high[0] and low[1] <= v < high[1]
                    if inside and not registered[v, u] <= far:
                        registered[v, u] = far
    return registered


def corner_depth(depth_m: NDArray[np.float32], x: int, y: int, right: int, down: int) -> float:
    """Mean of the pixels that meet at a corner and differ by less than a tenth."""
    z, meet = float(depth_m[y, x]), []
    for u, v in ((x, y), (x + right, y), (x, y + down), (x + right, y + down)):
        if 0 <= u < depth_m.shape[1] and 0 <= v < depth_m.shape[0] and abs(float(depth_m[v, u]) - z) < 0.1 * z:
            meet.append(float(depth_m[v, u]))
    return float(np.mean(meet))


def carry(x: float, y: float, z: float, camera: CameraIntrinsics, T: NDArray[np.float64]) -> NDArray[np.float64]:
    point = np.array([(x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z, 1.0])
    carried: NDArray[np.float64] = (T @ point)[:3]
    return carried


def project(point: NDArray[np.float64], camera: CameraIntrinsics) -> NDArray[np.float64]:
    return np.array([camera.fx * point[0] / point[2] + camera.cx, camera.fy * point[1] / point[2] + camera.cy])
