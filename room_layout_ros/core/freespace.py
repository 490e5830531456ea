"""Where a robot can drive: the floor around the camera in cells that are free, occupied or not known.

Free is only what was seen free. Occupied is what stands there, wall or thing, and a hole in the floor. Everything else,
behind things, outside the room, where the sensor measured nothing, is not known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import DepthGeometry, compute_depth_geometry
from .estimate import RoomEstimate
from .floor.dark_things import below_dark_things
from .floor.depth_holes import close_holes
from .floor.doorways import see_walls
from .floor.floor_cells import (
    FREE_CELL,
    OCCUPIED_CELL,
    UNKNOWN_CELL,
    FloorCells,
    sum_floor_cells,
)
from .floor.floor_frame import floor_frame, room_outline, view_fan, walls_on_floor
from .floor.floor_pixels import FLOOR_PIXEL, OBSTACLE_PIXEL
from .floor.floor_plane import FloorFit, FloorPlane, fit_floor
from .floor.free_cells import blind_cells, decide_cells, floor_levels, occupied_cells
from .floor.level_things import below_level_things
from .floor.low_things import find_low_things
from .floor.overhang import find_overhung
from .floor.scan import RangeScan, cast_scan
from .floor.seen_space import hide_above_picture
from .floor.sight_lines import in_line_of_sight
from .floor.slow_error import remove_bias
from .floor.thing_surfaces import smooth_things
from .floor.wall_lines import refine_walls
from .frame import RgbdFrame
from .stage_clock import StageClock
from .upright import Turn
from .working_size import resize_estimate, resize_frame

__all__ = ["FREE_CELL", "OCCUPIED_CELL", "UNKNOWN_CELL", "FreeSpace", "compute_free_space", "free_space_of_frame"]


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
    floor : (m, 3) float32 points of free floor before the first thing in their direction, camera frame: a costmap that
        clears along the line from the camera to each of them clears no thing.
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
    geometry: DepthGeometry,
    estimate: RoomEstimate,
    config: EstimatorConfig,
    floor: FloorPlane | None = None,
    color: NDArray[np.uint8] | None = None,
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
    color : (H, W, 3) uint8, optional
        The picture; with it small holes of the depth are floor where no outline runs through them. Not looked at
        with `use_color` off.

    Returns
    -------
    FreeSpace or None
        None where no floor is in view and none is given.
    """
    color = color if config.use_color else None
    turn = Turn.upright(_down(estimate, floor))
    if turn.quarters == 0:
        return _of_upright(geometry, estimate, config, floor, color)
    floor = None if floor is None else replace(floor, normal=turn.rotation @ floor.normal)
    color = None if color is None else turn.image(color)
    found = _of_upright(turn.geometry(geometry), turn.estimate(estimate), config, floor, color)
    return None if found is None else _turned_back(found, turn)


def _down(estimate: RoomEstimate, floor: FloorPlane | None) -> NDArray[np.float64]:
    """(3,) down in the camera frame, as far as known before the floor is fitted."""
    return estimate.R_room_camera[1] if floor is None else floor.normal


def _turned_back(space: FreeSpace, turn: Turn) -> FreeSpace:
    """What lies in the camera frame, in that of the camera before the turn."""
    T = space.T_camera_floor.copy()
    T[:3] = turn.rotation.T @ T[:3]
    back = turn.rotation.astype(np.float32)
    return replace(space, T_camera_floor=T, obstacles=space.obstacles @ back, floor=space.floor @ back)


def _of_upright(
    geometry: DepthGeometry,
    estimate: RoomEstimate,
    config: EstimatorConfig,
    floor: FloorPlane | None,
    color: NDArray[np.uint8] | None,
) -> FreeSpace | None:
    """Free space of a frame in whose picture down is down."""
    seen = _measure(geometry, estimate, config, floor, color)
    if seen is None:
        return None
    cells, T, geometry = seen.cells, seen.T_camera_floor, seen.geometry
    grid, thing = _decide(seen, estimate, config, color)
    size, (x0, y0) = cells.resolution_m, cells.origin_m
    box = (x0, y0, x0 + grid.shape[1] * size, y0 + grid.shape[0] * size)
    with StageClock().beside("scan", cast_scan, geometry, cells, grid, T, config.scan_beams) as scan:
        clear = in_line_of_sight(grid, blind_cells(cells, color, config), cells.corner)
        obstacles = _cloud(geometry, cells, thing, OBSTACLE_PIXEL, config.cloud_step)
        floor_points = _cloud(geometry, cells, clear, FLOOR_PIXEL, config.cloud_step)
        return FreeSpace(
            grid=grid,
            resolution_m=size,
            origin_m=cells.origin_m,
            T_camera_floor=T,
            camera_height_m=seen.fit.distance_m,
            source=seen.fit.source,
            obstacles=obstacles,
            floor=floor_points,
            scan=scan(),
            walls=seen.walls,
            room_polygon_m=room_outline(seen.walls, box) if len(seen.walls) else np.empty((0, 2)),
        )


@dataclass(frozen=True, slots=True)
class _Measured:
    """What the depth says: floor, walls of the cuboid (n, 4), those that end the room, and sums over the cells.

    `geometry` : with the slow error taken off, holes in things closed and things on their planes. `hole_kind` : of
    `close_holes`.
    """

    geometry: DepthGeometry
    fit: FloorFit
    T_camera_floor: NDArray[np.float64]
    walls: NDArray[np.float64]
    barriers: NDArray[np.float64]
    cells: FloorCells
    hole_kind: NDArray[np.uint8]


def _measure(
    geometry: DepthGeometry,
    estimate: RoomEstimate,
    config: EstimatorConfig,
    floor: FloorPlane | None,
    color: NDArray[np.uint8] | None,
) -> _Measured | None:
    """Fit the floor, mend the depth and sort its pixels into the cells of the floor; None without a floor."""
    with StageClock().beside("holes", close_holes, geometry.inverse_depth, estimate.labels, color) as holes_found:
        fit = fit_floor(geometry, estimate, config, floor, color)
        if fit is None:
            return None
        holes = holes_found()
    T_camera_floor = floor_frame(fit.normal, fit.distance_m)
    walls = walls_on_floor(estimate.cuboid if estimate.metric else None, T_camera_floor)
    remove_bias(holes.inverse_depth, fit.bias)
    lowest = config.obstacle_min_height_m
    smooth_things(holes.inverse_depth, estimate.labels, estimate.superpixels, fit, geometry.camera, lowest)
    closed = replace(geometry, inverse_depth=holes.inverse_depth)
    walls = refine_walls(closed, estimate, T_camera_floor, walls)
    barriers = walls[:0] if config.free_beyond_walls else walls
    cells = sum_floor_cells(closed, holes.kind, estimate.labels, fit, T_camera_floor, walls, config)
    return _Measured(closed, fit, T_camera_floor, walls, barriers, cells, holes.kind)


def _decide(
    seen: _Measured, estimate: RoomEstimate, config: EstimatorConfig, color: NDArray[np.uint8] | None
) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
    """Return the grid, without what lies below something, and in which cells a thing stands."""
    cells, inverse_depth, margin = seen.cells, seen.geometry.inverse_depth, config.obstacle_margin_m
    beside, view = StageClock().beside, (seen.geometry.camera, seen.T_camera_floor, cells.corner)
    dark = cells.sums.shape[:2], inverse_depth, seen.hole_kind, cells.kind, color, *view, margin
    with beside("dark things", below_dark_things, *dark) as below_dark:
        grid, thing = _decide_seen(seen, config, color)
        level = grid, inverse_depth, cells.kind, estimate.labels, cells.cell, *view
        with beside("level things", below_level_things, *level) as below_level:
            hidden = find_overhung(grid, inverse_depth, cells.kind, *view, config.robot_height_m, margin)
            hidden |= below_level() | below_dark()
    grid[hidden & (grid == FREE_CELL)] = UNKNOWN_CELL
    return grid, thing


def _decide_seen(
    seen: _Measured, config: EstimatorConfig, color: NDArray[np.uint8] | None
) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
    """Return the grid by what the pixels of each cell show, and in which cells a thing stands."""
    cells, camera, T = seen.cells, seen.geometry.camera, seen.T_camera_floor
    levels = floor_levels(cells)
    thing = occupied_cells(cells, levels, seen.fit.sigma_m, config)
    low, doubt = find_low_things(color, cells, levels, thing, config)
    thing |= low
    walls = seen.barriers, see_walls(cells.kind, camera, T)
    grid = decide_cells(cells, levels, thing, doubt, seen.fit, walls, view_fan(camera, T), camera.fx, config)
    hide_above_picture(grid, camera, T, cells.corner, config.free_seen_height_m)
    return grid, thing


def free_space_of_frame(
    frame: RgbdFrame, estimate: RoomEstimate, config: EstimatorConfig, floor: FloorPlane | None = None
) -> FreeSpace | None:
    """Find the free floor of a frame of any size, at the working size; None without depth or floor."""
    resized = resize_frame(frame, config.working_size_px)
    estimate = resize_estimate(estimate, frame.camera, config.working_size_px)
    geometry = compute_depth_geometry(resized, config)
    return None if geometry is None else compute_free_space(geometry, estimate, config, floor, resized.color)


def _cloud(
    geometry: DepthGeometry, cells: FloorCells, where: NDArray[np.bool_], kind: int, step: int
) -> NDArray[np.float32]:
    """(n, 3) float32 points of one kind of pixels whose cell is chosen."""
    return np.asarray(
        _points(geometry.inverse_depth, geometry.camera.numbers, cells.kind, cells.cell, where.ravel(), kind, step),
        np.float32,
    )


@njit(cache=True, nogil=True)
def _points(inverse, intrinsics, kinds, cell, where, kind, step):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = intrinsics
    height, width = inverse.shape
    points = np.empty((((height + step - 1) // step) * ((width + step - 1) // step), 3), np.float32)
    count = 0
    for v in range(0, height, step):
        for u in range(0, width, step):
            if kinds[v, u] == kind and cell[v, u] >= 0 and where[cell[v, u]]:
                z = 1.0 / inverse[v, u]
                points[count, 0], points[count, 1], points[count, 2] = (u - cx) / fx * z, (v - cy) / fy * z, z
                count += 1
    return points[:count].copy()
