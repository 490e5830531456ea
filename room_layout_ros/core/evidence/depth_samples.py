"""Points, normals and slopes of the depth image, of planes fitted to small windows of inverse depth.

The difference of two pixels of 8-bit depth is worth nothing. A window with too little measured has no sample.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..depth import plane_of_moments

SAMPLE_PX = 4
"""Distance of samples; they lie at multiples of it."""

_WINDOW_PX, _STRIDE_PX = 10, 2
"""A plane is fitted to every second pixel up to 10 px from the sample."""

_LEAST_SHARE = 0.5
"""Of a window's pixels that must be measured."""


@njit(cache=True, nogil=True, error_model="numpy")
def plane_samples(inverse_depth, fx, fy, cx, cy):  # type: ignore[no-untyped-def]
    """(h, w, 3) points in m, and unit normals away from the camera, of planes about every fourth pixel; or NaN."""
    height, width = inverse_depth.shape
    rows, columns = (height + SAMPLE_PX - 1) // SAMPLE_PX, (width + SAMPLE_PX - 1) // SAMPLE_PX
    points = np.full((rows, columns, 3), np.nan, np.float32)
    normals = np.full((rows, columns, 3), np.nan, np.float32)
    full = (2 * (_WINDOW_PX // _STRIDE_PX) + 1) ** 2
    for row in range(rows):
        for column in range(columns):
            y0, x0 = row * SAMPLE_PX, column * SAMPLE_PX
            n, sx, sy, sw, sxx, sxy, syy, sxw, syw = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for dy in range(-_WINDOW_PX, _WINDOW_PX + 1, _STRIDE_PX):
                if not 0 <= y0 + dy < height:
                    continue
                for dx in range(-_WINDOW_PX, _WINDOW_PX + 1, _STRIDE_PX):
                    if not 0 <= x0 + dx < width:
                        continue
                    w = inverse_depth[y0 + dy, x0 + dx]
                    if w > 0.0:
                        n += 1
                        sx += dx
                        sy += dy
                        sw += w
                        sxx += dx * dx
                        sxy += dx * dy
                        syy += dy * dy
                        sxw += dx * w
                        syw += dy * w
            if n < _LEAST_SHARE * full:
                continue
            # the last sum is for the residual, which is not asked
            (a, b, w), _, det, _, _ = plane_of_moments((float(n), sx, sy, sw, sxx, sxy, syy, sxw, syw, 0.0))
            if det < 1.0 or w <= 0.0:
                continue
            ray_x, ray_y = (x0 - cx) / fx, (y0 - cy) / fy
            nx, ny = a * fx, b * fy
            nz = w - nx * ray_x - ny * ray_y
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            points[row, column] = np.array((ray_x / w, ray_y / w, 1.0 / w), np.float32)
            normals[row, column] = np.array((nx / length, ny / length, nz / length), np.float32)
    return points, normals


@njit(cache=True, nogil=True, error_model="numpy")
def slope_samples(normals):  # type: ignore[no-untyped-def]
    """(h, w, 2) direction in the image along which depth grows, and (h, w) by how many metres a metre.

    The second is NaN where the normal is. Steeper than 10 counts as 10: at an edge of depth the plane of a window
    says little but where the edge runs.
    """
    height, width, _ = normals.shape
    direction = np.zeros((height, width, 2), np.float32)
    slope = np.full((height, width), np.nan, np.float32)
    for y in range(height):
        for x in range(width):
            nx, ny, nz = normals[y, x]
            across = np.sqrt(nx * nx + ny * ny)
            if across > 0.0:
                direction[y, x, 0], direction[y, x, 1] = -nx / across, -ny / across
            if nz == nz:
                slope[y, x] = min(across / max(abs(nz), np.float32(0.1) * across), np.float32(10.0))
    return direction, slope
