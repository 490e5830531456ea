"""Free floor of an estimate against the floor map of a rendered frame, on the cells of that map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.freespace import FREE_CELL, FreeSpace
from room_layout_ros.datasets import FloorMap, Sample

NEAR_M = 4.0
"""Free space is scored up to this distance from the camera's foot."""

IN_SIGHT = 0.5
"""A cell counts as seen when at least this share of its floor is."""

_SAMPLES = 5
_FLAT_M = 0.02


def called_free(free_space: FreeSpace | None, floor_map: FloorMap) -> NDArray[np.bool_]:
    """Return (rows, columns) bool on the cells of the map: called free; none is where nothing was estimated."""
    ahead, left = _centres(floor_map)
    if free_space is None:
        return np.zeros(ahead.shape, bool)
    row = np.floor((left - free_space.origin_m[1]) / free_space.resolution_m).astype(int)
    column = np.floor((ahead - free_space.origin_m[0]) / free_space.resolution_m).astype(int)
    rows, columns = free_space.grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    free = free_space.grid[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] == FREE_CELL
    return np.asarray(inside & free & (np.hypot(ahead, left) <= NEAR_M))


def truly_free(sample: Sample) -> NDArray[np.bool_] | None:
    """Return (rows, columns) bool on the cells of the sample's floor map, None where it has none.

    A cell is free where nothing stands in it and at least half of its floor is in sight, within `NEAR_M`.
    """
    truth = sample.truth
    if truth is None or truth.floor_map is None or truth.depth_m is None or sample.T_world_camera is None:
        return None
    ahead, left = _centres(truth.floor_map)
    seen, _ = floor_in_sight(sample, sample.T_world_camera, ahead, left, truth.floor_map.cell_m)
    return np.asarray((truth.floor_map.cells == 0) & (seen >= IN_SIGHT) & (np.hypot(ahead, left) <= NEAR_M))


def floor_in_sight(
    sample: Sample, pose: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], size: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the shares of each cell's floor that are in sight, and in sight with a measurement.

    Parameters
    ----------
    sample : rendered, with its true depth. pose : (4, 4) T_world_camera.
    x, y : float64 arrays of one shape; cell centres ahead and to the left of the camera's foot. size : of a cell.
    """
    assert sample.truth is not None
    assert sample.truth.depth_m is not None
    camera, true_depth, sensed = sample.frame.camera, sample.truth.depth_m, sample.frame.depth_m
    forward = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
    left = np.array([-forward[1], forward[0]])
    seen, measured = np.zeros(x.shape), np.zeros(x.shape)
    offsets = ((np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5) * size
    for dx in offsets:
        for dy in offsets:
            on_floor = [pose[k, 3] + (x + dx) * forward[k] + (y + dy) * left[k] for k in range(2)]
            world = np.stack([*on_floor, np.zeros_like(x)], axis=-1)
            point = (world - pose[:3, 3]) @ pose[:3, :3]
            z = np.maximum(point[..., 2], 1e-3)
            u = np.rint(point[..., 0] / z * camera.fx + camera.cx).astype(int)
            v = np.rint(point[..., 1] / z * camera.fy + camera.cy).astype(int)
            within = (point[..., 2] > 0.05) & (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
            u, v = np.clip(u, 0, camera.width - 1), np.clip(v, 0, camera.height - 1)
            # A pixel covers Z^2 / (f h) of the floor along the ray; a rug is seen before it by Z flat / h.
            slack = (0.5 * z / camera.fy + _FLAT_M) * z / pose[2, 3]
            there = within & (np.abs(true_depth[v, u] - z) < slack)
            seen += there
            if sensed is not None:
                measured += there & np.isfinite(sensed[v, u])
    return seen / _SAMPLES**2, measured / _SAMPLES**2


def _centres(floor_map: FloorMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, columns = np.indices(floor_map.cells.shape)
    ahead = floor_map.origin_forward_m + (rows + 0.5) * floor_map.cell_m
    right = floor_map.origin_right_m + (columns + 0.5) * floor_map.cell_m
    return np.asarray(ahead), np.asarray(-right)
