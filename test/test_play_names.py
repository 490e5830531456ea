"""`room-layout play --remap` and `--topics`: names as ROS takes them, and a sentence where nothing has the name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import make_samples, write_folder

from room_layout_ros import cli
from room_layout_ros.commands import play
from room_layout_ros.datasets.bag_topics import COLOR_INFO_TOPIC, COLOR_TOPIC, DEPTH_TOPIC
from room_layout_ros.datasets.writers import BagWriter
from room_layout_ros.playback import PlayOptions, PlayResult, RawMessage


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    return write_folder(tmp_path / "frames", make_samples(2, rng))


@pytest.fixture
def bag(tmp_path: Path, rng: np.random.Generator) -> Path:
    with BagWriter(tmp_path / "bag") as writer:
        for sample in make_samples(2, rng):
            writer.write(sample)
    return tmp_path / "bag"


class Played:
    """Takes the place of `play`: keeps what would be sent, and the options."""

    def __init__(self) -> None:
        self.topics: set[str] = set()
        self.options = PlayOptions()

    def __call__(self, read: object, options: PlayOptions, _progress: object) -> PlayResult:
        assert callable(read)
        self.options = options
        for message in read():
            assert isinstance(message, RawMessage)
            self.topics.add(message.topic)
        return PlayResult({}, interrupted=False)


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Played:
    played = Played()
    monkeypatch.setattr(play, "play", played)
    return played


@pytest.mark.parametrize("kind", ("bag", "folder"))
@pytest.mark.parametrize("slash", ("", "/"))
def test_a_name_without_a_slash_is_the_same_topic_as_for_ros(
    kind: str, slash: str, played: Played, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(kind)
    assert cli.main(["play", str(path), "--remap", f"{slash}{COLOR_TOPIC[1:]}:={slash}my/color"]) == 0
    assert played.options.remappings == ((COLOR_TOPIC, "/my/color"),)


@pytest.mark.parametrize("kind", ("bag", "folder"))
@pytest.mark.parametrize("name", ("/rgb/image", "rgb/image"))
def test_a_topic_that_is_not_there_is_refused_with_those_that_are(
    kind: str, name: str, played: Played, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    path = request.getfixturevalue(kind)
    assert cli.main(["play", str(path), "--remap", f"{name}:=/my/color"]) == 2
    told = capsys.readouterr().err
    assert f"--remap: there is no topic /rgb/image in {path}; there are" in told
    for topic in (COLOR_TOPIC, DEPTH_TOPIC, COLOR_INFO_TOPIC):
        assert topic in told
    assert told.count("\n") == 1
    assert not played.topics


@pytest.mark.parametrize("slash", ("", "/"))
def test_topics_are_named_alike(bag: Path, slash: str, played: Played) -> None:
    assert cli.main(["play", str(bag), "--topics", f"{slash}{COLOR_TOPIC[1:]}", DEPTH_TOPIC]) == 0
    assert played.topics == {COLOR_TOPIC, DEPTH_TOPIC}


def test_a_topic_to_play_that_is_not_there_is_refused(
    bag: Path, played: Played, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["play", str(bag), "--topics", COLOR_TOPIC, "/nothing"]) == 2
    assert f"--topics: there is no topic /nothing in {bag}; there are" in capsys.readouterr().err
    assert not played.topics


def test_a_topic_that_is_not_among_those_to_play_cannot_be_renamed(
    bag: Path, played: Played, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["play", str(bag), "--topics", COLOR_TOPIC, "--remap", f"{DEPTH_TOPIC}:=/my/depth"]) == 2
    told = capsys.readouterr().err
    assert f"--remap: there is no topic {DEPTH_TOPIC} among the --topics; there are {COLOR_TOPIC}" in told
    assert not played.topics
