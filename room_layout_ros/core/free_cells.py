"""Which cells of the floor are free, occupied or not known, from the sums over their pixels.

What a thing's pixels say of its place is as uncertain as their depth, and that goes along the ray: before a thing the
margin begins at its nearest pixel, and behind it cells are not free as far as noise and the spacing of the pixels on
a level surface may hide the rest of it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .floor_cells import FloorCells
from .floor_plane import BAND_M, FloorFit

UNKNOWN_CELL, FREE_CELL, OCCUPIED_CELL = -1, 0, 100

_MIN_PIXELS = 3
_MIN_HOLE = 0.3
_MAX_GAP = 0.3
"""Share of a cell without depth, and not floor by the picture, from which on something may stand there."""

_BRIDGE = np.ones((5, 5), np.uint8)
"""The picture closes holes of the depth up to two cells from floor that was measured."""

_RANGE_BAND_M = 0.5
_MIN_BAND_CELLS = 10
_LOW_SHARE = 0.6
_LOW_SIGMAS = 4.0
_DOUBT_SIGMAS = 2.5
_PATCH_SHARE = 0.2
_TOUCH_SHARE = 0.1
_DOUBT_SHARE = 0.8
_TOUCH_PIXELS = 2.5
_TAIL_SHARE = 0.25
_STRAY_SIGMAS = 3.0
"""The few pixels of a cell beside a thing may lie this much before their true place."""

_BEHIND_SIGMAS = 2.0
_SURE_M = 0.01
"""The nearest of many pixels lies before the thing: one deviation of the noise is taken off, but for this much."""

_BEHIND_WALL_CELLS = 3
_MARGIN_CELLS = 0.15
"""Added to the margin: the place of a thing is known to a pixel, not better (7 mm for cells of 5 cm)."""

_NEXT = np.ones((3, 3), np.uint8)


def occupied_cells(cells: FloorCells, config: EstimatorConfig) -> NDArray[np.bool_]:
    """Return (rows, cols) bool: part of a patch with enough surface above the noise, or floor that is too high.

    The surface is summed over the patch of touching cells: a thing of 3 cm may lie across four of them, while the
    ripple of the sensor makes small patches everywhere.
    """
    some = (cells.obstacle >= _PATCH_SHARE * config.obstacle_min_area) & (cells.obstacle_pixels >= _MIN_PIXELS)
    count, patch = cv2.connectedComponents(some.astype(np.uint8), connectivity=8)
    total = np.bincount(patch.ravel(), cells.obstacle.ravel(), count)
    total[0] = 0.0
    stands = (total >= config.obstacle_min_area)[patch] & ~_tails(cells)
    return np.asarray(stands | _raised(cells, config, _LOW_SIGMAS, _LOW_SHARE))


def decide_cells(
    cells: FloorCells,
    thing: NDArray[np.bool_],
    fit: FloorFit,
    walls: NDArray[np.float64],
    half_view: float,
    focal_px: float,
    config: EstimatorConfig,
) -> NDArray[np.int8]:
    """Return the grid (rows, cols) int8 of -1 unknown, 0 free, 100 occupied.

    Parameters
    ----------
    thing : (rows, cols) bool of `occupied_cells`. walls : (n, 4) float64 of `walls_on_floor`.
    half_view : float, radians, of the picture to either side. focal_px : float.
    """
    x, y = cells.centres()
    beside = cv2.dilate(thing.astype(np.uint8), _NEXT) > 0
    raised = _raised(cells, config, _DOUBT_SIGMAS, 0.5)
    touched = _touched(cells, beside, focal_px, config)
    gap = cells.gap >= _MAX_GAP
    inside = np.ones(thing.shape, bool)
    for a, b, c, _ in walls:
        inside &= a * x + b * y <= c
    wall = _wall_cells(cells, walls, half_view, config)
    hole = cells.hole >= _MIN_HOLE
    grid = np.full(thing.shape, UNKNOWN_CELL, np.int8)
    grid[_is_floor(cells, config) & ~raised & ~touched & ~gap & inside & ~wall] = FREE_CELL
    grid[((thing | hole) & inside) | wall] = OCCUPIED_CELL
    reach = np.hypot(x, y)
    noise = np.interp(reach, (np.arange(len(fit.sigma_m)) + 0.5) * BAND_M, fit.sigma_m) * reach / fit.distance_m
    stands = (thing | hole | raised | gap) & inside
    nearest = np.where(np.isfinite(cells.nearest_m), cells.nearest_m, reach - 0.5 * cells.resolution_m)
    nearest += np.where(stands, np.where(thing, np.maximum(noise - _SURE_M, 0.0), 0.0), _STRAY_SIGMAS * noise)
    nearest[~(stands | (beside & inside & (cells.obstacle_pixels > 0)))] = np.inf
    farthest = np.where(thing & inside, cells.farthest_m + _BEHIND_SIGMAS * noise, -np.inf)
    margin = config.obstacle_margin_m + _MARGIN_CELLS * cells.resolution_m
    _keep_away(grid, nearest, farthest, walls, *cells.origin_m, cells.resolution_m, margin)
    return grid


def _is_floor(cells: FloorCells, config: EstimatorConfig) -> NDArray[np.bool_]:
    """Cells of which enough was measured as floor, or is floor by the picture next to measured floor."""
    measured = cells.seen >= config.free_min_seen
    near = cv2.dilate(measured.astype(np.uint8), _BRIDGE) > 0
    return np.asarray(measured | (near & (cells.seen + cells.bridged >= config.free_min_seen)))


def _touched(
    cells: FloorCells, beside: NDArray[np.bool_], focal_px: float, config: EstimatorConfig
) -> NDArray[np.bool_]:
    """Cells into which a thing reaches by more than stray pixels."""
    x, y = cells.centres()
    pixel = (x * x + y * y) / (focal_px * cells.resolution_m) ** 2  # share of a cell that a pixel covers there
    least = np.maximum(_TOUCH_SHARE * config.obstacle_min_area, _TOUCH_PIXELS * pixel)
    return np.asarray((cells.obstacle >= _DOUBT_SHARE * config.obstacle_min_area) | (beside & (cells.touched >= least)))


def _tails(cells: FloorCells) -> NDArray[np.bool_]:
    """Cells before a thing that hold but a small part of its surface: the noise of its distance."""
    x, y = cells.centres()
    r = np.hypot(x, y)
    rows, cols = np.indices(x.shape)
    behind = np.zeros(x.shape, np.float32)
    for step in (1.0, 2.0):
        i = np.clip(np.rint(rows + step * y / r).astype(int), 0, x.shape[0] - 1)
        j = np.clip(np.rint(cols + step * x / r).astype(int), 0, x.shape[1] - 1)
        behind = np.maximum(behind, cells.obstacle[i, j])
    return np.asarray(cells.obstacle < _TAIL_SHARE * behind)


def _raised(cells: FloorCells, config: EstimatorConfig, sigmas: float, share: float) -> NDArray[np.bool_]:
    """Cells whose pixels of floor and low things lie higher on average than cells at that distance do."""
    known = cells.floor_pixels >= _MIN_PIXELS
    x, y = cells.centres()
    band = (np.hypot(x[known], y[known]) / _RANGE_BAND_M).astype(int)
    height = cells.height_m[known]
    sigma = np.full(int(band.max(initial=0)) + 1, np.inf)
    for k in range(len(sigma)):
        here = np.abs(height[band == k])
        if len(here) >= _MIN_BAND_CELLS:
            sigma[k] = 1.4826 * float(np.median(here))
    result = np.zeros(known.shape, bool)
    result[known] = height > np.maximum(share * config.obstacle_min_height_m, sigmas * sigma[band])
    return result


def _wall_cells(
    cells: FloorCells, walls: NDArray[np.float64], half_view: float, config: EstimatorConfig
) -> NDArray[np.bool_]:
    """Cells that a wall in view stands on, but for where the floor goes on behind it: an open door."""
    x, y = cells.centres()
    half = 0.5 * cells.resolution_m
    rows, cols = np.indices(x.shape)
    result = np.zeros(x.shape, bool)
    for a, b, c, _ in walls:
        on = np.abs(a * x + b * y - c) < half * (abs(a) + abs(b))
        # The foot of a wall looks like floor a cell behind it; a door shows floor farther on.
        behind_row = np.clip(rows + round(_BEHIND_WALL_CELLS * b), 0, x.shape[0] - 1)
        behind_col = np.clip(cols + round(_BEHIND_WALL_CELLS * a), 0, x.shape[1] - 1)
        result |= on & (cells.seen[behind_row, behind_col] < config.free_min_seen)
    for a, b, c, _ in walls:
        result &= a * x + b * y <= c + half * (abs(a) + abs(b))
    return np.asarray(result & (np.abs(np.arctan2(y, x)) <= half_view))


@njit(cache=True, nogil=True)
def _keep_away(grid, nearest, farthest, walls, x0, y0, size, margin):  # type: ignore[no-untyped-def]
    """Free cells become unknown within the margin before a thing or a wall, or behind a thing where it may reach."""
    rows, cols = grid.shape
    steps = int(np.ceil((margin + size) / (0.5 * size)))
    for i in range(rows):
        y = y0 + (i + 0.5) * size
        for j in range(cols):
            if grid[i, j] != 0:
                continue
            x = x0 + (j + 0.5) * size
            r = np.sqrt(x * x + y * y)
            ex, ey = x / r, y / r
            near = False
            for k in range(steps + 1):
                px, py = x + 0.5 * k * size * ex - x0, y + 0.5 * k * size * ey - y0
                m, n = int(np.floor(py / size)), int(np.floor(px / size))
                if 0 <= m < rows and 0 <= n < cols and nearest[m, n] <= r + margin:
                    near = True
            for k in range(1, steps + 1):
                px, py = x - 0.5 * k * size * ex - x0, y - 0.5 * k * size * ey - y0
                m, n = int(np.floor(py / size)), int(np.floor(px / size))
                if 0 <= m < rows and 0 <= n < cols and farthest[m, n] >= r:
                    near = True
            for k in range(len(walls)):
                ahead = walls[k, 0] * (x + margin * ex) + walls[k, 1] * (y + margin * ey)
                if ahead >= walls[k, 2]:
                    near = True
            if near:
                grid[i, j] = -1
