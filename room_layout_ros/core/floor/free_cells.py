"""Which cells of the floor are free, occupied or not known, from the sums over their pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..config import EstimatorConfig
from ..depth import MAD_TO_SIGMA
from .cell_margins import keep_away
from .doorways import CLOSED, OPEN, wall_at
from .floor_cells import (
    BLIND,
    BRIDGE,
    FARTHEST,
    FLOOR_PIXELS,
    FLYING,
    FREE_CELL,
    HEIGHT,
    HOLE,
    OBSTACLE,
    OBSTACLE_PIXELS,
    OCCUPIED_CELL,
    SEEN,
    TOUCHED,
    UNKNOWN_CELL,
    FloorCells,
)
from .floor_noise import band_sigma
from .floor_pixels import FLOOR_PIXEL
from .floor_plane import FloorFit

_MIN_PIXELS = 3
_MIN_HOLE = 0.3
_MAX_GAP = 0.3
"""Share of a cell without depth, and not floor by the picture, from which on something may stand there."""

_ALL_GAP = 0.8
"""Share from which on a black thing may fill the cell and reach into the one before it."""

_MEASURED = 0.7
"""Share of the floor that has to be seen that has to be measured too; the rest may be without depth."""

_BRIDGE_CELLS = 2
"""Holes of the depth are floor by the picture (free with `free_by_picture`) so far from floor that was measured."""

_LIT, _LIT_STRIDE = 60, 8
"""Level of the brightest channel of a lit floor; one in so many rows and columns is looked at."""

_RANGE_BAND_M = 0.5
_MIN_BAND_CELLS = 10
_LOW_SHARE, _LOW_SIGMAS = 0.6, 4.0
"""Floor whose mean in a cell is higher than its noise by so many deviations is a thing. Where single pixels do not tell
what is as high as counts, so much of that height is enough, for a cell may be filled in part."""

_DOUBT_HEIGHT_SHARE = 0.5
_DOUBT_SIGMAS = 3.0
_PATCH_SHARE = 0.2
_TOUCH_SHARE = 0.1
_DOUBT_SHARE = 0.8
_TOUCH_PIXELS = 0.5
_FLYING_SHARE = 0.3
"""Of the surface of a thing: so much that flies is the side of one seen edge-on."""

_TAIL_SHARE = 0.25
_STRAY_SIGMAS, _BEHIND_SIGMAS, _SURE_SIGMAS = (1.5, 4.0), (2.0, 0.5), (-1.8, 1.5)
"""In deviations of the depth's noise, within `_CLOSE_M` and beyond: the few pixels of a cell beside a thing may lie so
much before their true place; a thing may go on so far behind its farthest pixel; so much its nearest pixel is early."""

_CLOSE_M, _PLACE_M = 3.2, 0.01
"""Up to here free has to be certain, beyond it the more likely counts: a robot comes nearer before it gets there. (It
holds for things, of which the noise sets back those at 3 m.) So much of the noise is left in: the place of a pixel."""

_BEHIND_WALL_CELLS = 3
_BEHIND_HOLE_CELLS, _BEHIND_HOLE_SIGMAS = 1.5, 6.0
"""The far side of a hole looks like floor so far before its upper edge."""


@dataclass(frozen=True, slots=True)
class Levels:
    """Mean height of the floor in each cell, and how much that of floor at its distance scatters.

    Attributes
    ----------
    height_m : (rows, cols) float32, NaN where too few pixels of floor are.
    sigma_m : (rows, cols) float32, inf where too few cells at that distance have floor.
    """

    height_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]


def floor_levels(cells: FloorCells) -> Levels:
    """Return the levels of the cells' floor."""
    return Levels(*_levels(cells.sums, cells.corner))


def occupied_cells(
    cells: FloorCells, levels: Levels, sigma_m: NDArray[np.float64], config: EstimatorConfig
) -> NDArray[np.bool_]:
    """Return (rows, cols) bool: part of a patch with enough surface above the noise, or floor that is too high.

    The surface is summed over the patch of touching cells: a thing of 3 cm may lie across four of them, while the
    ripple of the sensor makes small patches everywhere. `sigma_m` : of `FloorFit`, noise of the height of pixels.
    """
    some = _in_patch(cells.sums, _PATCH_SHARE * config.obstacle_min_area)
    count, patch = cv2.connectedComponents(some, connectivity=8)
    limits = config.obstacle_min_area, config.obstacle_min_height_m, config.obstacle_noise_factor
    thing = _things(cells.sums, patch, count, cells.corner, levels.height_m, levels.sigma_m, sigma_m, limits)
    return np.asarray(thing)


def blind_cells(cells: FloorCells, color: NDArray[np.uint8] | None, config: EstimatorConfig) -> NDArray[np.bool_]:
    """Return (rows, cols) bool: cells of which too much has no depth, but for what is floor by the picture.

    With stereo a cell here and there is always lost: floor behind it would never be offered for clearing. In the dark
    the picture does not tell.
    """
    return np.asarray(_blind(cells.sums, config.free_min_seen, _is_lit(cells, color)))


def _is_lit(cells: FloorCells, color: NDArray[np.uint8] | None) -> bool:
    """Whether the floor is bright enough for a black thing to stand out from it in the picture."""
    if color is None:
        return False
    floor = color[::_LIT_STRIDE, ::_LIT_STRIDE][cells.kind[::_LIT_STRIDE, ::_LIT_STRIDE] == FLOOR_PIXEL]
    return len(floor) > 0 and float(np.median(floor.max(axis=1))) >= _LIT


def decide_cells(
    cells: FloorCells,
    levels: Levels,
    thing: NDArray[np.bool_],
    doubt: NDArray[np.bool_],
    fit: FloorFit,
    walls: tuple[NDArray[np.float64], NDArray[np.float64]],
    view: tuple[float, float],
    focal_px: float,
    config: EstimatorConfig,
) -> NDArray[np.int8]:
    """Return the grid (rows, cols) int8 of -1 unknown, 0 free, 100 occupied.

    Parameters
    ----------
    levels : of `floor_levels`. thing : (rows, cols) bool of `occupied_cells`.
    doubt : (rows, cols) bool, something may stand there (`find_low_things`).
    walls : (n, 4) float64 of `walls_on_floor`, and what `see_walls` tells of them.
    view : bearings of what is in the picture (`view_fan`). focal_px : float.
    """
    grid, reach = _decide(
        cells.sums, cells.corner, (thing, doubt), levels.height_m, levels.sigma_m, walls, view, focal_px,
        (fit.sigma_m, fit.distance_m),
        (
            config.free_min_seen, config.obstacle_min_area, _DOUBT_HEIGHT_SHARE * config.obstacle_min_height_m,
            _BRIDGE_CELLS if config.free_by_picture else 0,
        ),
    )  # fmt: skip
    keep_away(grid, reach, cells, walls[0], config.obstacle_margin_m)
    return np.asarray(grid)


@njit(cache=True, nogil=True)
def _levels(sums, corner):  # type: ignore[no-untyped-def]
    x0, y0, size = corner
    rows, cols, _ = sums.shape
    far = np.hypot(max(abs(x0), abs(x0 + cols * size)), max(abs(y0), abs(y0 + rows * size)))
    bands = int(far / _RANGE_BAND_M) + 1
    height = np.full((rows, cols), np.nan, np.float32)
    band = np.zeros((rows, cols), np.int32)
    values = np.empty((bands, rows * cols), np.float32)
    count = np.zeros(bands, np.int64)
    for i in range(rows):
        y = y0 + (i + 0.5) * size
        for j in range(cols):
            if sums[i, j, FLOOR_PIXELS] < _MIN_PIXELS:
                continue
            x = x0 + (j + 0.5) * size
            k = int(np.sqrt(x * x + y * y) / _RANGE_BAND_M)
            h = sums[i, j, HEIGHT] / sums[i, j, FLOOR_PIXELS]
            height[i, j], band[i, j] = h, k
            values[k, count[k]] = abs(h)
            count[k] += 1
    spread = np.full(bands, np.inf, np.float32)
    for k in range(bands):
        if count[k] >= _MIN_BAND_CELLS:
            spread[k] = MAD_TO_SIGMA * np.median(values[k, : count[k]])
    sigma = np.empty((rows, cols), np.float32)
    for i in range(rows):
        for j in range(cols):
            sigma[i, j] = spread[band[i, j]]
    return height, sigma


@njit(cache=True, nogil=True)
def _in_patch(sums, least):  # type: ignore[no-untyped-def]
    rows, cols, _ = sums.shape
    some = np.zeros((rows, cols), np.uint8)
    for i in range(rows):
        for j in range(cols):
            some[i, j] = sums[i, j, OBSTACLE] >= least and sums[i, j, OBSTACLE_PIXELS] >= _MIN_PIXELS
    return some


@njit(cache=True, nogil=True)
def _things(sums, patch, count, corner, height, sigma, noise_m, limits):  # type: ignore[no-untyped-def]
    rows, cols, _ = sums.shape
    x0, y0, size = corner
    least, lowest, factor = limits
    total = np.zeros(count)
    for i in range(rows):
        for j in range(cols):
            total[patch[i, j]] += sums[i, j, OBSTACLE]
    thing = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            stands = patch[i, j] > 0 and total[patch[i, j]] >= least and not _is_tail(sums, corner, i, j)
            r = np.sqrt((x0 + (j + 0.5) * size) ** 2 + (y0 + (i + 0.5) * size) ** 2)
            pixels_tell = factor * band_sigma(noise_m, r) <= lowest
            limit = lowest if pixels_tell else _LOW_SHARE * lowest
            thing[i, j] = stands or height[i, j] > max(limit, _LOW_SIGMAS * sigma[i, j])
    return thing


@njit(cache=True, nogil=True)
def _is_tail(sums, corner, i, j):  # type: ignore[no-untyped-def]
    """Whether a cell before a thing holds but a small part of its surface: the noise of its distance."""
    x0, y0, size = corner
    rows, cols, _ = sums.shape
    x, y = x0 + (j + 0.5) * size, y0 + (i + 0.5) * size
    r = np.sqrt(x * x + y * y)
    behind = 0.0
    for step in range(1, 3):
        m = min(max(int(np.rint(i + step * y / r)), 0), rows - 1)
        n = min(max(int(np.rint(j + step * x / r)), 0), cols - 1)
        behind = max(behind, sums[m, n, OBSTACLE])
    return sums[i, j, OBSTACLE] < _TAIL_SHARE * behind


@njit(cache=True, nogil=True)
def _beside(thing):  # type: ignore[no-untyped-def]
    """(rows, cols) bool: a thing stands in the cell or in one that touches it."""
    rows, cols = thing.shape
    beside = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if thing[i, j]:
                beside[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = True
    return beside


@njit(cache=True, nogil=True)
def _is_floor(sums, i, j, least, bridge_cells):  # type: ignore[no-untyped-def]
    """Whether enough of a cell was measured as floor, or is floor by the picture so many cells from measured floor."""
    rows, cols, _ = sums.shape
    seen = sums[i, j, SEEN]
    if seen >= least or (seen >= _MEASURED * least and seen + sums[i, j, BRIDGE] + sums[i, j, BLIND] >= least):
        return True
    if bridge_cells == 0 or sums[i, j, SEEN] + sums[i, j, BRIDGE] < least:
        return False
    for m in range(max(i - bridge_cells, 0), min(i + bridge_cells + 1, rows)):
        for n in range(max(j - bridge_cells, 0), min(j + bridge_cells + 1, cols)):
            if sums[m, n, SEEN] >= least:
                return True
    return False


@njit(cache=True, nogil=True)
def _blind(sums, least_seen, by_picture):  # type: ignore[no-untyped-def]
    rows, cols, _ = sums.shape
    blind = np.zeros((rows, cols), np.bool_)
    for i in range(rows):
        for j in range(cols):
            if sums[i, j, BLIND] + sums[i, j, BRIDGE] < _MAX_GAP:
                continue
            bridged = by_picture and sums[i, j, BLIND] < _MAX_GAP
            blind[i, j] = not (bridged and _is_floor(sums, i, j, least_seen, _BRIDGE_CELLS))
    return blind


@njit(cache=True, nogil=True)
def _by_walls(sums, i, j, x, y, walls, seen, size, least_seen):  # type: ignore[no-untyped-def]
    """Whether the middle of a cell is inside all walls, and whether one of them runs through it (no open door).

    `seen` : of `see_walls`.
    """
    rows, cols, _ = sums.shape
    inside, on_wall, near_room = True, False, True
    for k in range(len(walls)):
        a, b = walls[k, 0], walls[k, 1]
        before, half = walls[k, 2] - a * x - b * y, 0.5 * size * (abs(a) + abs(b))
        inside, near_room = inside and before >= 0.0, near_room and before >= -half
        if abs(before) < half:
            # The foot of a wall looks like floor a cell behind it; an open door shows floor farther on.
            m = min(max(i + int(np.rint(_BEHIND_WALL_CELLS * b)), 0), rows - 1)
            n = min(max(j + int(np.rint(_BEHIND_WALL_CELLS * a)), 0), cols - 1)
            told = wall_at(seen, x, y, size)
            on_wall = on_wall or told == CLOSED or (told != OPEN and sums[m, n, SEEN] < least_seen)
    return inside, on_wall and near_room


@njit(cache=True, nogil=True)
def _decide(sums, corner, things, height, sigma, walls, view, focal, fit, limits):  # type: ignore[no-untyped-def]
    """Cells by what they hold, without their surroundings; and how near and far what stands in them may reach."""
    x0, y0, size = corner
    thing, doubt = things
    planes, seen = walls
    noise_m, distance = fit
    least_seen, least_area, lowest, bridge_cells = limits
    rows, cols, _ = sums.shape
    grid, near_thing = np.full((rows, cols), UNKNOWN_CELL, np.int8), _beside(thing)
    nearest = np.full((rows, cols), np.inf)
    early = np.full((rows, cols), np.inf)
    farthest, hole_end = np.full((rows, cols), -np.inf), np.full((rows, cols), -np.inf)
    for i in range(rows):
        y = y0 + (i + 0.5) * size
        for j in range(cols):
            x = x0 + (j + 0.5) * size
            inside, on_wall = _by_walls(sums, i, j, x, y, planes, seen, size, least_seen)
            if on_wall and view[0] <= np.arctan2(y, x) <= view[1]:
                grid[i, j] = OCCUPIED_CELL
            if not inside:
                continue
            cell = sums[i, j]
            r = np.sqrt(x * x + y * y)
            beside, far = near_thing[i, j], int(r > _CLOSE_M)
            raised = height[i, j] > max(lowest, _DOUBT_SIGMAS * sigma[i, j])
            hole, gap = cell[HOLE] >= _MIN_HOLE, cell[BLIND] >= _MAX_GAP
            pixel = r * r / (focal * size) ** 2  # share of a cell that a pixel covers there
            touched = cell[OBSTACLE] >= _DOUBT_SHARE * least_area or (
                beside and far == 0 and cell[TOUCHED] >= max(_TOUCH_SHARE * least_area, _TOUCH_PIXELS * pixel)
            )
            flies = far == 0 and cell[FLYING] >= _FLYING_SHARE * least_area
            if thing[i, j] or hole:
                grid[i, j] = OCCUPIED_CELL
            elif grid[i, j] != OCCUPIED_CELL:
                suspect = raised or touched or gap or doubt[i, j] or flies
                clear = not suspect and _is_floor(sums, i, j, least_seen, bridge_cells)
                grid[i, j] = FREE_CELL if clear else UNKNOWN_CELL
            blind = cell[BLIND] >= _ALL_GAP
            stands = thing[i, j] or hole or blind or doubt[i, j]
            if flies:
                nearest[i, j] = r - 0.5 * size
            if not stands and not beside:
                continue
            noise = band_sigma(noise_m, r) * r / distance
            if stands or (beside and cell[OBSTACLE_PIXELS] > 0):
                sigmas = (_SURE_SIGMAS[far] if thing[i, j] else 0.0) if stands else _STRAY_SIGMAS[far]
                early[i, j] = max(sigmas * noise - _PLACE_M, min(sigmas, 0.0) * noise)
                if doubt[i, j] or cell[OBSTACLE_PIXELS] == 0:
                    nearest[i, j] = r - (1.5 if blind else 0.5) * size + early[i, j]
            if thing[i, j]:
                farthest[i, j] = cell[FARTHEST] + _BEHIND_SIGMAS[far] * noise
            if hole:  # its far side is seen a little below the edge, as floor is by its noise
                hole_end[i, j] = r + _BEHIND_HOLE_CELLS * size + _BEHIND_HOLE_SIGMAS * noise
    return grid, (early, nearest, farthest, hole_end)
