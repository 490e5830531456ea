"""What the pixels say about each cell of the floor: floor seen, things standing there, holes.

One pass over the image. Floor pixels count where their ray meets the floor (free of the noise of their depth), with the
area they cover there, Z^3 / (d fx fy); things count where they are, with the area they would cover facing the camera,
Z^2 / (fx fy); a pixel below the floor counts as a hole where its ray goes through the floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..config import EstimatorConfig
from ..depth import DepthGeometry
from ..labels import CLUTTER
from .depth_holes import BRIDGED, MEASURED
from .floor_noise import noise_table
from .floor_pixels import (
    BESIDE_PX,
    BEYOND_PIXEL,
    DOWN,
    FLOOR_PIXEL,
    FLYING_PIXEL,
    HIGH_THING,
    HOLE_PIXEL,
    LOW_THING,
    NOTHING,
    OBSTACLE_PIXEL,
    UNSURE,
    WALL_PIXEL,
    exact_kind,
    flies_between,
    narrow_limits,
    pixel_rays,
    row_places,
    sort_row,
)
from .floor_plane import FloorFit

UNKNOWN_CELL, FREE_CELL, OCCUPIED_CELL = -1, 0, 100
"""Values of the grid, those of OccupancyGrid."""

_NEXT_TO_M = 0.02
_BETWEEN_PIXELS, _MAX_BETWEEN_M, _LEAST_BELOW_M = 1.5, 0.10, 0.05
"""A level surface goes on behind its farthest pixel by so many distances of the picture's rows on it, at most by so
much; the camera is taken to be no less than the last above it."""

_LONG_CELLS, _PARTS_PER_CELL, _MAX_PARTS = 0.5, 2.0, 16
"""A pixel that covers more of the floor along its ray than the first is shared among the cells it covers; in parts."""

(SEEN, HEIGHT, FLOOR_PIXELS, OBSTACLE, OBSTACLE_PIXELS, TOUCHED, FARTHEST, HOLE, BRIDGE, BLIND, FLYING) = range(11)
"""What is summed per cell; shares are of the cell's area.

Share of floor seen; sum of the heights of the pixels of floor and of low things whose ray meets the floor there, and
their number; share of the visible surface of things, and their pixels; the same share of things in the cell or within
`_NEXT_TO_M` beside it; how far in m from below the camera the farthest thing in it may reach (-inf without); shares of
floor that is missing, and of floor behind pixels without depth: floor by the picture; not known; surface of pixels that
hang between a near and a far surface: noise, or the side of a thing seen edge-on."""

_SUMS = 11

_SIDES = 4
"""Parts of a cell's side by what lies within `_NEXT_TO_M`: neither neighbour, the next, the one before, both."""

FINE = 4
"""Parts of a cell's side: where in a cell a thing stands is kept to a quarter of it."""


@dataclass(frozen=True, slots=True)
class FloorCells:
    """Sums over the cells of a grid on the floor; rows along y, columns along x (the order of OccupancyGrid).

    Attributes
    ----------
    resolution_m, origin_m : side of a cell; x and y of the lower corner of cell (0, 0).
    sums : (rows, cols, 11) float32, see `SEEN` and those after it.
    stands : (rows * FINE, cols * FINE) bool, a pixel of a thing is there.
    kind : (H, W) uint8 kind of each pixel. cell : (H, W) int32 flat index of the cell it counts in, -1 where in none.
    """

    resolution_m: float
    origin_m: tuple[float, float]
    sums: NDArray[np.float32]
    stands: NDArray[np.bool_]
    kind: NDArray[np.uint8]
    cell: NDArray[np.int32]

    @property
    def corner(self) -> tuple[float, float, float]:
        """Lower corner x, y of cell (0, 0), and the side of a cell; m."""
        return (*self.origin_m, self.resolution_m)


def sum_floor_cells(
    geometry: DepthGeometry,
    hole_kind: NDArray[np.uint8],
    labels: NDArray[np.uint8],
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
    labels : (H, W) uint8 of the estimate: clutter on a wall is a thing.
    fit : FloorFit
    T_camera_floor : (4, 4) float64, `floor_frame` of the fit.
    walls : (n, 4) float64 of `walls_on_floor`; what lies on them is wall, what lies beyond does not count. With
        `free_beyond_walls` a wall stands where its pixels are, and what lies beyond are things.
    """
    size = config.free_space_resolution_m
    cols, rows = round(config.free_space_forward_m / size), 2 * round(config.free_space_side_m / size)
    origin = (0.0, -0.5 * rows * size)
    sums, stands, kind, cell = _sum_cells(
        geometry.inverse_depth, hole_kind, labels, geometry.camera.numbers, T_camera_floor,
        (fit.distance_m, fit.sigma_m), walls, (*origin, size), (rows, cols),
        (config.obstacle_min_height_m, config.obstacle_noise_factor, config.robot_height_m), config.free_beyond_walls,
    )  # fmt: skip
    return FloorCells(size, origin, sums, stands, kind, cell)


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_cells(inverse, hole_kind, labels, intrinsics, T, fit, walls, corner, shape, limits, past_walls):  # type: ignore[no-untyped-def]
    distance, sigma = fit
    x0, y0, size = corner
    rows, cols = shape
    height, width = inverse.shape
    sums = np.zeros((rows, cols, _SUMS), np.float32)
    sums[:, :, FARTHEST] = -np.inf
    # The parts of a cell are set to 0 when the first thing is seen there: of a large grid most are never touched.
    surface = np.empty((rows * cols, _SIDES * _SIDES), np.float32)
    stands = np.zeros((rows * FINE, cols * FINE), np.bool_)
    kind = np.empty((height, width), np.uint8)
    cell = np.full((height, width), -1, np.int32)
    grid = (x0, y0, 1.0 / size, rows, cols)
    fy = intrinsics[1]
    per_pixel = np.float32(1.0 / (intrinsics[0] * fy * size * size))  # share of a cell that a pixel is at 1 m
    fall = np.sqrt((T[0, 2] / intrinsics[0]) ** 2 + (T[1, 2] / fy) ** 2) / distance
    noise_at = noise_table(sigma)
    noise_32, limits_32 = noise_at.astype(np.float32), narrow_limits(limits)
    column = np.arange(width).astype(np.float32)
    places = np.empty_like(column), np.empty_like(column), np.empty_like(column)
    scratch = np.empty_like(column), np.empty_like(column), np.empty_like(column)
    for v in range(height):
        rays = pixel_rays(T, intrinsics, v)
        row_places(inverse[v], column, rays, distance, walls, places)
        sort_row(inverse[v], labels[v], column, rays, distance, places, noise_32, limits_32, scratch, kind[v])
        if _has_holes(hole_kind[v]):
            _add_holes(hole_kind[v], rays, (distance, fy, per_pixel, fall), grid, sums)
        _add_row(
            inverse[v], labels[v], rays, (distance, fy, per_pixel, fall), places, noise_at, limits, grid, past_walls,
            kind[v], cell[v], (sums, surface, stands),
        )  # fmt: skip
    _spread(surface, _NEXT_TO_M / size, sums)
    return sums, stands, kind, cell


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _foot(rays, u, distance, grid):  # type: ignore[no-untyped-def]
    """Depth where the ray of a pixel meets the floor, and row and column of the cell there; a row below 0: outside."""
    ax0, ax1, ay0, ay1, az0, az1 = rays
    x0, y0, per_metre, rows, cols = grid
    z = -distance / (az0 + az1 * u)
    i = int(np.floor(((ay0 + ay1 * u) * z - y0) * per_metre))
    j = int(np.floor(((ax0 + ax1 * u) * z - x0) * per_metre))
    return z, i if i < rows and 0 <= j < cols else -1, j


@njit(cache=True, nogil=True, error_model="numpy")
def _share_out(sums, which, z, across, fall, per_pixel, grid):  # type: ignore[no-untyped-def]
    """Add a pixel of floor to the cells that it covers along its ray.

    `across` : way ahead and to the left per metre of depth. `fall` : by how much the inverse depth of the floor differs
    from one pixel to the next. `per_pixel` : share of a cell that a pixel covers at 1 m, over the camera's height.
    """
    x0, y0, per_metre, rows, cols = grid
    n = min(int(_PARTS_PER_CELL * z * z * fall * per_metre) + 1, _MAX_PARTS)
    for k in range(n):
        nearness = 1.0 / z + ((k + 0.5) / n - 0.5) * fall
        if nearness <= 0.0:  # the pixel reaches the horizon
            continue
        part = 1.0 / nearness
        i, j = int(np.floor((across[1] * part - y0) * per_metre)), int(np.floor((across[0] * part - x0) * per_metre))
        if 0 <= i < rows and 0 <= j < cols:
            sums[i, j, which] += per_pixel * part * part * part / n


@njit(cache=True, nogil=True, error_model="numpy")
def _add_holes(hole_kinds, rays, camera, grid, sums):  # type: ignore[no-untyped-def]
    """Add the pixels of a row without depth to the cells that they would be floor of."""
    distance, _, per_pixel, fall = camera
    for u in range(len(hole_kinds)):
        if hole_kinds[u] == MEASURED or rays[4] + rays[5] * u >= DOWN:
            continue
        z, i, j = _foot(rays, u, distance, grid)
        if i >= 0:
            which = BRIDGE if hole_kinds[u] == BRIDGED else BLIND
            if z * z * fall * grid[2] < _LONG_CELLS:
                sums[i, j, which] += per_pixel * z * z * z / distance
            else:
                across = rays[0] + rays[1] * u, rays[2] + rays[3] * u
                _share_out(sums, which, z, across, fall, per_pixel / distance, grid)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")  # a call would hand over all these arrays per row
def _add_row(inverse, labels, rays, camera, places, noise_at, limits, grid, past_walls, kinds, cell, cells):  # type: ignore[no-untyped-def]
    """Add the pixels of a row to the cells; write their final kinds, and the cells they count in."""
    ax0, ax1, ay0, ay1, az0, az1 = rays
    distance, fy, per_pixel, fall = camera
    depth, high, inside = places
    sums, surface, stands = cells
    lowest, factor, _ = limits
    x0, y0, per_metre, rows, cols = grid
    reach = _NEXT_TO_M * per_metre
    whole, width = int(reach), len(kinds)
    for u in range(width):
        what = np.int64(kinds[u])
        if what == NOTHING or (what in (WALL_PIXEL, BEYOND_PIXEL) and not past_walls):
            continue
        h, z, az = high[u], np.float64(depth[u]), az0 + az1 * u
        x, y = (ax0 + ax1 * u) * z, (ay0 + ay1 * u) * z
        if what == UNSURE:
            inner = BESIDE_PX <= u < width - BESIDE_PX
            flies = inner and flies_between(inverse[u - BESIDE_PX], inverse[u], inverse[u + BESIDE_PX])
            on_clutter = labels[u] == CLUTTER
            what = exact_kind(h, z, x, y, az, inside[u], on_clutter, flies, noise_at, (lowest, factor, distance))
            kinds[u] = what
        on_wall = what == WALL_PIXEL
        if past_walls and (on_wall or what == BEYOND_PIXEL):
            what = np.int64(HIGH_THING)
        if what in (FLOOR_PIXEL, HOLE_PIXEL):
            z, i, j = _foot(rays, u, distance, grid)
            if i < 0:
                continue
            cell[u] = i * cols + j
            if what == HOLE_PIXEL:
                sums[i, j, HOLE] += per_pixel * z * z * z / distance
                continue
            if z * z * fall * per_metre < _LONG_CELLS:
                sums[i, j, SEEN] += per_pixel * z * z * z / distance
            else:
                _share_out(sums, SEEN, z, (ax0 + ax1 * u, ay0 + ay1 * u), fall, per_pixel / distance, grid)
            sums[i, j, HEIGHT] += h
            sums[i, j, FLOOR_PIXELS] += np.float32(1.0)
        elif what >= FLYING_PIXEL:
            if not on_wall:
                kinds[u] = FLYING_PIXEL if what == FLYING_PIXEL else OBSTACLE_PIXEL
            across, ahead = (y - y0) * per_metre, (x - x0) * per_metre
            i, j = int(np.floor(across)), int(np.floor(ahead))
            if i < 0 or j < 0 or i >= rows or j >= cols:
                continue
            area = per_pixel * z * z
            if what == FLYING_PIXEL:
                sums[i, j, FLYING] += area
                continue
            cell[u] = i * cols + j
            if sums[i, j, OBSTACLE_PIXELS] == 0.0:
                for k in range(_SIDES * _SIDES):
                    surface[i * cols + j, k] = 0.0
            sums[i, j, OBSTACLE_PIXELS] += np.float32(1.0)
            stands[int(across * FINE), int(ahead * FINE)] = True
            low_i, high_i = across - reach < i - whole, across + reach >= i + whole + 1
            low_j, high_j = ahead - reach < j - whole, ahead + reach >= j + whole + 1
            surface[i * cols + j, low_i << 3 | high_i << 2 | low_j << 1 | high_j] += np.float32(area)
            # the next row of a level surface that is seen flat may be centimetres behind this one
            between = _BETWEEN_PIXELS * z * z / (fy * max(distance - h, _LEAST_BELOW_M))
            far = np.float32(np.sqrt(x * x + y * y) + min(between, _MAX_BETWEEN_M))
            sums[i, j, FARTHEST] = max(sums[i, j, FARTHEST], far)
            if what == LOW_THING and az < DOWN:
                z, i, j = _foot(rays, u, distance, grid)
                if i >= 0:
                    sums[i, j, HEIGHT] += h
                    sums[i, j, FLOOR_PIXELS] += np.float32(1.0)


@njit(cache=True, nogil=True)
def _has_holes(hole_kinds):  # type: ignore[no-untyped-def]
    count = 0
    for u in range(len(hole_kinds)):
        count += hole_kinds[u] != MEASURED
    return count > 0


@njit(cache=True, nogil=True)
def _spread(surface, reach, sums):  # type: ignore[no-untyped-def]
    """Write the surface of things per cell, and in the cell or beside it, from that in its `_SIDES` squared parts."""
    rows, cols, _ = sums.shape
    whole = int(reach)
    for i in range(rows):
        for j in range(cols):
            if sums[i, j, OBSTACLE_PIXELS] == 0.0:
                continue
            for k in range(_SIDES * _SIDES):
                area = surface[i * cols + j, k]
                if area == 0.0:
                    continue
                sums[i, j, OBSTACLE] += area
                low_i, high_i, low_j, high_j = k >> 3 & 1, k >> 2 & 1, k >> 1 & 1, k & 1
                for m in range(max(i - whole - low_i, 0), min(i + whole + high_i + 1, rows)):
                    for n in range(max(j - whole - low_j, 0), min(j + whole + high_j + 1, cols)):
                        sums[m, n, TOUCHED] += area
