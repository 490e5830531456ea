"""What the pixels say about each cell of the floor: floor seen, things standing there, holes.

One pass over the image. A pixel's height over the floor is h = d - n . P, its standard deviation that of the floor
pixels at its depth. Floor pixels count where their ray meets the floor (free of the noise of their depth), with the
area they cover there, Z^3 / (d fx fy); things count where they are, with the area they would cover facing the camera,
Z^2 / (fx fy); a pixel below the floor counts as a hole where its ray goes through the floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry
from .depth_holes import BRIDGED, MEASURED
from .floor_plane import BAND_M, FloorFit, tile_offset

NOTHING, FLOOR_PIXEL, OBSTACLE_PIXEL, WALL_PIXEL, HOLE_PIXEL, BEYOND_PIXEL = range(6)
"""Kinds of pixels: not measured or over the robot, floor, thing, wall of the room, below the floor, beyond a wall."""

_ON_WALL_M = 0.02
_ON_WALL_SIGMAS = 3.0
_NEXT_TO_M = 0.02
_FAR_M = 3.0
_NEAR_GAIN = 1.5
_LOW = 3.0
"""A thing is low up to this many thresholds: its pixels raise the mean height of the cells behind their foot."""

_BETWEEN_PIXELS = 1.5
_MAX_BETWEEN_M = 0.10
_PER_METRE, _STEPS = 50.0, 700
_RIPPLE_ROWS = 4


@dataclass(frozen=True, slots=True)
class FloorCells:
    """Sums over the cells of a grid on the floor; rows along y, columns along x (the order of OccupancyGrid).

    Attributes
    ----------
    resolution_m, origin_m : side of a cell; x and y of the lower corner of cell (0, 0).
    seen : (rows, cols) float32 floor seen, as a share of the cell's area.
    height_m : (rows, cols) float32 mean height of the pixels of floor and of low things whose ray meets the floor
        there, NaN without any. floor_pixels : (rows, cols) int32 their number. obstacle_pixels : (rows, cols) int32.
    obstacle : (rows, cols) float32 visible surface of things, as a share of the cell's area.
    touched : (rows, cols) float32 the same, of things in the cell or within `_NEXT_TO_M` beside it.
    nearest_m : (rows, cols) float32 distance of the nearest thing in the cell from below the camera, inf without.
    farthest_m : (rows, cols) float32 how far the farthest may reach, -inf without.
    hole : (rows, cols) float32 floor that is missing, as a share of the cell's area.
    bridged, gap : (rows, cols) float32 floor behind pixels without depth, as a share of the cell's area: floor by the
        picture; not known.
    kind : (H, W) uint8 kind of each pixel. cell : (H, W) int32 flat index of the cell it counts in, -1 outside.
    """

    resolution_m: float
    origin_m: tuple[float, float]
    seen: NDArray[np.float32]
    height_m: NDArray[np.float32]
    floor_pixels: NDArray[np.int32]
    obstacle_pixels: NDArray[np.int32]
    obstacle: NDArray[np.float32]
    touched: NDArray[np.float32]
    nearest_m: NDArray[np.float32]
    farthest_m: NDArray[np.float32]
    hole: NDArray[np.float32]
    bridged: NDArray[np.float32]
    gap: NDArray[np.float32]
    kind: NDArray[np.uint8]
    cell: NDArray[np.int32]

    def centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y (rows, cols) of the cells' centres."""
        rows, cols = self.seen.shape
        x = self.origin_m[0] + (np.arange(cols) + 0.5) * self.resolution_m
        y = self.origin_m[1] + (np.arange(rows) + 0.5) * self.resolution_m
        return np.broadcast_to(x, (rows, cols)), np.broadcast_to(y[:, None], (rows, cols))


def sum_floor_cells(
    geometry: DepthGeometry,
    hole_kind: NDArray[np.uint8],
    fit: FloorFit,
    T_camera_floor: NDArray[np.float64],
    walls: NDArray[np.float64],
    config: EstimatorConfig,
) -> FloorCells:
    """Sort all pixels into the cells of the grid.

    Parameters
    ----------
    geometry : DepthGeometry
        With the holes in things filled.
    hole_kind : (H, W) uint8 of `close_holes`.
    fit : FloorFit
    T_camera_floor : (4, 4) float64, `floor_frame` of the fit.
    walls : (n, 4) float64 of `walls_on_floor`; what lies on them is wall, what lies beyond does not count.
    """
    size = config.free_space_resolution_m
    cols, rows = round(config.free_space_forward_m / size), 2 * round(config.free_space_side_m / size)
    origin = (0.0, -0.5 * rows * size)
    c = geometry.camera
    seen, total, floor, things, surface, touched, nearest, farthest, hole, bridged, gap, kind, cell = _sum_cells(
        geometry.inverse_depth, hole_kind, (c.fx, c.fy, c.cx, c.cy), T_camera_floor,
        (fit.distance_m, fit.sigma_m, fit.offset_m), walls,
        (origin[0], origin[1], size), (rows, cols),
        (config.obstacle_min_height_m, config.obstacle_noise_factor, config.robot_height_m),
    )  # fmt: skip
    with np.errstate(invalid="ignore"):
        height = (total / floor).astype(np.float32)
    return FloorCells(
        size, origin, seen, height, floor, things, surface, touched, nearest, farthest, hole, bridged, gap, kind, cell
    )


@njit(cache=True, nogil=True)
def band_sigma(sigma, z):  # type: ignore[no-untyped-def]
    """Noise of the height at depth z, linear between the middles of the bands."""
    position = min(max(z / BAND_M - 0.5, 0.0), len(sigma) - 1.001)
    low = int(position)
    return sigma[low] + (position - low) * (sigma[low + 1] - sigma[low])


@njit(cache=True, nogil=True)
def _touching(place, reach):  # type: ignore[no-untyped-def]
    """First and last cell that a point reaches into."""
    return int(np.floor(place - reach)), int(np.floor(place + reach))


@njit(cache=True, nogil=True)
def _sum_cells(inverse, hole_kind, intrinsics, T, fit, walls, corner, shape, limits):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = intrinsics
    distance, sigma, offset = fit
    x0, y0, size = corner
    rows, cols = shape
    lowest, factor, highest = limits
    height, width = inverse.shape
    seen = np.zeros((rows, cols), np.float32)
    total = np.zeros((rows, cols), np.float32)
    floor = np.zeros((rows, cols), np.int32)
    things = np.zeros((rows, cols), np.int32)
    surface = np.zeros((rows, cols), np.float32)
    touched = np.zeros((rows, cols), np.float32)
    nearest = np.full((rows, cols), np.inf, np.float32)
    farthest = np.full((rows, cols), -np.inf, np.float32)
    hole = np.zeros((rows, cols), np.float32)
    bridged = np.zeros((rows, cols), np.float32)
    gap = np.zeros((rows, cols), np.float32)
    kind = np.zeros((height, width), np.uint8)
    cell = np.full((height, width), -1, np.int32)
    per_pixel = 1.0 / (fx * fy * size * size)
    per_metre = 1.0 / size
    noise_at = np.empty(_STEPS)
    threshold_at = np.empty(_STEPS)
    for k in range(_STEPS):
        z = (k + 0.5) / _PER_METRE
        noise_at[k] = band_sigma(sigma, z)
        # Near the camera a thing covers many more pixels than a ripple of the noise: a lower threshold does.
        threshold_at[k] = max(lowest, (factor - min(max(_FAR_M - z, 0.0), _NEAR_GAIN)) * noise_at[k])
    ripple = np.empty(width)
    for v in range(height):
        ry = (v - cy) / fy
        # the ray in floor axes, from the camera at height `distance`
        ax0, ax1 = T[1, 0] * ry + T[2, 0] - T[0, 0] * cx / fx, T[0, 0] / fx
        ay0, ay1 = T[1, 1] * ry + T[2, 1] - T[0, 1] * cx / fx, T[0, 1] / fx
        az0, az1 = T[1, 2] * ry + T[2, 2] - T[0, 2] * cx / fx, T[0, 2] / fx
        if v % _RIPPLE_ROWS == 0:
            for u in range(width):
                ripple[u] = tile_offset(offset, u, v)
        for u in range(width):
            w = inverse[v, u]
            az = az0 + az1 * u
            if hole_kind[v, u] != MEASURED and az < -1e-3:
                z = -distance / az
                i = int(np.floor(((ay0 + ay1 * u) * z - y0) * per_metre))
                j = int(np.floor(((ax0 + ax1 * u) * z - x0) * per_metre))
                if 0 <= i < rows and 0 <= j < cols:
                    if hole_kind[v, u] == BRIDGED:
                        bridged[i, j] += per_pixel * z * z * z / distance
                    else:
                        gap[i, j] += per_pixel * z * z * z / distance
            if w <= 0.0:
                continue
            z = 1.0 / w
            h = distance + az * z - ripple[u]
            if h > highest:
                continue
            ax, ay = ax0 + ax1 * u, ay0 + ay1 * u
            step = min(int(z * _PER_METRE), _STEPS - 1)
            noise, threshold = noise_at[step], threshold_at[step]
            if h > threshold:
                x, y = ax * z, ay * z
                what = OBSTACLE_PIXEL
                tolerance = _ON_WALL_M + _ON_WALL_SIGMAS * noise * z / distance
                for k in range(len(walls)):
                    before = walls[k, 2] - walls[k, 0] * x - walls[k, 1] * y
                    if before < -tolerance:
                        what = BEYOND_PIXEL
                        break
                    if before < tolerance:
                        what = WALL_PIXEL
            else:
                if az > -1e-3:
                    continue
                what = FLOOR_PIXEL if h > -threshold else HOLE_PIXEL
                z = -distance / az
                x, y = ax * z, ay * z
            kind[v, u] = what
            i, j = int(np.floor((y - y0) * per_metre)), int(np.floor((x - x0) * per_metre))
            if i < 0 or j < 0 or i >= rows or j >= cols:
                continue
            cell[v, u] = i * cols + j
            if what == FLOOR_PIXEL:
                seen[i, j] += per_pixel * z * z * z / distance
                total[i, j] += h
                floor[i, j] += 1
            elif what == HOLE_PIXEL:
                hole[i, j] += per_pixel * z * z * z / distance
            elif what == OBSTACLE_PIXEL:
                surface[i, j] += per_pixel * z * z
                things[i, j] += 1
                first_i, last_i = _touching((y - y0) * per_metre, _NEXT_TO_M * per_metre)
                first_j, last_j = _touching((x - x0) * per_metre, _NEXT_TO_M * per_metre)
                for m in range(first_i, last_i + 1):
                    for n in range(first_j, last_j + 1):
                        if 0 <= m < rows and 0 <= n < cols:
                            touched[m, n] += per_pixel * z * z
                r = np.sqrt(x * x + y * y)
                nearest[i, j] = min(nearest[i, j], r)
                # the next row of a level surface that is seen flat may be centimetres behind this one
                between = _BETWEEN_PIXELS * z * z / (fy * max(distance - h, 0.05))
                farthest[i, j] = max(farthest[i, j], r + min(between, _MAX_BETWEEN_M))
                if az < -1e-3 and h < _LOW * threshold:
                    z = -distance / az
                    i = int(np.floor((ay * z - y0) * per_metre))
                    j = int(np.floor((ax * z - x0) * per_metre))
                    if 0 <= i < rows and 0 <= j < cols:
                        total[i, j] += h
                        floor[i, j] += 1
    return seen, total, floor, things, surface, touched, nearest, farthest, hole, bridged, gap, kind, cell
