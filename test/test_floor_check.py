"""Whether depth speaks for a given floor, against it, or says nothing: without labels, which follow a wrong pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import FRONT_WALL
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.floor_check import FloorCheck
from room_layout_ros.floor_pose import FloorPose
from room_layout_ros.node_config import NodeConfig

CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)


def check(
    pose: dict[str, float],
    pitch_deg: float = 20.0,
    front_m: float = 3.0,
    height_m: float = 1.0,
    floor_label: bool = False,
) -> FloorCheck:
    """Return what the depth says of a room that is seen from 1 m, 20 degrees down, by a node that is told `pose`."""
    pitch = np.deg2rad(pitch_deg)
    nod = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    room = RoomCuboid(nod, np.array([2.5 - height_m, height_m, 1.8, front_m, 2.2]))
    frame = RgbdFrame(CAMERA, None, room.depth(CAMERA), 1, "camera")
    layout = room.raster(CAMERA)
    labels = layout if floor_label else np.full_like(layout, FRONT_WALL)
    told: dict[str, Any] = {"camera_height": height_m, "camera_pitch_deg": pitch_deg, **pose}
    node = NodeConfig(pose_source="parameters", **told)
    floor = FloorPose(lambda *_: None).expect("camera", 1, node)
    config = EstimatorConfig()
    geometry = compute_depth_geometry(frame, config)
    assert geometry is not None
    return FloorCheck(geometry, labels, floor, config)


UPSIDE_DOWN, ON_ITS_SIDE = {"camera_roll_deg": 180.0}, {"camera_roll_deg": -90.0}


@pytest.mark.parametrize(
    "pose",
    (UPSIDE_DOWN, ON_ITS_SIDE, {"camera_roll_deg": 90.0}, {"camera_pitch_deg": 65.0}, {"camera_height": 0.4}),
    ids=str,
)
def test_d03_depth_that_measures_through_the_given_floor_denies_it(pose: dict[str, float]) -> None:
    assert check(pose).denies_floor


@pytest.mark.parametrize("pose", (UPSIDE_DOWN, {"camera_roll_deg": 90.0}, ON_ITS_SIDE, {"camera_height": 2.0}), ids=str)
def test_d03_a_given_floor_before_which_all_stands_is_hidden(pose: dict[str, float]) -> None:
    """Seen from 1.5 m, level: ceiling and walls are nearer than the floor is said to be."""
    assert check(pose, pitch_deg=5.0, height_m=1.5).hides_floor


@pytest.mark.parametrize(
    ("place", "hidden"),
    (
        ({}, False),
        ({"pitch_deg": 60.0}, False),
        ({"pitch_deg": -35.0}, False),
        ({"height_m": 0.3, "pitch_deg": 5.0}, False),
        ({"height_m": 0.3, "pitch_deg": 5.0, "front_m": 0.4}, True),
    ),
    ids=("as it is", "steep", "no floor in view", "low", "before a wall"),
)
def test_d03_the_right_floor_is_not_denied_whatever_the_labels_are(place: dict[str, Any], hidden: bool) -> None:
    right = check({}, **place)
    assert not right.denies_floor
    assert right.hides_floor == hidden


def test_d03_floor_that_is_seen_by_its_label_elsewhere_denies_the_given_one() -> None:
    assert check({"camera_height": 1.4}, floor_label=True).denies_floor
    assert not check({"camera_height": 1.4}).denies_floor, "nothing is below it"


def test_d03_a_floor_of_which_the_height_is_not_given_is_nowhere_to_be_looked_for() -> None:
    without = check({"camera_height": 0.0, **UPSIDE_DOWN})
    assert not without.denies_floor
    assert not without.hides_floor


@pytest.mark.parametrize(
    ("pose", "level"),
    (
        ({}, True),
        (UPSIDE_DOWN, False),
        (ON_ITS_SIDE, False),
        ({"camera_pitch_deg": -20.0}, False),
        ({"camera_pitch_deg": 45.0}, False),
    ),
    ids=str,
)
def test_d03_a_tilt_fits_where_what_is_labelled_floor_lies_level_below(pose: dict[str, float], level: bool) -> None:
    assert check({"camera_height": 0.0, **pose}, floor_label=True).has_level_floor == level
    assert not check({"camera_height": 0.0, **pose}).has_level_floor, "nothing is labelled so"
