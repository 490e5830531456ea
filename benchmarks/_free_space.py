"""How right is the free space: against the construction of synthetic rooms, cell by cell.

The truth is made of two exact things: which cells are occupied (`floor_map` of the scene, walls and outside included)
and which part of a cell's floor is in sight (samples of the cell against the depth without noise). A cell is truly free
where nothing stands in it and at least half of it is in sight. "In front of" is along the ray from the camera's foot.
Things of which the picture shows not one pixel are counted apart: a single frame cannot know of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, FreeSpace
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import (
    KINECT,
    NOISES,
    SyntheticRoom,
    camera_pose,
    floor_map,
    random_pose,
    random_scene,
    render,
    walk,
)
from room_layout_ros.datasets.synthetic.floor import is_free, rug_height
from room_layout_ros.datasets.synthetic.raster import camera_rectangles, cast
from room_layout_ros.datasets.synthetic.shapes import Material, Solid
from room_layout_ros.evaluation.floor_truth import NEAR_M, floor_in_sight

MARGIN_M = 0.10
CHECKED_M = (1.0, 3.0)
"""Distances at which no cell within `MARGIN_M` in front of an obstacle may be called free."""

OBSTACLE_M = 0.05
"""Height from which on a thing is an obstacle in that check."""


@dataclass(frozen=True, slots=True)
class Mount:
    """A camera on a robot: its optics, and the ranges of its height over the floor and of its pitch."""

    camera: CameraIntrinsics
    height_m: tuple[float, float]
    pitch_deg: tuple[float, float]


MOUNTS = {
    "high": Mount(KINECT, (1.1, 1.65), (-18.0, -3.0)),
    "middle": Mount(KINECT, (0.5, 0.9), (-20.0, -3.0)),
    "low": Mount(CameraIntrinsics(848, 480, 424.0, 424.0, 423.5, 239.5), (0.25, 0.45), (-8.0, 4.0)),
    "steep": Mount(KINECT, (1.1, 1.65), (-40.0, -20.0)),
}
"""Held by hand or on a tall robot; at the height of table tops; wide, on a vacuum cleaner; looking down steeply."""

_FURNISHED: dict[str, Any] = {"small_objects": 12, "furniture": 0.6}
_FINE_M = 0.005
_STEPS = 21


@dataclass(frozen=True, slots=True)
class TrueFreeSpace:
    """What is true of the cells of a grid (rows along y, columns along x, as `FreeSpace.grid`).

    Attributes
    ----------
    occupied : (rows, cols) bool, something stands in the cell, or it is not all inside the room.
    in_sight : (rows, cols) float64 share of its floor that the camera sees.
    measured : (rows, cols) float64 share of its floor that the camera sees and has a depth for.
    near_obstacle : (rows, cols) bool, an obstacle of `OBSTACLE_M` of which the picture shows something stands in the
        cell or within `MARGIN_M` behind its centre, at `CHECKED_M`.
    near_unseen : (rows, cols) bool, the same of things of which not one pixel is in the picture.
    near_anything : (rows, cols) bool, an occupied place is within `MARGIN_M` behind its centre.
    range_m : (rows, cols) float64 distance of the centre.
    """

    occupied: NDArray[np.bool_]
    in_sight: NDArray[np.float64]
    measured: NDArray[np.float64]
    near_obstacle: NDArray[np.bool_]
    near_unseen: NDArray[np.bool_]
    near_anything: NDArray[np.bool_]
    range_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeSpaceScore:
    """Of one frame.

    Attributes
    ----------
    pool, pool_plain, pool_measured : (2,) cells in the intersection and in the union of the free cells within `NEAR_M`:
        with the margin in front of things taken out of the truth too; without; with, and cells without depth left out.
    false_free : cells called free that are occupied or out of the room. too_near : cells called free within
        `MARGIN_M` in front of an obstacle of `OBSTACLE_M` at `CHECKED_M`; too_near_unseen : before things of which
        the picture shows nothing. free : cells called free.
    """

    pool: tuple[int, int]
    pool_plain: tuple[int, int]
    pool_measured: tuple[int, int]
    false_free: int
    too_near: int
    too_near_unseen: int
    free: int

    @property
    def iou(self) -> float:
        """Of this frame; NaN where nothing is free."""
        return ratio(self.pool)


def ratio(pool: Sequence[int] | NDArray[np.int64]) -> float:
    """Return the intersection over the union of cells; NaN where nothing is free."""
    return float(pool[0] / pool[1]) if pool[1] else float("nan")


def _pool(truth: NDArray[np.bool_], called: NDArray[np.bool_]) -> tuple[int, int]:
    return int((truth & called).sum()), int((truth | called).sum())


def true_free_space(
    room: SyntheticRoom, sample: Sample, resolution_m: float, forward_m: float, side_m: float
) -> TrueFreeSpace:
    """Return the truth on a grid that reaches `forward_m` ahead and `side_m` to either side of the camera.

    Raises
    ------
    ValueError
        When the sample has no pose or no true depth.
    """
    if sample.T_world_camera is None or sample.truth is None or sample.truth.depth_m is None:
        raise ValueError(f"sample {sample.name} has no pose or no true depth; a rendered sample is needed")
    pose = sample.T_world_camera
    occupied = _ros_order(floor_map(room, pose, resolution_m, (0.0, forward_m), (-side_m, side_m)).cells) > 0
    rows, cols = occupied.shape
    x = (np.arange(cols) + 0.5)[None, :] * resolution_m + np.zeros((rows, 1))
    y = (np.arange(rows) + 0.5)[:, None] * resolution_m - side_m + np.zeros((1, cols))
    in_sight, measured = floor_in_sight(sample, pose, x, y, resolution_m)
    near = [
        _near(replace(room, solids=things), pose, x, y, resolution_m)
        for things in _by_sight(room, sample.frame.camera, pose)
    ]
    anything = _near(room, pose, x, y, resolution_m)[1]
    return TrueFreeSpace(occupied, in_sight, measured, near[0][0], near[1][0], anything, np.hypot(x, y))


def _by_sight(
    room: SyntheticRoom, camera: CameraIntrinsics, pose: NDArray[np.float64]
) -> tuple[tuple[Solid, ...], tuple[Solid, ...]]:
    """Solids of the things of which at least one pixel is in the picture, and all others."""
    surfaces = room.surfaces
    index, _ = cast(camera_rectangles(surfaces, pose), camera)
    seen = {surfaces[k].thing for k in np.unique(index[index >= 0])}
    return tuple(s for s in room.solids if s.thing in seen), tuple(s for s in room.solids if s.thing not in seen)


def _near(
    room: SyntheticRoom, pose: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], size: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Cells that have an obstacle, and anything at all, in them or within `MARGIN_M` behind their centre."""
    forward_m, side_m = x.shape[1] * size, 0.5 * x.shape[0] * size
    own = _ros_order(floor_map(room, pose, size, (0.0, forward_m), (-side_m, side_m)).height_m)
    reach = (0.0, forward_m + 0.2), (-side_m - 0.2, side_m + 0.2)
    height = _ros_order(floor_map(room, pose, _FINE_M, *reach).height_m)
    range_m = np.hypot(x, y)
    obstacle = np.isfinite(own) & (own >= OBSTACLE_M) & (range_m >= CHECKED_M[0]) & (range_m <= CHECKED_M[1])
    anything = np.zeros_like(obstacle)
    for s in np.linspace(0.0, MARGIN_M, _STEPS):
        px, py = x * (1 + s / range_m), y * (1 + s / range_m)
        i = np.clip(((py + side_m + 0.2) / _FINE_M).astype(int), 0, height.shape[0] - 1)
        j = np.clip((px / _FINE_M).astype(int), 0, height.shape[1] - 1)
        there = height[i, j]
        at = np.hypot(px, py)
        obstacle |= np.isfinite(there) & (there >= OBSTACLE_M) & (at >= CHECKED_M[0]) & (at <= CHECKED_M[1])
        anything |= there > 0
    return obstacle, anything


def score_free_space(truth: TrueFreeSpace, free_space: FreeSpace | None) -> FreeSpaceScore:
    """Compare; no estimate counts as nothing free."""
    called = np.zeros_like(truth.occupied) if free_space is None else free_space.grid == FREE_CELL
    near = truth.range_m <= NEAR_M
    plain = ~truth.occupied & (truth.in_sight >= 0.5) & near
    kept = plain & ~truth.near_anything
    measured = kept & (truth.measured >= 0.5)
    return FreeSpaceScore(
        pool=_pool(kept, called & near),
        pool_plain=_pool(plain, called & near),
        pool_measured=_pool(measured, called & near & ((truth.measured >= 0.5) | ~kept)),
        false_free=int((called & truth.occupied & near).sum()),
        too_near=int((called & truth.near_obstacle).sum()),
        too_near_unseen=int((called & truth.near_unseen & ~truth.near_obstacle).sum()),
        free=int((called & near).sum()),
    )


def _ros_order(cells: NDArray[Any]) -> NDArray[Any]:
    """Turn (forward, right) into (left, forward), the order of OccupancyGrid."""
    return np.ascontiguousarray(cells.T[::-1])


def random_views(
    seeds: Iterable[int], stream: int, noise: str, kind: str = "cuboid", mount: Mount = MOUNTS["high"]
) -> Iterator[tuple[SyntheticRoom, Sample]]:
    """Yield furnished rooms with 12 things of 3-10 cm on the floor, each from a random pose of a camera."""
    for seed in seeds:
        rng = np.random.default_rng([seed, stream])
        room = random_scene(rng, kind, **_FURNISHED)
        pose = random_pose(room, rng, mount.height_m, mount.pitch_deg)
        yield room, render(room, mount.camera, pose, NOISES[noise], rng, name=str(seed))


def views_of_walk(
    seed: int, noise: str, frames: int, rate_hz: float = 1.0, kind: str = "cuboid"
) -> Iterator[tuple[SyntheticRoom, Sample]]:
    """Yield the frames of a walk through such a room: those of `SyntheticSource`, at a rate."""
    rng = np.random.default_rng([seed, 0])
    room = random_scene(rng, kind, **_FURNISHED)
    for i, pose in enumerate(walk(room, rng, frames, rate_hz)):
        chance = np.random.default_rng([seed, 1, i])
        yield room, render(room, KINECT, pose, NOISES[noise], chance, name=f"{seed}/{i}")


def scene_with_small_things(
    rng: np.random.Generator, size_m: float, distance_m: float = 1.5, count: int = 5
) -> tuple[SyntheticRoom, NDArray[np.float64], NDArray[np.float64]]:
    """Return a room, a camera pose and the places (count, 2; x ahead, y left) of cubes at one distance.

    They stand on the floor, or on the rug where one lies.
    """
    room = random_scene(rng, "cuboid", furniture=0.3)
    low, high = room.corners.min(axis=0), room.corners.max(axis=0)
    while True:
        x, y = rng.uniform(low, high)
        yaw = float(rng.uniform(-np.pi, np.pi))
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        clear = [is_free(room, x + s * ahead[0], y + s * ahead[1], 0.45) for s in (0.0, 0.5, 1.0, 1.5)]
        if all(clear):
            break
    height = float(rng.uniform(0.4, 1.4))
    pitch = -float(np.arctan2(height, 2.6))
    bearings = np.deg2rad(np.linspace(-16.0, 16.0, count) + rng.uniform(-2.0, 2.0, count))
    places = distance_m * np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    solids = []
    for k, (forward, left) in enumerate(places):
        at = np.array([x, y]) + forward * ahead + left * np.array([-ahead[1], ahead[0]])
        color = tuple(int(v) for v in rng.integers(40, 220, 3))
        under = rug_height(room, float(at[0]), float(at[1]))
        solids.append(
            Solid(float(at[0]), float(at[1]), float(rng.uniform(0, np.pi)), size_m, size_m, under, under + size_m, 40,
                  Material((color[0], color[1], color[2])), thing=2000 + k)
        )  # fmt: skip
    return room.furnished(tuple(solids)), camera_pose(float(x), float(y), height, yaw, pitch), places


def found_things(free_space: FreeSpace | None, places: NDArray[np.float64], reach_m: float = 0.06) -> int:
    """Return how many places (n, 2) have an occupied cell whose centre is within `reach_m`, and are not free."""
    if free_space is None:
        return 0
    rows, cols = free_space.grid.shape
    x = free_space.origin_m[0] + (np.arange(cols) + 0.5) * free_space.resolution_m
    y = free_space.origin_m[1] + (np.arange(rows) + 0.5) * free_space.resolution_m
    found = 0
    for px, py in places:
        distance = np.hypot(x[None, :] - px, y[:, None] - py)
        own = free_space.grid[np.unravel_index(int(np.argmin(distance)), distance.shape)]
        found += bool((free_space.grid[distance <= reach_m] == OCCUPIED_CELL).any() and own != FREE_CELL)
    return found
