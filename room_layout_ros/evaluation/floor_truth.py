"""Free floor of an estimate against the floor map of a rendered frame, on the cells of that map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.freespace import FREE_CELL, FreeSpace
from room_layout_ros.datasets import FloorMap, Sample

from .free_space import NEAR_M, floor_in_sight

IN_SIGHT = 0.5
"""A cell counts as seen when at least this share of its floor is."""


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


def _centres(floor_map: FloorMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, columns = np.indices(floor_map.cells.shape)
    ahead = floor_map.origin_forward_m + (rows + 0.5) * floor_map.cell_m
    right = floor_map.origin_right_m + (columns + 0.5) * floor_map.cell_m
    return np.asarray(ahead), np.asarray(-right)
