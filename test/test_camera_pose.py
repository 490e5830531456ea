"""Offline commands on the frames of a camera that hangs on its side or upside down, and is said to."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from room_layout_ros.cli import main
from room_layout_ros.commands import demo, demo_live
from room_layout_ros.commands.camera_pose import CameraPose, pose_of
from room_layout_ros.commands.dashboard import show_source
from room_layout_ros.commands.dashboard_server import Board
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.upright import Turn
from room_layout_ros.datasets import Sample, good_samples, open_source
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter

HANGS = ((180.0, 2), (-90.0, 1), (90.0, 3))
"""Roll of the camera, and the quarters to the left that make its pictures upright."""


def upright() -> list[Sample]:
    return [replace(sample, truth=None, T_world_camera=None) for sample in good_samples(SyntheticSource(2, 1))]


def write_turned(path: Path, quarters: int) -> Path:
    """The frames of `upright` as a camera sees them whose pictures have to be turned so."""
    with FolderWriter(path) as writer:
        for sample in upright():
            writer.write(replace(sample, frame=Turn(-quarters % 4).frame(sample.frame)))
    return path


def estimates(folder: Path, out: Path, *words: str) -> tuple[list[np.ndarray[Any, Any]], list[dict[str, Any]]]:
    assert main(["estimate", str(folder), "--out", str(out), *words]) == 0
    lines = [json.loads(line) for line in (out / "estimates.jsonl").read_text().splitlines()]
    images = [cv2.imread(str(out / "layout" / f"{line['name']}.png"), cv2.IMREAD_UNCHANGED) for line in lines]
    return [np.asarray(image) for image in images], lines


@pytest.mark.parametrize("colour_alone", ([], ["--rgb-only"]), ids=("", "colour alone"))
@pytest.mark.parametrize(("roll", "quarters"), HANGS)
def test_a_turned_camera_that_is_said_to_be_gives_the_room_of_the_upright_one(
    roll: float, quarters: int, colour_alone: list[str], tmp_path: Path
) -> None:
    layouts, lines = estimates(write_turned(tmp_path / "upright", 0), tmp_path / "a", *colour_alone)
    words = ["--camera-roll-deg", str(roll), *colour_alone]
    turned, others = estimates(write_turned(tmp_path / "turned", quarters), tmp_path / "b", *words)
    rotation = Turn(quarters).rotation
    for layout, line, other, said in zip(layouts, lines, turned, others, strict=True):
        np.testing.assert_array_equal(np.rot90(other, quarters), layout)
        assert said["plane_distances_m"] == line["plane_distances_m"]
        assert said["confidence"] == line["confidence"]
        np.testing.assert_allclose(np.array(said["axes"]) @ rotation.T, line["axes"], atol=1e-8)
        floor, there = (
            next(np.array(p["points_m"]) for p in one["polygons"] if p["face"] == "floor") for one in (line, said)
        )
        gaps = np.abs((there @ rotation.T)[:, None] - floor[None]).max(axis=2).min(axis=1)
        assert gaps.max() < 1e-3, "corners of the floor, in whatever order"


def test_a_pitch_is_handed_on_as_gravity(tmp_path: Path) -> None:
    folder = write_turned(tmp_path / "frames", 2)
    taken: list[Any] = []

    class Told(LayoutEstimator):
        def estimate(self, frame: RgbdFrame, prior: Any = None, *rest: Any) -> Any:
            taken.append(prior)

    frame = next(iter(good_samples(open_source(folder)))).frame
    arguments = demo_arguments("--camera-roll-deg", "180", "--camera-pitch-deg", "30")
    pose_of(arguments).estimate(Told(), frame)
    np.testing.assert_allclose(taken[0].gravity, [0.0, -np.cos(np.pi / 6), 0.5], atol=1e-12)


def demo_arguments(*words: str) -> Any:
    import argparse

    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    return parser.parse_args(words)


def test_view_draws_the_frame_upright(tmp_path: Path) -> None:
    folder, out = write_turned(tmp_path / "frames", 1), tmp_path / "color.png"
    words = ["view", str(folder), "--stage", "color", "--out", str(out)]
    assert main([*words, "--camera-roll-deg", "-90"]) == 0
    image = cv2.imread(str(out))
    assert image is not None
    first = upright()[0].frame.color
    assert first is not None
    assert image.shape == first.shape
    assert np.abs(image[..., ::-1].astype(int) - first).mean() < 20, "the title is drawn on it"


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[CameraPose]:
    """The pose of each estimate that is made."""
    taken: list[CameraPose] = []
    whole = CameraPose.estimate

    def spy(pose: CameraPose, *rest: Any) -> Any:
        taken.append(pose)
        return whole(pose, *rest)

    monkeypatch.setattr(CameraPose, "estimate", spy)
    return taken


def test_the_demo_and_the_dashboard_are_told_too(tmp_path: Path, told: list[CameraPose]) -> None:
    folder, out = write_turned(tmp_path / "frames", 2), tmp_path / "out"
    words = ["--input", str(folder), "--out", str(out), "--no-node", "--camera-roll-deg", "180"]
    assert main(["demo", *words]) == 0
    show_source(Board("", 0.0), open_source(folder), float("inf"), pose=CameraPose(Turn(2)))
    assert [pose.turn.quarters for pose in told] == 4 * [2]
    page = (out / "index.html").read_text()
    node = "estimator --ros-args -p pose_source:=parameters -p camera_roll_deg:=180.0"
    assert f"ros2 run room_layout_ros {node}        # or: {node}" in page
    assert "--overlay --camera-roll-deg 180" in page
    both = {"camera_roll_deg": 180.0, "camera_pitch_deg": 20.0}
    assert demo_live.node_words(out / "input", both)[-4:] == [
        *("-p", "camera_roll_deg:=180.0"),
        *("-p", "camera_pitch_deg:=20.0"),
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    (
        (
            ["estimate", "x", "--out", "y", "--camera-roll-deg", "200"],
            "'200' is given; it must be a number, -180 to 180",
        ),
        (["view", "x", "--camera-roll-deg", "left"], "'left' is given; it must be a number, -180 to 180"),
        (["demo", "--camera-roll-deg", "90"], "--camera-roll-deg is of the camera of an input, and without --input"),
        (
            ["dashboard", "--camera-pitch-deg", "9"],
            "--camera-pitch-deg is of the camera of an input, and without INPUT",
        ),
        (
            ["estimate", "x", "--out", "y", "--set", "camera_roll_deg=90"],
            "the option is --camera-roll",
        ),
    ),
)
def test_angles_that_are_none_or_of_no_camera_are_refused(
    words: Sequence[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(list(words))
    except SystemExit as end:
        code = int(end.code or 0)
    assert code == 2
    assert said in capsys.readouterr().err
