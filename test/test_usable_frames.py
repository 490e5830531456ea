"""Where no frame of an input can be used, every command says what is wrong with the first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import make_samples, write_folder

from room_layout_ros.cli import main
from room_layout_ros.commands.dashboard import show_source
from room_layout_ros.commands.dashboard_server import Board
from room_layout_ros.commands.view import find_frame
from room_layout_ros.datasets import BadFrame, DataError, Sample, open_source
from room_layout_ros.datasets.usable import usable_samples

REASON = "frames holds no usable frame: frame_000: "


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Two frames whose depth is cut."""
    path = write_folder(tmp_path / "frames", make_samples(2, np.random.default_rng(0)))
    for file in (path / "depth").iterdir():
        file.write_bytes(file.read_bytes()[:100])
    return path


@pytest.mark.parametrize(
    "command",
    [["view", "--rrd", "OUT"], ["bench"], ["demo", "--no-node", "--out", "OUT", "--input"]],
    ids=lambda command: command[0],
)
def test_a_command_that_finds_no_usable_frame_says_why(
    command: list[str], frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if command[0] == "view":
        pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra viz)")
    words = [word.replace("OUT", str(tmp_path / "out")) for word in command]
    assert main([*words, str(frames)]) == 2
    said = capsys.readouterr().err
    assert REASON in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_dashboard_says_why_too(frames: Path) -> None:
    with pytest.raises(DataError, match=REASON):
        show_source(Board("frames"), open_source(frames), float("inf"))


def test_a_named_frame_that_cannot_be_used_is_no_word_on_the_others(
    frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra viz)")
    assert main(["view", str(frames), "--frame", "frame_007", "--rrd", str(tmp_path / "out")]) == 2
    assert "frame frame_007 cannot be used: " in capsys.readouterr().err


def test_usable_frames_are_all_there_whatever_is_between_them() -> None:
    first, second = make_samples(2, np.random.default_rng(0))
    items: list[Sample | BadFrame] = [BadFrame("a", "cut"), first, BadFrame("b", "cut"), second]
    assert [sample.name for sample in usable_samples("bag x", items)] == [first.name, second.name]
    with pytest.raises(DataError, match=r"^bag x holds no usable frame$"):
        list(usable_samples("bag x", []))


def test_without_a_name_view_shows_the_first_frame_that_can_be_used(tmp_path: Path) -> None:
    path = write_folder(tmp_path / "frames", make_samples(2, np.random.default_rng(0)))
    source = open_source(path)
    names = [item.name for item in source]
    damaged = path / "depth" / f"{names[0]}.png"
    damaged.write_bytes(damaged.read_bytes()[:100])
    assert find_frame(open_source(path), None).name == names[1]
    with pytest.raises(DataError, match=f"frame {names[0]} cannot be used: "):
        find_frame(open_source(path), names[0])
