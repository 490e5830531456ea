"""The command line: what it offers, how it refuses."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import assert_same_samples, make_samples, write_folder

from room_layout_ros import __version__
from room_layout_ros.cli import COMMANDS, main
from room_layout_ros.datasets import good_samples, open_source


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    return write_folder(tmp_path / "frames", make_samples(3, rng))


def test_version_and_help_tell_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert __version__ in capsys.readouterr().out
    assert main(["--help"]) == 0
    told = capsys.readouterr().out
    for name, text in COMMANDS.items():
        assert name in told
        assert text in told


def parser_of(command: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    importlib.import_module(f"room_layout_ros.commands.{command}").add_arguments(parser)
    return parser


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_a_default_in_the_help_is_the_parsers_own(command: str) -> None:
    """Written by hand it would stay behind when the default changes."""
    for action in parser_of(command)._actions:
        if action.default not in (None, False, [], argparse.SUPPRESS) and "default" in (action.help or ""):
            assert "default %(default)s" in str(action.help), action.option_strings


COUNTS = {"--jobs", "--limit", "--frames", "--rendered", "--rounds", "--epochs", "--threads"}


@pytest.mark.parametrize("value", ["0", "-2", "1.5", "many", ""])
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_what_is_counted_is_a_whole_number_of_1_or_more(
    command: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [action.option_strings[0] for action in parser_of(command)._actions if action.option_strings]
    for option in COUNTS & set(options):
        if (command, option) == ("evaluate", "--frames"):
            continue  # a list of them
        assert main([command, "x", f"{option}={value}"]) == 2
        said = capsys.readouterr().err
        assert f"argument {option}: {value!r} is given; it must be a whole number, 1 or more" in said
        assert len(said.strip().splitlines()) == 1


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_each_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    told = capsys.readouterr().out
    assert f"usage: room-layout {command}" in told
    assert len(told) > 300


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["estimate", "MISSING", "--out", "OUT"], "does not exist"),
        (["estimate", "EMPTY", "--out", "OUT"], "no frames folder"),
        (["estimate", "FOLDER", "--out", "FILE"], "needs a folder"),
        (
            ["estimate", "FOLDER", "--out", "OUT", "--jobs", "0"],
            "argument --jobs: '0' is given; it must be a whole number, 1 or more",
        ),
        (["estimate", "FOLDER", "--out", "OUT", "--jobs", "two"], "it must be a whole number, 1 or more"),
        (["estimate", "FOLDER", "--out", "OUT", "--set", "colour=blue"], "--set colour=blue"),
        (["estimate", "FOLDER", "--out", "OUT", "--set", "max_depth_m=-4"], "allowed is"),
        (["estimate", "FOLDER"], "--out"),
        (["convert", "FOLDER", "FOLDER"], "exists already"),
        (["convert", "MISSING", "OUT"], "does not exist"),
        (["render", "--out", "FOLDER"], "exists already"),
        (["render", "--out", "OUT", "--frames", "0"], "1 or more"),
        (
            ["render", "--out", "OUT", "--seed", "-3"],
            "argument --seed: '-3' is given; it must be a whole number, 0 or more",
        ),
        (["play", "MISSING"], "does not exist"),
        (["play", "FOLDER", "--rate", "0"], "argument --rate: '0' is given; it must be a number, 0.01 to 100"),
        (["play", "FOLDER", "--loops", "-1"], "argument --loops: '-1' is given; it must be a whole number, 0 or more"),
        (["play", "FOLDER", "--wait-timeout", "-1"], "--wait-timeout: '-1' is given; it must be a number, 0 or more"),
        (["convert", "FOLDER", "OUT", "--max-stamp-gap", "-1"], "--max-stamp-gap: '-1' is given; it must be a number,"),
        (["convert", "FOLDER", "OUT", "--max-stamp-gap", "nan"], "'nan' is given; it must be a number, 0 to 60"),
        (["convert", "FOLDER", "OUT", "--max-stamp-gap", "1e300"], "'1e300' is given; it must be a number, 0 to 60"),
        (["convert", "FOLDER", "OUT", "--to", "folder", "--jpeg", "0"], "--jpeg: '0' is given; it must be a whole"),
        (["render", "--out", "OUT", "--jpeg", "101"], "--jpeg: '101' is given; it must be a whole number, 1 to 100"),
        (
            ["render", "--out", "OUT", "--size", "640"],
            "--size: '640' is given; it must be WIDTHxHEIGHT, as 1280x720, each 1",
        ),
        (["render", "--out", "OUT", "--size", "0x480"], "--size: '0x480' is given; it must be WIDTHxHEIGHT"),
        (["render", "--out", "OUT", "--fov", "180"], "--fov: '180' is given; it must be a number, 10 to 150"),
        (["render", "--out", "OUT", "--small-objects", "-1"], "--small-objects: '-1' is given; it must be a whole"),
        (["dashboard", "FOLDER", "--seconds", "-2"], "--seconds: '-2' is given; it must be a number, 0 or more"),
        (
            ["fit", "FOLDER", "--out", "OUT", "--min-quality", "7"],
            "--min-quality: '7' is given; it must be a number, 0",
        ),
        (["fit", "FOLDER", "--out", "OUT", "--max-cost", "-1"], "--max-cost: '-1' is given; it must be a number, 0"),
        (["train", "FOLDER", "--out", "OUT", "--trees", "0"], "--trees: '0' is given; it must be a whole number, 1 or"),
        (["convert", "FOLDER", "OUT", "--jpeg", "90"], "--jpeg 90 is for a frames folder, and a bag is written"),
        (["render", "--out", "OUT", "--to", "bag", "--jpeg", "9"], "--jpeg 9 is for a frames folder, and a bag is"),
        (
            ["render", "--out", "OUT", "--storage", "mcap"],
            "--storage mcap is for a bag, and a frames folder is written",
        ),
        (["estimate", "FOLDER", "--out", "OUT", "--color-topic", "/x"], "--color-topic is for a bag, and "),
        (["estimate", "FOLDER", "--out", "OUT", "--max-stamp-gap", "0"], "--max-stamp-gap is for a bag, and "),
        (["estimate", "FOLDER", "--out", "OUT", "--recover"], "--recover is for a bag, and "),
        (["convert", "FOLDER", "OUT", "--assume-registered"], "--assume-registered is for a bag, and "),
        (["dashboard", "--color-topic", "/x"], "--color-topic is for a bag, and without INPUT the page listens"),
        (["bench", "--depth-topic", "/x"], "--depth-topic is for a bag, and without INPUT a room is rendered"),
        (["train", "FOLDER", "--out", "OUT", "--hold-out", "nosuch"], "--hold-out nosuch: neither one of its lists"),
        (["calibrate", "FOLDER", "--fits", "F", "--out", "OUT", "--hold-out", "nosuch"], "--hold-out nosuch: neither"),
        (["fit", "UNLABELLED", "--out", "OUT"], "labels40 is missing"),
        (["play", "FOLDER", "--topics", "/nowhere"], "--topics chooses from a bag, and"),
        (["evaluate", "FOLDER", "--out", "FILE"], "FILE is a file; --out needs a folder"),
        (["play", "FOLDER", "--remap", "nonsense"], "FROM:=TO"),
        (["dance"], "invalid choice"),
        ([], ""),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    words: list[str], told: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "EMPTY").mkdir()
    (tmp_path / "FILE").write_text("x")
    shutil.copytree(folder, tmp_path / "UNLABELLED")
    shutil.rmtree(tmp_path / "UNLABELLED" / "labels40")
    places = {
        "FOLDER": folder,
        "UNLABELLED": tmp_path / "UNLABELLED",
        **{name: tmp_path / name for name in ("EMPTY", "FILE", "MISSING", "OUT")},
    }
    assert main([str(places.get(word, word)) for word in words]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
    assert error.count("\n") <= 1


def test_an_extra_that_is_missing_is_named_where_the_scene_network_is_trained(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("room_layout_ros.learning.scene_training")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["scene", str(folder), "--fits", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "needs PyTorch: pip install '.[network]' in the clone" in capsys.readouterr().err


def test_play_says_what_no_loops_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", "--help"]) == 0
    assert "0: for ever" in capsys.readouterr().out


def test_convert_goes_both_ways(tmp_path: Path, rng: np.random.Generator) -> None:
    samples = make_samples(3, rng)
    write_folder(tmp_path / "a", samples)
    assert main(["convert", str(tmp_path / "a"), str(tmp_path / "bag"), "--storage", "sqlite3"]) == 0
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "b")]) == 0
    assert_same_samples(list(good_samples(open_source(tmp_path / "b"))), samples)


def test_convert_names_the_frames_it_leaves_out(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "depth" / "frame_007.png").unlink()
    assert main(["convert", str(folder), str(tmp_path / "bag")]) == 0
    told = capsys.readouterr().err
    assert "left out frame_007" in told
    assert "2 frames written" in told


LIMITED = """
import resource, sys
from room_layout_ros.cli import main
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sys.exit(main(sys.argv[2:]))
"""
"""The command, to which the system refuses files of more bytes than its first word says: as a full disk does."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")
@pytest.mark.parametrize(("storage", "limit"), [("mcap", 20_000), ("sqlite3", 20_000), ("sqlite3", 50_000)])
def test_a_bag_that_the_disk_does_not_hold_is_named(storage: str, limit: int, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed (extra playback)")
    bag = tmp_path / "bag"
    words = [str(limit), "convert", str(folder), str(bag), "--storage", storage]
    done = subprocess.run([sys.executable, "-c", LIMITED, *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith(f"room-layout: {bag} cannot be written: ")
    assert "Traceback" not in done.stderr


def test_render_writes_what_the_source_renders(tmp_path: Path) -> None:
    from room_layout_ros.datasets.synthetic import SyntheticSource

    assert main(["render", "--out", str(tmp_path / "walk"), "--frames", "2", "--seed", "5", "--to", "bag"]) == 0
    expected = list(good_samples(SyntheticSource(2, 5)))
    assert_same_samples(list(good_samples(open_source(tmp_path / "walk"))), expected)


def test_render_takes_any_camera(tmp_path: Path) -> None:
    words = ["render", "--out", str(tmp_path / "small"), "--frames", "1", "--size", "224x172", "--fov", "90"]
    assert main(words) == 0
    (sample,) = good_samples(open_source(tmp_path / "small"))
    camera = sample.frame.camera
    assert (camera.width, camera.height) == (224, 172)
    assert camera.fx == pytest.approx(112.0)
    assert (camera.cx, camera.cy) == (111.5, 85.5)
    assert sample.frame.color is not None
    assert sample.frame.color.shape == (172, 224, 3)


def test_an_interrupt_ends_with_130_and_leaves_whole_lines(tmp_path: Path, rng: np.random.Generator) -> None:
    """SIGINT while it works: no traceback, and every line has its images."""
    import signal
    import time

    samples = make_samples(1, rng)
    folder = write_folder(tmp_path / "frames", samples)
    (folder / "stamps.txt").unlink()
    for i in range(400):
        for kind in ("rgb", "depth"):
            os.link(folder / kind / "frame_000.png", folder / kind / f"more_{i:03d}.png")
    process = subprocess.Popen(
        [sys.executable, "-m", "room_layout_ros.cli", "estimate", str(folder), "--out", str(tmp_path / "out")],
        stderr=subprocess.PIPE,
        cwd=Path(__file__).parent.parent,
        # A test run in the background of a script ignores SIGINT, and children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("out/layout/*.png")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=20)
    assert process.returncode == 130
    assert b"Traceback" not in error
    lines = (tmp_path / "out" / "estimates.jsonl").read_text().splitlines()
    images = {p.stem for p in (tmp_path / "out" / "furniture").iterdir()}
    assert len(lines) < 401
    assert {json.loads(line)["name"] for line in lines} <= images
    assert len(images) <= len(lines) + 1, "at most the frame in hand has images and no line"
    assert not list((tmp_path / "out").rglob("*.partial"))
