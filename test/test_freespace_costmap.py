"""What Nav2's obstacle layer makes of the clouds with the settings of config/nav2_costmap.yaml."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from furnished import box, empty, free_space_of, with_truth
from numpy.typing import NDArray

from room_layout_ros.core import freespace
from room_layout_ros.core.freespace import FREE_CELL, FreeSpace
from room_layout_ros.core.labels import CLUTTER, FLOOR
from room_layout_ros.datasets.synthetic import KINECT, KINECT_NOISE, NOISES, camera_pose, render
from room_layout_ros.outputs import OUTPUTS

CELL_M, HALF_M = 0.05, 4.0
HEIGHT_M, PITCH = 0.8, -0.3
THING = (0.6, 0.05)


def layer_settings(costmap: str) -> dict[str, Any]:
    file = yaml.safe_load((Path(__file__).parents[1] / "config" / "nav2_costmap.yaml").read_text())
    return dict(file[costmap][costmap]["ros__parameters"]["room_layer"])


class Costmap:
    """A flat grid that is marked and cleared as `nav2_costmap_2d::ObstacleLayer` does: cleared first, then marked."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = settings
        self.marked = np.zeros((round(2 * HALF_M / CELL_M),) * 2, bool)

    def update(self, foot: NDArray[np.float64], floor: NDArray[np.float64], obstacles: NDArray[np.float64]) -> None:
        """Take one frame: where the camera is and the points on the floor plane, (2,), (n, 2), (m, 2), world."""
        nearest, farthest = (self.settings["floor"][f"raytrace_{k}_range"] for k in ("min", "max"))
        reach = np.linalg.norm(floor - foot, axis=1)
        along = np.arange(nearest, farthest, 0.02)
        for end, length in zip(floor, np.minimum(reach, farthest), strict=True):
            line = foot + along[along <= length, None] * (end - foot) / np.linalg.norm(end - foot)
            self.marked[self._cells(line)] = False
        near = np.linalg.norm(obstacles - foot, axis=1) <= self.settings["obstacles"]["obstacle_max_range"]
        self.marked[self._cells(obstacles[near])] = True

    def is_marked(self, x: float, y: float) -> bool:
        """Whether a cell within 7 cm is marked."""
        i, j = (int(k[0]) for k in self._cells(np.array([[x, y]])))
        return bool(self.marked[i - 1 : i + 2, j - 1 : j + 2].any())

    def _cells(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        index = np.clip(((points + HALF_M) / CELL_M).astype(np.int64), 0, len(self.marked) - 1)
        return index[:, 0], index[:, 1]


def on_floor(points: NDArray[np.float32], pose: NDArray[np.float64], step: int) -> NDArray[np.float64]:
    return np.asarray((points[::step] @ pose[:3, :3].T + pose[:3, 3])[:, :2])


def walk_past() -> list[tuple[NDArray[np.float64], FreeSpace]]:
    """Poses and free space on the way to a thing of 4 cm, until it is below the picture."""
    room = empty(box(*THING, 0.05, 0.04))
    frames = []
    for k, x in enumerate(np.arange(-1.5, 0.16, 0.15)):
        pose = camera_pose(float(x), 0.0, HEIGHT_M, 0.0, PITCH)
        sample = render(room, KINECT, pose, KINECT_NOISE, np.random.default_rng(k))
        frames.append((pose, free_space_of(sample.frame, with_truth(sample))))
    return frames


def marks(frames: list[tuple[NDArray[np.float64], FreeSpace]], settings: dict[str, Any]) -> list[bool]:
    """Whether the thing is marked after each frame."""
    costmap, result = Costmap(settings), []
    for pose, seen in frames:
        costmap.update(pose[:2, 3], on_floor(seen.floor, pose, 11), on_floor(seen.obstacles, pose, 1))
        result.append(costmap.is_marked(*THING))
    return result


def test_a_small_thing_stays_marked_when_the_camera_sees_over_it_and_past_it() -> None:
    frames, settings = walk_past(), layer_settings("local_costmap")
    assert all(marks(frames, settings))
    near = {**settings, "floor": {**settings["floor"], "raytrace_min_range": 0.0}}
    assert not all(marks(frames, near)), "floor beyond it would clear it once it is below the picture"


def test_floor_behind_a_thing_would_clear_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame in which the thing is not seen, with and without the sight lines."""
    frames = walk_past()[3:5]
    unseen = [(pose, replace(seen, obstacles=seen.obstacles[:0])) for pose, seen in frames[1:]]
    assert marks([frames[0], *unseen], layer_settings("local_costmap"))[-1]
    monkeypatch.setattr(freespace, "in_line_of_sight", lambda grid, blind, corner: grid == FREE_CELL)
    blind = [(pose, replace(seen, obstacles=seen.obstacles[:0])) for pose, seen in walk_past()[4:5]]
    assert not marks([frames[0], *blind], layer_settings("local_costmap"))[-1]


def test_no_point_of_the_floor_cloud_lies_behind_a_thing() -> None:
    thing = box(0.6, 0.0, 0.3, 0.04)
    pose = camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35)
    sample = render(empty(thing), KINECT, pose)
    seen = free_space_of(sample.frame, with_truth(sample))
    floor = on_floor(seen.floor, pose, 1) - pose[:2, 3]
    towards = np.abs(np.arctan2(floor[:, 1], floor[:, 0])) < np.arctan2(0.14, 2.0)
    assert np.linalg.norm(floor[towards], axis=1).max() < 1.85
    assert (seen.grid[:, 50:] == 0).any(), "floor behind it is free all the same"
    assert np.linalg.norm(floor[~towards], axis=1).max() > 2.5


def test_who_walks_past_leaves_no_marks_where_stereo_loses_some_of_the_floor() -> None:
    """Three frames with a person 2 m ahead, then two of the same room without."""
    pose, costmap = camera_pose(-1.4, 0.0, 0.8, 0.0, PITCH), Costmap(layer_settings("local_costmap"))
    for left in (-0.5, 0.0, 0.5, None, None):
        room = empty() if left is None else empty(box(0.6, left, 0.35, 1.7))
        sample = render(room, KINECT, pose, NOISES["stereo"], np.random.default_rng(5))
        seen = free_space_of(sample.frame, with_truth(sample))
        costmap.update(pose[:2, 3], on_floor(seen.floor, pose, 3), on_floor(seen.obstacles, pose, 1))
        walked = costmap.marked[round((0.3 + HALF_M) / CELL_M) : round((0.9 + HALF_M) / CELL_M), 60:100]
        assert walked.sum() < 5 if left is None else walked.sum() > 5


@pytest.mark.parametrize("with_picture", [True, False])
def test_no_point_of_the_floor_cloud_lies_behind_floor_without_depth(with_picture: bool) -> None:
    """A pit that swallows the light: the line to the floor behind it would clear it."""
    pose = camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35)
    sample = render(empty(), KINECT, pose)
    assert sample.frame.depth_m is not None
    depth = sample.frame.depth_m.copy()
    depth[300:380, 270:370] = np.nan
    frame = replace(sample.frame, depth_m=depth, color=sample.frame.color if with_picture else None)
    seen = free_space_of(frame, with_truth(sample))
    floor = on_floor(seen.floor, pose, 1) - pose[:2, 3]
    towards = np.abs(np.arctan2(floor[:, 1], floor[:, 0])) < np.arctan2(40.0, KINECT.fx)
    assert np.linalg.norm(floor[towards], axis=1).max() < 2.0
    assert np.linalg.norm(floor[~towards], axis=1).max() > 2.5


def test_in_the_dark_no_point_of_the_floor_cloud_lies_behind_a_thing_without_depth() -> None:
    """A box of 10 cm, labelled floor: that it stands there the dark picture does not show."""
    pose = camera_pose(-1.4, 0.0, 1.0, 0.0, -0.35)
    sample = render(empty(box(0.0, 0.0, 0.1, 0.1)), KINECT, pose)
    estimate, depth_m = with_truth(sample), sample.frame.depth_m
    assert depth_m is not None
    assert sample.frame.color is not None
    thing = estimate.labels == CLUTTER
    assert thing.sum() > 500
    dark = replace(sample.frame, depth_m=np.where(thing, np.float32(np.nan), depth_m), color=sample.frame.color // 8)
    seen = free_space_of(dark, replace(estimate, labels=np.where(thing, np.uint8(FLOOR), estimate.labels)))
    floor = on_floor(seen.floor, pose, 1) - pose[:2, 3]
    towards = np.abs(np.arctan2(floor[:, 1], floor[:, 0])) < np.arctan2(0.03, 1.4)
    assert np.linalg.norm(floor[towards], axis=1).max() < 1.45
    assert np.linalg.norm(floor[~towards], axis=1).max() > 2.5


@pytest.mark.parametrize("costmap", ["local_costmap", "global_costmap"])
def test_holes_in_the_floor_reach_the_costmap(costmap: str) -> None:
    """They have no points in ~/obstacles: only the scan tells of them."""
    settings = layer_settings(costmap)
    assert "scan" in settings["observation_sources"].split()
    assert settings["scan"]["marking"]


def test_a_robot_that_has_just_started_stands_in_no_unknown_cells_of_its_local_costmap() -> None:
    """DWB and the recoveries take them for a collision, and nearer than the raytrace range nothing clears them."""
    file = yaml.safe_load((Path(__file__).parents[1] / "config" / "nav2_costmap.yaml").read_text())
    costmaps = {name: file[name][name]["ros__parameters"] for name in ("local_costmap", "global_costmap")}
    assert "track_unknown_space" not in costmaps["local_costmap"]
    assert costmaps["global_costmap"]["track_unknown_space"]
    assert all(costmap["transform_tolerance"] >= 1.0 for costmap in costmaps.values())


@pytest.mark.parametrize("costmap", ["local_costmap", "global_costmap"])
def test_the_costmap_listens_to_topics_that_exist(costmap: str) -> None:
    settings = layer_settings(costmap)
    outputs = {output.topic.replace("~", "/estimator"): output.message.__name__ for output in OUTPUTS}
    sources = settings["observation_sources"].split()
    assert "obstacles" in sources
    assert "floor" in sources
    for source in sources:
        assert outputs[settings[source]["topic"]] == settings[source]["data_type"]
        assert settings[source]["clearing"] == (source == "floor"), "only floor that was seen clears"
