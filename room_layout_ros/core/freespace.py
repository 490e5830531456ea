"""Where a robot can drive: the floor around the camera in cells that are free, occupied or not known.

Free is only what was seen free. Occupied is what stands there, wall or thing, and a hole in the floor. Everything else,
behind things, outside the room, where the sensor measured nothing, is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry
from .estimate import RoomEstimate
from .floor_cells import FLOOR_PIXEL, OBSTACLE_PIXEL, FloorCells, sum_floor_cells
from .floor_frame import floor_frame, room_outline, walls_on_floor
from .floor_plane import FloorPlane, fit_floor
from .scan import RangeScan, cast_scan
from .wall_lines import refine_walls

UNKNOWN_CELL, FREE_CELL, OCCUPIED_CELL = -1, 0, 100

_MIN_PIXELS = 3
_MIN_HOLE = 0.3
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
_BEHIND_CELLS = 3
_COLUMN_STEP_M, _COLUMN_STEPS = 0.1, 12
_MIN_HIDDEN = 2
_COVER_M = (0.08, 0.6)
"""What stands this far before the space above a cell hides what may hang there (a seat behind its back, a table)."""

_GAP = np.ones((5, 5), np.uint8)
"""A gap between things that this square of cells closes is not called free."""


@dataclass(frozen=True, slots=True)
class FreeSpace:
    """Free space of one frame.

    Attributes
    ----------
    grid : (rows, cols) int8, -1 unknown, 0 free, 100 occupied; row i along y, column j along x (OccupancyGrid).
    resolution_m, origin_m : side of a cell; x and y of the lower corner of cell (0, 0).
    T_camera_floor : (4, 4) float64. Floor frame: origin below the camera, x ahead, y left, z up.
    camera_height_m : over the floor. source : of the floor plane ("cuboid+depth", "tf+depth", "tf"...).
    obstacles : (n, 3) float32 points of things (no walls, no ceiling), camera frame.
    floor : (m, 3) float32 points of free floor, camera frame.
    scan : RangeScan in the floor frame.
    walls : (n, 4) float64 a, b, c and index of the face (2 left, 3 front, 4 right) of the walls in view, on the floor:
        inside is a x + b y <= c, (a, b) of unit length.
    room_polygon_m : (k, 2) float64 the room on the floor, counter-clockwise, clipped to the grid; empty without a room.
    """

    grid: NDArray[np.int8]
    resolution_m: float
    origin_m: tuple[float, float]
    T_camera_floor: NDArray[np.float64]
    camera_height_m: float
    source: str
    obstacles: NDArray[np.float32]
    floor: NDArray[np.float32]
    scan: RangeScan
    walls: NDArray[np.float64]
    room_polygon_m: NDArray[np.float64]


def compute_free_space(
    geometry: DepthGeometry, estimate: RoomEstimate, config: EstimatorConfig, floor: FloorPlane | None = None
) -> FreeSpace | None:
    """Find the free floor around the camera.

    Parameters
    ----------
    geometry : DepthGeometry
        Of the frame.
    estimate : RoomEstimate
        Of the same frame.
    config : EstimatorConfig
    floor : FloorPlane, optional
        Where TF, an IMU or parameters expect the floor; the cuboid's floor otherwise.

    Returns
    -------
    FreeSpace or None
        None where no floor is in view and none is given.
    """
    fit = fit_floor(geometry, estimate, config, floor)
    if fit is None:
        return None
    T_camera_floor = floor_frame(fit.normal, fit.distance_m)
    walls = walls_on_floor(estimate.cuboid if estimate.metric else None, T_camera_floor)
    walls = refine_walls(geometry, estimate, T_camera_floor, walls)
    barriers = walls[:0] if config.free_beyond_walls else walls
    cells = sum_floor_cells(geometry, fit, T_camera_floor, barriers, config)
    thing = _occupied(cells, config)
    grid = _decide(cells, thing, barriers, _half_view(geometry), geometry.camera.fx, config)
    c = geometry.camera
    _hide_covered(
        grid, geometry.inverse_depth, (c.fx, c.fy, c.cx, c.cy), T_camera_floor, (*cells.origin_m, cells.resolution_m),
        config.robot_height_m,
    )  # fmt: skip
    size, (x0, y0) = cells.resolution_m, cells.origin_m
    box = (x0, y0, x0 + grid.shape[1] * size, y0 + grid.shape[0] * size)
    return FreeSpace(
        grid=grid,
        resolution_m=size,
        origin_m=cells.origin_m,
        T_camera_floor=T_camera_floor,
        camera_height_m=fit.distance_m,
        source=fit.source,
        obstacles=_cloud(geometry, cells, thing, OBSTACLE_PIXEL, config.cloud_step),
        floor=_cloud(geometry, cells, grid == FREE_CELL, FLOOR_PIXEL, config.cloud_step),
        scan=cast_scan(geometry, cells, grid, T_camera_floor, config.scan_beams),
        walls=walls,
        room_polygon_m=room_outline(walls, box) if len(walls) else np.empty((0, 2)),
    )


def _occupied(cells: FloorCells, config: EstimatorConfig) -> NDArray[np.bool_]:
    """Cells in which a thing stands: part of a patch with enough surface above the noise, or floor that is too high.

    The surface is summed over the patch of touching cells: a thing of 3 cm may lie across four of them, while the
    ripple of the sensor makes small patches everywhere.
    """
    some = (cells.obstacle >= _PATCH_SHARE * config.obstacle_min_area) & (cells.obstacle_pixels >= _MIN_PIXELS)
    some &= ~_tails(cells)
    count, patch = cv2.connectedComponents(some.astype(np.uint8), connectivity=8)
    total = np.bincount(patch.ravel(), cells.obstacle.ravel(), count)
    total[0] = 0.0
    return np.asarray((total >= config.obstacle_min_area)[patch] | _raised(cells, config, _LOW_SIGMAS, _LOW_SHARE))


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
    """Cells whose floor pixels lie higher on average than cells at that distance do."""
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


def _decide(
    cells: FloorCells,
    thing: NDArray[np.bool_],
    walls: NDArray[np.float64],
    half_view: float,
    focal_px: float,
    config: EstimatorConfig,
) -> NDArray[np.int8]:
    doubtful = _raised(cells, config, _DOUBT_SIGMAS, 0.5)
    x, y = cells.centres()
    pixel = (x * x + y * y) / (focal_px * cells.resolution_m) ** 2  # share of a cell that a pixel covers there
    beside = cv2.dilate(thing.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    doubtful |= cells.obstacle >= _DOUBT_SHARE * config.obstacle_min_area
    doubtful |= beside & (cells.touched >= np.maximum(_TOUCH_SHARE * config.obstacle_min_area, _TOUCH_PIXELS * pixel))
    free = (cells.seen >= config.free_min_seen) & ~doubtful
    inside = np.ones(free.shape, bool)
    for a, b, c, _ in walls:
        inside &= a * x + b * y <= c
    wall = _wall_cells(cells, walls, half_view, config)
    grid = np.full(free.shape, UNKNOWN_CELL, np.int8)
    grid[free & inside & ~wall] = FREE_CELL
    hole = cells.hole >= _MIN_HOLE
    grid[((thing | hole) & inside) | wall] = OCCUPIED_CELL
    closed = cv2.morphologyEx((grid == OCCUPIED_CELL).astype(np.uint8), cv2.MORPH_CLOSE, _GAP)
    grid[(closed > 0) & (grid == FREE_CELL)] = UNKNOWN_CELL
    reach = np.hypot(x, y) - 0.5 * cells.resolution_m
    nearest = np.where(np.isfinite(cells.nearest_m), cells.nearest_m, reach)
    nearest = np.where((thing | hole) & inside, nearest, np.inf).astype(np.float32)
    margin = config.obstacle_margin_m + 0.25 * cells.resolution_m
    _keep_away(grid, nearest, walls, *cells.origin_m, cells.resolution_m, margin)
    return grid


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
        behind_row = np.clip(rows + round(_BEHIND_CELLS * b), 0, x.shape[0] - 1)
        behind_col = np.clip(cols + round(_BEHIND_CELLS * a), 0, x.shape[1] - 1)
        result |= on & (cells.seen[behind_row, behind_col] < config.free_min_seen)
    for a, b, c, _ in walls:
        result &= a * x + b * y <= c + half * (abs(a) + abs(b))
    return np.asarray(result & (np.abs(np.arctan2(y, x)) <= half_view))


def _half_view(geometry: DepthGeometry) -> float:
    c = geometry.camera
    return float(max(np.arctan2(c.cx + 0.5, c.fx), np.arctan2(c.width - 0.5 - c.cx, c.fx)))


def _cloud(
    geometry: DepthGeometry, cells: FloorCells, where: NDArray[np.bool_], kind: int, step: int
) -> NDArray[np.float32]:
    """(n, 3) float32 points of one kind of pixels whose cell is chosen."""
    kinds, index = cells.kind[::step, ::step], cells.cell[::step, ::step]
    v, u = np.nonzero((kinds == kind) & (index >= 0) & where.ravel()[index])
    rays = geometry.camera.rays()[::step, ::step][v, u]
    return rays / geometry.inverse_depth[::step, ::step][v, u][:, None]


@njit(cache=True, nogil=True)
def _keep_away(grid, nearest, walls, x0, y0, size, margin):  # type: ignore[no-untyped-def]
    """Free cells that have a thing or a wall within the margin behind them, as seen from the camera, become unknown."""
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
            for k in range(len(walls)):
                ahead = walls[k, 0] * (x + margin * ex) + walls[k, 1] * (y + margin * ey)
                if ahead >= walls[k, 2]:
                    near = True
            if near:
                grid[i, j] = -1


@njit(cache=True, nogil=True)
def _hide_covered(grid, inverse, intrinsics, T, corner, robot_height):  # type: ignore[no-untyped-def]
    """Free cells become unknown where a thing hides the space above one of their corners (a chair's seat)."""
    x0, y0, size = corner
    covered = np.zeros((grid.shape[0] + 1, grid.shape[1] + 1), np.bool_)
    for i in range(grid.shape[0] + 1):
        for j in range(grid.shape[1] + 1):
            near = False
            for m in range(max(i - 1, 0), min(i + 1, grid.shape[0])):
                for n in range(max(j - 1, 0), min(j + 1, grid.shape[1])):
                    near = near or grid[m, n] == 0
            if near:
                covered[i, j] = _is_covered(x0 + j * size, y0 + i * size, inverse, intrinsics, T, robot_height)
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            hidden = covered[i, j] or covered[i + 1, j] or covered[i, j + 1] or covered[i + 1, j + 1]
            if hidden and grid[i, j] == 0:
                grid[i, j] = -1


@njit(cache=True, nogil=True)
def _is_covered(x, y, inverse, intrinsics, T, robot_height):  # type: ignore[no-untyped-def]
    """Whether something nearer hides part of the space above a point of the floor."""
    fx, fy, cx, cy = intrinsics
    height, width = inverse.shape
    hidden = 0
    for k in range(1, min(int(robot_height / _COLUMN_STEP_M), _COLUMN_STEPS) + 1):
        h = k * _COLUMN_STEP_M
        z = T[2, 0] * x + T[2, 1] * y + T[2, 2] * h + T[2, 3]
        if z < 0.1:
            continue
        u = int(np.rint((T[0, 0] * x + T[0, 1] * y + T[0, 2] * h + T[0, 3]) / z * fx + cx))
        v = int(np.rint((T[1, 0] * x + T[1, 1] * y + T[1, 2] * h + T[1, 3]) / z * fy + cy))
        if u < 0 or v < 0 or u >= width or v >= height or inverse[v, u] <= 0.0:
            continue
        before = z - 1.0 / inverse[v, u]
        if before > _COVER_M[0] and before < _COVER_M[1]:
            hidden += 1
    return hidden >= _MIN_HIDDEN
