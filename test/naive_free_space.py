"""The slow obvious twin of the sums per cell of the floor."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.depth import DepthGeometry
from room_layout_ros.core.floor.floor_cells import FREE_CELL, UNKNOWN_CELL
from room_layout_ros.core.floor.floor_pixels import (
    BEYOND_PIXEL,
    FLOOR_PIXEL,
    FLYING_PIXEL,
    HOLE_PIXEL,
    NOTHING,
    OBSTACLE_PIXEL,
    WALL_PIXEL,
)
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import CLUTTER


def naive_cells(
    geometry: DepthGeometry,
    labels: NDArray[np.uint8],
    T_camera_floor: NDArray[np.float64],
    sigma_m: float,
    walls: NDArray[np.float64],
    shape: tuple[int, int],
    size: float,
    limits: tuple[float, float, float],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return seen, obstacle, hole and gap shares of the cells and the kinds of the pixels; even noise, flat floor."""
    lowest, factor, highest = limits
    T_floor_camera = np.asarray(np.linalg.inv(T_camera_floor), np.float64)
    foot = T_floor_camera[:3, 3]
    height = foot[2]
    camera = geometry.camera
    seen, obstacle, hole, gap = (np.zeros(shape) for _ in range(4))
    kinds = np.zeros((camera.height, camera.width), np.int64)
    for v in range(camera.height):
        for u in range(camera.width):
            w = float(geometry.inverse_depth[v, u])
            ray = np.linalg.inv(camera.matrix) @ (u, v, 1.0)
            if w == 0:
                direction = T_floor_camera[:3, :3] @ ray
                if direction[2] < -1e-3:
                    for part, share in _parts(direction, camera, T_floor_camera, size):
                        _add(gap, foot + part * direction, size, share)
                continue
            point = T_floor_camera[:3, :3] @ (ray / w) + foot
            near_gain = 1.5 if np.hypot(point[0], point[1]) < 1.7 else 0.8 * min(max(3.0 - 1 / w, 0.0), 1.5)
            threshold = max(lowest, (factor - near_gain) * sigma_m)
            tolerance = 0.02 + 3.0 * sigma_m / w / height
            kind, area = NOTHING, 0.0
            if point[2] > highest:
                continue
            if point[2] > threshold:
                if 2 <= u < camera.width - 2 and _hangs(*(float(geometry.inverse_depth[v, u + s]) for s in (-2, 0, 2))):
                    kinds[v, u] = FLYING_PIXEL
                    continue
                gaps = [c - a * point[0] - b * point[1] for a, b, c, _ in walls]
                on_wall = any(g < tolerance for g in gaps) and labels[v, u] != CLUTTER
                kind = WALL_PIXEL if on_wall else OBSTACLE_PIXEL
                kind = BEYOND_PIXEL if any(g < -tolerance for g in gaps) else kind
                area = 1 / (w * w * camera.fx * camera.fy)
            else:
                direction = T_floor_camera[:3, :3] @ ray
                if direction[2] > -1e-3:
                    continue
                kind = FLOOR_PIXEL if point[2] > -threshold else HOLE_PIXEL
                z = -height / direction[2]
                point = foot + z * direction
                area = z**3 / (height * camera.fx * camera.fy)
            kinds[v, u] = kind
            if kind == FLOOR_PIXEL:
                j, i = (int(np.floor(c)) for c in point[:2] / size + (0, shape[0] / 2))
                if 0 <= i < shape[0] and 0 <= j < shape[1]:
                    for part, share in _parts(direction, camera, T_floor_camera, size):
                        _add(seen, foot + part * direction, size, share)
            for sums, what in ((obstacle, OBSTACLE_PIXEL), (hole, HOLE_PIXEL)):
                _add(sums, point, size, (kind == what) * area)
    return seen, obstacle, hole, gap, kinds


def _parts(
    direction: NDArray[np.float64], camera: CameraIntrinsics, T_floor_camera: NDArray[np.float64], size: float
) -> list[tuple[float, float]]:
    """Depths and areas of the parts of a pixel of floor: at most half a cell long, along its ray."""
    height, up = T_floor_camera[2, 3], T_floor_camera[2, :3]
    z, fall = -height / direction[2], np.hypot(up[0] / camera.fx, up[1] / camera.fy) / height
    n = min(int(2.0 * z * z * fall / size) + 1, 16) if z * z * fall >= 0.5 * size else 1
    nearness = 1.0 / z + ((np.arange(n) + 0.5) / n - 0.5) * fall
    return [(1.0 / w, 1.0 / (w**3 * height * camera.fx * camera.fy * n)) for w in nearness if w > 0]


def _hangs(left: float, here: float, right: float) -> bool:
    """Between a near and a far surface, 8 cm from both."""
    near, far = max(left, right), min(left, right)
    return far > 0 and near - here > 0.08 * here**2 and here - far > 0.08 * here**2


def _add(sums: NDArray[np.float64], point: NDArray[np.float64], size: float, area: float) -> None:
    i, j = int(np.floor(point[1] / size + sums.shape[0] / 2)), int(np.floor(point[0] / size))
    if 0 <= i < sums.shape[0] and 0 <= j < sums.shape[1]:
        sums[i, j] += area / size**2


def naive_hidden(
    grid: NDArray[np.int8],
    inverse: NDArray[np.float32],
    kind: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T: NDArray[np.float64],
    corner: tuple[float, float, float],
    robot_height_m: float,
    margin_m: float,
) -> NDArray[np.int8]:
    """Return the grid without the free cells over a corner of which too much of the space is hidden."""
    look = partial(_over, inverse=inverse, kind=kind, camera=camera, T=T, robot_height_m=robot_height_m)
    free = [(int(i), int(j)) for i, j in np.argwhere(grid == FREE_CELL)]
    over = {}
    for m, n in {place for cell in free for place in _corners(*cell)}:
        foot = np.array([corner[0] + n * corner[2], corner[1] + m * corner[2], 0.0])
        farther = foot * (1.0 + margin_m / max(float(np.hypot(*foot[:2])), 1e-9))
        over[m, n] = look(foot)
        beside = not 0 <= _pixel(camera, T, farther)[0] <= camera.width - 1
        if beside and over[m, n] not in ("hidden", "below") and (behind := look(farther)) != "seen":
            over[m, n] = behind
    below = [(i, j) for i, j in np.ndindex(grid.shape) if any(over.get(place) == "below" for place in _corners(i, j))]
    result = grid.copy()
    for i, j in free:
        found = [over[place] for place in _corners(i, j)]
        near_below = any(max(abs(i - m), abs(j - n)) <= max(round(0.15 / corner[2]), 1) for m, n in below)
        if "hidden" in found or "below" in found or (found.count("dark") > 1 and near_below):
            result[i, j] = UNKNOWN_CELL
    return result


def _corners(i: int, j: int) -> tuple[tuple[int, int], ...]:
    return (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)


def _pixel(camera: CameraIntrinsics, T: NDArray[np.float64], point: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = T[:3, :3] @ point + T[:3, 3]
    return float(x / max(z, 0.1) * camera.fx + camera.cx), float(y / max(z, 0.1) * camera.fy + camera.cy), float(z)


def _over(
    place: NDArray[np.float64],
    inverse: NDArray[np.float32],
    kind: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T: NDArray[np.float64],
    robot_height_m: float,
) -> str:
    """What hides the space over a place; to be below a thing goes before being hidden."""
    met: list[tuple[int, float, bool, bool]] = []
    above_floor, low = float(-T[:3, 2] @ T[:3, 3]), 0
    for k in range(1, int(robot_height_m / 0.05 + 1e-6) + 1):
        u, v, z = _pixel(camera, T, place + (0.0, 0.0, 0.05 * k))
        cut = not 0 <= round(u) < camera.width
        col, row = min(max(round(u), 0), camera.width - 1), round(v)
        if z < 0.1 or not 0 <= row < camera.height or inverse[row, col] <= 0:
            continue
        thing = bool(kind[row, col] == OBSTACLE_PIXEL)
        before = z - 1.0 / float(inverse[row, col])
        if before <= (-0.3 if cut and thing else 0.03):
            continue
        met.append((k, before, cut, thing))
        low += k <= 5 and above_floor + (0.05 * k - above_floor) * (z - before) / z < 0.22
        if low >= 3:
            return "below"
        if sum(t and n <= 6 and far < 0.25 for n, far, _, t in met) >= 2 and len(met) >= 4:
            return "below"
        if sum(4 if c and t else 1 for _, far, c, t in met if far < 0.5) >= 4 and k >= 6:
            return "hidden"
    if sum(4 if c and t else 1 for _, far, c, t in met if far < 0.5) >= 4:
        return "hidden"
    return "dark" if sum(n <= 5 for n, *_ in met) >= 3 else "seen"
