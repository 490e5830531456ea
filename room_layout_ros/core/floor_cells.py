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
from .floor_plane import BAND_M, FloorFit
from .labels import CLUTTER

UNKNOWN_CELL, FREE_CELL, OCCUPIED_CELL = -1, 0, 100
"""Values of the grid, those of OccupancyGrid."""

NOTHING, FLOOR_PIXEL, OBSTACLE_PIXEL, WALL_PIXEL, HOLE_PIXEL, BEYOND_PIXEL = range(6)
"""Kinds of pixels: not measured or over the robot, floor, thing, wall of the room, below the floor, beyond a wall."""

_ON_WALL_M = 0.02
_ON_WALL_SIGMAS = 3.0
_NEXT_TO_M = 0.02
_NEAR_M, _NEAR_GAIN = 1.7, 1.5
_FAR_M, _FAR_GAIN = 3.0, 0.8
"""Deviations by which the threshold is lower within `_NEAR_M` on the floor, and per metre of depth up to `_FAR_M`."""

_LOW = 3.0
"""A thing is low up to this many thresholds: its pixels raise the mean height of the cells behind their foot."""

_FLYING_M = 0.08
"""A pixel this far behind what is on its one side and before what is on its other is no thing: at an edge the sensor,
or who filled its holes, took the middle."""

_BESIDE_PX = 2
"""A flying pixel is told by those so many columns beside it."""

_BETWEEN_PIXELS, _MAX_BETWEEN_M, _LEAST_BELOW_M = 1.5, 0.10, 0.05
"""A level surface goes on behind its farthest pixel by so many distances of the picture's rows on it, at most by so
much; the camera is taken to be no less than the last above it."""

_LONG_CELLS, _PARTS_PER_CELL, _MAX_PARTS = 0.5, 2.0, 16
"""A pixel that covers more of the floor along its ray than the first is shared among the cells it covers; in parts."""

_PER_METRE, _STEPS = 50.0, 700
"""Entries of the table of the noise per metre of depth, and all of them: up to 14 m."""

_TINY = np.float32(1e-6)
"""Least inverse depth in 1/m: pixels without depth are computed too, and passed over later."""

(SEEN, HEIGHT, FLOOR_PIXELS, OBSTACLE, OBSTACLE_PIXELS, TOUCHED, FARTHEST, HOLE, BRIDGE, BLIND, FLYING) = range(11)
"""What is summed per cell; shares are of the cell's area.

Share of floor seen; sum of the heights of the pixels of floor and of low things whose ray meets the floor there, and
their number; share of the visible surface of things, and their pixels; the same share of things in the cell or within
`_NEXT_TO_M` beside it; how far in m from below the camera the farthest thing in it may reach (-inf without); shares of
floor that is missing, and of floor behind pixels without depth: floor by the picture; not known; surface of pixels that
hang between a near and a far surface: noise, or the side of a thing seen edge-on."""

_SUMS = 11

_DOWN = -1e-3
"""Rays that do not fall by more than this meet no floor."""

_FLYING_PIXEL, _LOW_THING, _HIGH_THING, _UNSURE = 6, 7, 8, 9
"""Kinds while a row is sorted: flying pixels, two kinds of things, and pixels that float32 cannot tell."""

_SURE = np.float32(1e-5)
"""Part of a threshold by which a pixel has to be away from it to be told in float32."""

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
    walls : (n, 4) float64 of `walls_on_floor`; what lies on them is wall, what lies beyond does not count.
    """
    size = config.free_space_resolution_m
    cols, rows = round(config.free_space_forward_m / size), 2 * round(config.free_space_side_m / size)
    origin = (0.0, -0.5 * rows * size)
    c = geometry.camera
    sums, stands, kind, cell = _sum_cells(
        geometry.inverse_depth, hole_kind, labels, (c.fx, c.fy, c.cx, c.cy), T_camera_floor,
        (fit.distance_m, fit.sigma_m), walls, (*origin, size), (rows, cols),
        (config.obstacle_min_height_m, config.obstacle_noise_factor, config.robot_height_m),
    )  # fmt: skip
    return FloorCells(size, origin, sums, stands, kind, cell)


@njit(cache=True, nogil=True)
def band_sigma(sigma, z):  # type: ignore[no-untyped-def]
    """Noise of the height at depth z, linear between the middles of the bands."""
    position = min(max(z / BAND_M - 0.5, 0.0), len(sigma) - 1.001)
    low = int(position)
    return sigma[low] + (position - low) * (sigma[low + 1] - sigma[low])


@njit(cache=True, nogil=True)
def _noise_table(sigma):  # type: ignore[no-untyped-def]
    """Noise of the height per step of depth."""
    noise = np.empty(_STEPS)
    for k in range(_STEPS):
        noise[k] = band_sigma(sigma, (k + 0.5) / _PER_METRE)
    return noise


@njit(cache=True, nogil=True)
def _row_heights(inverse, column, distance, rise, rise_per_px, depth, high):  # type: ignore[no-untyped-def]
    """Write depth and height over the floor of a row of pixels; by itself, all float32, so that it runs on vectors."""
    for u in range(len(inverse)):
        depth[u] = np.float32(1.0) / (inverse[u] if inverse[u] > _TINY else _TINY)
        high[u] = distance + (rise + rise_per_px * column[u]) * depth[u]


@njit(cache=True, nogil=True)
def _row_inside(depth, column, reach, out, out_per_px, inside):  # type: ignore[no-untyped-def]
    """Lower `inside` of a row of pixels to how far they are before a wall."""
    for u in range(len(depth)):
        before = reach - (out + out_per_px * column[u]) * depth[u]
        inside[u] = before if before < inside[u] else inside[u]


@njit(cache=True, nogil=True)
def _row_noise(depth, noise_at, noise):  # type: ignore[no-untyped-def]
    """Write the noise of the height of a row of pixels, NaN where float32 cannot tell its step of depth: within a
    thousandth of a step of its ends.
    """
    for u in range(len(depth)):
        step = depth[u] * np.float32(_PER_METRE)
        step = step if step < np.float32(_STEPS - 1) else np.float32(_STEPS - 1)
        k = np.int32(step)
        part = step - np.float32(k)
        sure = abs(part - np.float32(0.5)) < np.float32(0.499)
        noise[u] = noise_at[np.uint32(k)] if sure else np.float32(np.nan)


@njit(cache=True, nogil=True)
def _row_thresholds(depth, column, noise, rays, lowest, factor, threshold):  # type: ignore[no-untyped-def]
    """Write from which height on pixels of a row are things, NaN where that is not sure: at `_NEAR_M`, where it jumps.

    Near the camera a thing covers many more pixels than a ripple of the noise: a lower threshold does.
    """
    ax0, ax1, ay0, ay1 = rays
    near_m2, near_gain, far_gain = np.float32(_NEAR_M * _NEAR_M), np.float32(_NEAR_GAIN), np.float32(_FAR_GAIN)
    for u in range(len(depth)):
        z = depth[u]
        x, y = (ax0 + ax1 * column[u]) * z, (ay0 + ay1 * column[u]) * z
        before = x * x + y * y - near_m2
        nearer = np.float32(_FAR_M) - z
        nearer = nearer if nearer > np.float32(0.0) else np.float32(0.0)
        gain = far_gain * (nearer if nearer < near_gain else near_gain)
        gain = near_gain if before < np.float32(0.0) else gain
        limit = (factor - gain) * noise[u]
        limit = lowest if limit < lowest else limit
        threshold[u] = limit if abs(before) > np.float32(1e-4) else np.float32(np.nan)


@njit(cache=True, nogil=True)
def _row_tolerances(depth, noise, per_sigma, tolerance):  # type: ignore[no-untyped-def]
    """Write how far from a wall pixels of a row lie on it."""
    for u in range(len(depth)):
        tolerance[u] = np.float32(_ON_WALL_M) + per_sigma * noise[u] * depth[u]


@njit(cache=True, nogil=True)
def _row_kinds(inverse, high, inside, labels, threshold, tolerance, column, az, az_per_px, highest, kinds):  # type: ignore[no-untyped-def]
    """Write the kinds of a row of pixels, all float32, so that it runs on vectors."""
    for u in range(len(kinds)):
        h, limit, before, on_wall = high[u], threshold[u], inside[u], tolerance[u]
        down = az + az_per_px * column[u]
        floor = FLOOR_PIXEL if h > -limit else HOLE_PIXEL
        floor = floor if down <= np.float32(_DOWN) else NOTHING
        thing = _LOW_THING if h < np.float32(_LOW) * limit else _HIGH_THING
        wall = WALL_PIXEL if before >= -on_wall else BEYOND_PIXEL
        thing = wall if before < (-on_wall if labels[u] == CLUTTER else on_wall) else thing
        sure = (abs(abs(h) - limit) > _SURE * limit) & (abs(h - np.float32(_LOW) * limit) > _SURE * limit)
        sure &= (abs(abs(before) - on_wall) > _SURE * on_wall) & (abs(down - np.float32(_DOWN)) > _SURE)
        kind = (thing if h > limit else floor) if sure else _UNSURE
        kinds[u] = kind if (inverse[u] > np.float32(0.0)) & (h <= highest) else NOTHING


@njit(cache=True, nogil=True)
def _row_edges(left, here, right, kinds):  # type: ignore[no-untyped-def]
    """Things and walls may be flying pixels where the depth falls or rises through them: not sure.

    By a little less than `_FLYING_M`, for float32.
    """
    for u in range(len(here)):
        step = np.float32(0.99 * _FLYING_M) * here[u] * here[u]
        from_left, to_right = left[u] - here[u], here[u] - right[u]
        hangs = (min(from_left, to_right) > step) | (max(from_left, to_right) < -step)
        kinds[u] = _UNSURE if hangs & (kinds[u] >= WALL_PIXEL) & (kinds[u] != HOLE_PIXEL) else kinds[u]


@njit(cache=True, nogil=True, error_model="numpy")
def _kind(h, z, x, y, az, inside, on_clutter, flies, noise_at, limits):  # type: ignore[no-untyped-def]
    """Kind of a pixel, in float64."""
    lowest, factor, distance = limits
    noise = noise_at[min(int(z * _PER_METRE), _STEPS - 1)]
    near = x * x + y * y < _NEAR_M * _NEAR_M
    gain = _NEAR_GAIN if near else _FAR_GAIN * min(max(_FAR_M - z, 0.0), _NEAR_GAIN)
    threshold = max(lowest, (factor - gain) * noise)
    if h <= threshold:
        floor = FLOOR_PIXEL if h > -threshold else HOLE_PIXEL
        return floor if az <= _DOWN else NOTHING
    if flies:
        return _FLYING_PIXEL
    tolerance = _ON_WALL_M + _ON_WALL_SIGMAS * noise * z / distance
    if inside < (-tolerance if on_clutter else tolerance):
        return WALL_PIXEL if inside >= -tolerance else BEYOND_PIXEL
    return _LOW_THING if h < _LOW * threshold else _HIGH_THING


@njit(cache=True, nogil=True)
def _flies(left, here, right):  # type: ignore[no-untyped-def]
    """Whether a pixel hangs between a near and a far surface beside it, all inverse depths."""
    step = _FLYING_M * here * here
    if min(left, right) <= 0.0:
        return False
    return (left - here > step and here - right > step) or (right - here > step and here - left > step)


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


@njit(cache=True, nogil=True, error_model="numpy")
def _sum_cells(inverse, hole_kind, labels, intrinsics, T, fit, walls, corner, shape, limits):  # type: ignore[no-untyped-def]
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
    noise_at = _noise_table(sigma)
    noise_32, limits_32 = noise_at.astype(np.float32), _limits_32(limits)
    column = np.arange(width).astype(np.float32)
    places = np.empty_like(column), np.empty_like(column), np.empty_like(column)
    scratch = np.empty_like(column), np.empty_like(column), np.empty_like(column)
    for v in range(height):
        rays = pixel_rays(T, intrinsics, v)
        _row_places(inverse[v], column, rays, distance, walls, places)
        _sort_row(inverse[v], labels[v], column, rays, distance, places, noise_32, limits_32, scratch, kind[v])
        if _has_holes(hole_kind[v]):
            _add_holes(hole_kind[v], rays, (distance, fy, per_pixel, fall), grid, sums)
        _add_row(
            inverse[v], labels[v], rays, (distance, fy, per_pixel, fall), places, noise_at, limits, grid,
            kind[v], cell[v], (sums, surface, stands),
        )  # fmt: skip
    _spread(surface, _NEXT_TO_M / size, sums)
    return sums, stands, kind, cell


@njit(cache=True, nogil=True)
def _limits_32(limits):  # type: ignore[no-untyped-def]
    """Limits in float32, the highest height rounded down: a float32 is above it where it is above that in float64."""
    lowest, factor, highest = limits
    highest_32 = np.float32(highest)
    highest_32 = highest_32 if highest_32 <= highest else np.nextafter(highest_32, np.float32(0.0))
    return np.float32(lowest), np.float32(factor), highest_32


@njit(cache=True, nogil=True, error_model="numpy")
def pixel_rays(T, intrinsics, v):  # type: ignore[no-untyped-def]
    """Rays of a row in floor axes (ahead, to the left, up): each that of pixel 0, and how much more per pixel."""
    fx, fy, cx, cy = intrinsics
    ry = (v - cy) / fy
    return (
        T[1, 0] * ry + T[2, 0] - T[0, 0] * cx / fx, T[0, 0] / fx,
        T[1, 1] * ry + T[2, 1] - T[0, 1] * cx / fx, T[0, 1] / fx,
        T[1, 2] * ry + T[2, 2] - T[0, 2] * cx / fx, T[0, 2] / fx,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _row_places(inverse, column, rays, distance, walls, places):  # type: ignore[no-untyped-def]
    """Write depth, height over the floor and how far before the nearest wall (inf without) the pixels of a row are."""
    ax0, ax1, ay0, ay1, az0, az1 = rays
    depth, high, inside = places
    _row_heights(inverse, column, np.float32(distance), np.float32(az0), np.float32(az1), depth, high)
    inside[:] = np.inf
    for k in range(len(walls)):
        a, b = walls[k, 0], walls[k, 1]
        out, out_per_px = np.float32(a * ax0 + b * ay0), np.float32(a * ax1 + b * ay1)
        _row_inside(depth, column, np.float32(walls[k, 2]), out, out_per_px, inside)


@njit(cache=True, nogil=True, error_model="numpy")
def _sort_row(inverse, labels, column, rays, distance, places, noise_at, limits, scratch, kinds):  # type: ignore[no-untyped-def]
    """Write the kinds of a row of pixels, `_UNSURE` where float32 cannot tell them.

    A pass over the row for each step, all float32: so each runs on vectors, which sort nearly all pixels.
    """
    ax0, ax1, ay0, ay1, az0, az1 = rays
    depth, high, inside = places
    lowest, factor, highest = limits
    noise, threshold, tolerance = scratch
    across = (np.float32(ax0), np.float32(ax1), np.float32(ay0), np.float32(ay1))
    _row_noise(depth, noise_at, noise)
    _row_thresholds(depth, column, noise, across, lowest, factor, threshold)
    _row_tolerances(depth, noise, np.float32(_ON_WALL_SIGMAS / distance), tolerance)
    _row_kinds(
        inverse, high, inside, labels, threshold, tolerance, column, np.float32(az0), np.float32(az1), highest, kinds
    )
    left, here, right = inverse[: -2 * _BESIDE_PX], inverse[_BESIDE_PX:-_BESIDE_PX], inverse[2 * _BESIDE_PX :]
    _row_edges(left, here, right, kinds[_BESIDE_PX:-_BESIDE_PX])


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
        if hole_kinds[u] == MEASURED or rays[4] + rays[5] * u >= _DOWN:
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
def _add_row(inverse, labels, rays, camera, places, noise_at, limits, grid, kinds, cell, cells):  # type: ignore[no-untyped-def]
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
        if what in (NOTHING, WALL_PIXEL, BEYOND_PIXEL):
            continue
        h, z, az = high[u], np.float64(depth[u]), az0 + az1 * u
        x, y = (ax0 + ax1 * u) * z, (ay0 + ay1 * u) * z
        if what == _UNSURE:
            inner = _BESIDE_PX <= u < width - _BESIDE_PX
            flies = inner and _flies(inverse[u - _BESIDE_PX], inverse[u], inverse[u + _BESIDE_PX])
            on_clutter = labels[u] == CLUTTER
            what = _kind(h, z, x, y, az, inside[u], on_clutter, flies, noise_at, (lowest, factor, distance))
            kinds[u] = what
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
        elif what >= _FLYING_PIXEL:
            kinds[u] = NOTHING if what == _FLYING_PIXEL else OBSTACLE_PIXEL
            across, ahead = (y - y0) * per_metre, (x - x0) * per_metre
            i, j = int(np.floor(across)), int(np.floor(ahead))
            if i < 0 or j < 0 or i >= rows or j >= cols:
                continue
            area = per_pixel * z * z
            if what == _FLYING_PIXEL:
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
            if what == _LOW_THING and az < _DOWN:
                z, i, j = _foot(rays, u, distance, grid)
                if i >= 0:
                    sums[i, j, HEIGHT] += h
                    sums[i, j, FLOOR_PIXELS] += np.float32(1.0)
