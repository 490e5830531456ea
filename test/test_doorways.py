"""A low camera before an open door: the floor behind is seen too flat, but no wall stands in the opening."""

from __future__ import annotations

import numpy as np
import pytest
from furnished import GREY, ahead_of, empty, free_space_of, with_truth

from room_layout_ros.core.floor.floor_cells import FREE_CELL, OCCUPIED_CELL
from room_layout_ros.core.freespace import FreeSpace
from room_layout_ros.datasets.synthetic import KINECT, NOISES, SyntheticRoom, camera_pose, render
from room_layout_ros.datasets.synthetic.room import Decoration, open_door

WIDTH_M = 0.95
SEEDS = range(4)


def with_a_door(wall: int, depth_m: float = 3.0) -> SyntheticRoom:
    """An empty room with an open door in the middle of a wall."""
    room = empty()
    start, end = room.wall(wall)
    middle = 0.5 * float(np.linalg.norm(end - start) - WIDTH_M)
    return open_door(room, wall, middle, Decoration((GREY,) * 4, GREY, GREY), depth_m, WIDTH_M)


def before_the_door(room: SyntheticRoom, wall: int, height_m: float, away_m: float, seed: int) -> FreeSpace:
    start, end = room.wall(wall)
    along = (end - start) / np.linalg.norm(end - start)
    outward = np.array([along[1], -along[0]])
    x, y = 0.5 * (start + end) - away_m * outward
    pose = camera_pose(float(x), float(y), height_m, float(np.arctan2(outward[1], outward[0])), -0.05)
    sample = render(room, KINECT, pose, NOISES["kinect"], np.random.default_rng(seed))
    space = free_space_of(sample.frame, with_truth(sample))
    assert space is not None
    return space


def longest_way(room: SyntheticRoom) -> tuple[int, float]:
    """The wall that the longest way through the room leads to, and how long it is."""
    ways = [float(np.linalg.norm(np.subtract(*room.wall((k + 1) % 4)))) for k in range(4)]
    return int(np.argmax(ways)), max(ways)


@pytest.mark.parametrize("height_m", [0.3, 0.35])
def test_no_wall_stands_in_an_open_door(height_m: float) -> None:
    wall, way_m = longest_way(empty())
    away_m = min(way_m - 0.4, 3.8)
    for seed in SEEDS:
        space = before_the_door(with_a_door(wall), wall, height_m, away_m, seed)
        near = away_m - 0.1, away_m + 0.1
        in_door = ahead_of(space, near, 0.3)
        assert np.count_nonzero(in_door == OCCUPIED_CELL) <= 1
        for left in (-0.85, 0.85):
            beside = ahead_of(space, near, 0.2, left)
            assert (beside == OCCUPIED_CELL).any(axis=1).all(), "the wall goes on beside the door"
        ahead = np.abs(space.scan.ranges_m[len(space.scan.ranges_m) // 2 - 2 :][:4] - away_m)
        assert not (ahead < 0.15).any(), "nor does the scan tell of one"


def test_before_a_wall_without_a_door_it_is_told() -> None:
    room = empty()
    wall, way_m = longest_way(room)
    away_m = min(way_m - 0.4, 3.8)
    for seed in SEEDS:
        space = before_the_door(room, wall, 0.3, away_m, seed)
        there = ahead_of(space, (away_m - 0.1, away_m + 0.1), 0.8)
        assert (there == OCCUPIED_CELL).any(axis=1).mean() > 0.9
        assert not (ahead_of(space, (away_m + 0.1, away_m + 1.0), 0.8) == FREE_CELL).any()
