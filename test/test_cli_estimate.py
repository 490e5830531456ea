"""`room-layout estimate`: the offline contract of docs, to the letter."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from damaged_bags import damage_middle
from frames_on_disk import make_samples, write_folder

from room_layout_ros.cli import main
from room_layout_ros.commands import estimate as estimate_command
from room_layout_ros.commands.estimate_frame import FrameJob, FrameResult, estimate_item
from room_layout_ros.commands.output_folder import held_alone
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import FACES, LABEL_NAMES
from room_layout_ros.core.models import config_folder
from room_layout_ros.core.weights import N_FEATURES, ModelWeights, save_weights, start_weights
from room_layout_ros.datasets import BadFrame, FramesFolder, FrameSource, Sample, good_samples, open_source
from room_layout_ros.datasets.convert import copy_frames
from room_layout_ros.datasets.readable import ReadablePart
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import STORAGES, BagWriter, FolderWriter

KINDS = ("layout", "labels", "furniture")

pytestmark = pytest.mark.usefixtures("few_draws")


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("walk") / "frames"
    copy_frames(SyntheticSource(4, 1), FolderWriter(path))
    return path


def islice_source(path: Path, count: int) -> FrameSource:
    source = open_source(path)
    assert isinstance(source, FramesFolder)
    return source.subset(source.names[:count])


def lines_of(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "estimates.jsonl").read_text().splitlines()]


def images_of(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*.png"))}


def estimates_without_times(out: Path) -> list[dict[str, Any]]:
    return [{k: v for k, v in line.items() if k not in ("timings_ms", "milliseconds")} for line in lines_of(out)]


@pytest.fixture(scope="module")
def result(walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "deep" / "er"
    assert main(["estimate", str(walk), "--out", str(out), "--overlay"]) == 0
    return out


def test_every_frame_has_its_line_and_images_in_order(walk: Path, result: Path) -> None:
    names = [s.name for s in good_samples(open_source(walk))]
    assert [line["name"] for line in lines_of(result)] == names
    for name in names:
        for kind, highest in zip(KINDS, (5, 6, 40), strict=True):
            image = cv2.imread(str(result / kind / f"{name}.png"), cv2.IMREAD_UNCHANGED)
            assert image is not None
            assert image.shape == (480, 640)
            assert image.dtype == np.uint8
            assert image.max() <= highest
        overlay = cv2.imread(str(result / "overlay" / f"{name}.jpg"))
        assert overlay is not None
        assert overlay.shape == (480, 640, 3)


def test_a_line_tells_what_the_estimator_told(walk: Path, result: Path) -> None:
    from room_layout_ros.core.estimator import LayoutEstimator

    sample, line = next(iter(good_samples(open_source(walk)))), lines_of(result)[0]
    estimate = LayoutEstimator().estimate(sample.frame)
    assert line["status"] == estimate.status.name == "OK"
    np.testing.assert_allclose(line["axes"], estimate.R_room_camera, atol=1e-8)
    np.testing.assert_allclose(np.array(line["axes"]) @ np.array(line["axes"]).T, np.eye(3), atol=1e-7)
    assert estimate.cuboid is not None
    for face, distance in zip(FACES, estimate.cuboid.distances, strict=True):
        told = line["plane_distances_m"][LABEL_NAMES[face]]
        assert told is None if np.isinf(distance) else told == pytest.approx(distance, abs=1e-5)
    assert [p["id"] for p in line["polygons"]] == [p.face for p in estimate.polygons]
    for told, polygon in zip(line["polygons"], estimate.polygons, strict=True):
        np.testing.assert_allclose(told["pixels"], polygon.pixels, atol=1e-3)
        np.testing.assert_allclose(told["points_m"], polygon.points_m, atol=1e-4)
    proved = LayoutEstimator(EstimatorConfig(joint_bound=True)).estimate(sample.frame)
    assert line["energy"] == pytest.approx(estimate.energy, abs=1e-6)
    assert line["lower_bound"] == pytest.approx(proved.lower_bound, abs=1e-6)
    assert line["gap"] == pytest.approx(line["energy"] - line["lower_bound"], abs=2e-6)
    assert 0 <= line["gap"] < 1.0, "of the image"
    assert set(line["timings_ms"]) == set(estimate.timings_ms)
    assert all(0 <= line["face_confidence"][LABEL_NAMES[f]] <= 1 for f in FACES)
    layout = cv2.imread(str(result / "layout" / f"{sample.name}.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(layout, estimate.layout)


def test_the_milliseconds_of_a_line_are_the_wall_time(walk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages run beside each other: their sum is no time of a frame."""
    from room_layout_ros.commands import estimate_frame
    from room_layout_ros.core.estimator import LayoutEstimator

    sample = next(iter(good_samples(open_source(walk))))
    estimate = LayoutEstimator().estimate(sample.frame)

    class Slow:
        def estimate(self, frame: object, prior: object = None) -> object:
            time.sleep(0.02)
            return replace(estimate, timings_ms=dict.fromkeys(estimate.timings_ms, 1e6))

    monkeypatch.setattr(estimate_frame, "_estimator", lambda *_: Slow())
    line = estimate_frame.estimate_item(estimate_frame.FrameJob(EstimatorConfig()), sample).line
    assert 20 <= line["milliseconds"] < 1e6


@pytest.fixture
def own_models(tmp_path: Path) -> Path:
    """A copy of the shipped models in which the weights with depth and network are those set by hand."""
    folder = tmp_path / "models"
    folder.mkdir()
    for path in config_folder().glob("*.npz"):
        (folder / path.name).symlink_to(path.resolve())
    (folder / "joint_rgbd.npz").unlink()
    save_weights(start_weights(), folder / "joint_rgbd.npz")
    return folder


def test_models_of_ones_own_are_those_that_estimate(walk: Path, result: Path, own_models: Path, tmp_path: Path) -> None:
    from room_layout_ros.core.estimator import LayoutEstimator

    command = ["estimate", str(walk), "--out", str(tmp_path / "out"), "--limit", "1"]
    assert main([*command, "--models", str(own_models)]) == 0
    (line,) = lines_of(tmp_path / "out")
    sample = next(iter(good_samples(open_source(walk))))
    estimate = LayoutEstimator(models=own_models).estimate(sample.frame)
    assert line["energy"] == pytest.approx(estimate.energy, abs=1e-6)
    assert line["energy"] != pytest.approx(lines_of(result)[0]["energy"], abs=1e-3), "the shipped ones say otherwise"


def test_models_of_ones_own_are_those_that_are_measured(walk: Path, own_models: Path, tmp_path: Path) -> None:
    save_weights(ModelWeights(np.zeros(N_FEATURES)), own_models / "zero.npz")
    (own_models / "zero.npz").replace(own_models / "joint_rgb.npz")
    command = ["evaluate", str(walk), "--rgb-only", "--frames", "0", "--baseline", "none", "--no-report"]
    errors = []
    for out, more in (("shipped", []), ("own", ["--models", str(own_models)])):
        assert main([*command, "--out", str(tmp_path / out), *more]) == 0
        errors.append(json.loads((tmp_path / out / "summary.json").read_text())["methods"]["ours, RGB"])
    assert errors[0]["labelling_error"] < errors[1]["labelling_error"], "weights of 0 know no label"


@pytest.mark.parametrize("command", ["estimate", "evaluate"])
def test_a_folder_that_lacks_a_model_is_refused_in_one_sentence_before_the_first_frame(
    command: str, walk: Path, own_models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [command, str(walk), "--out", str(tmp_path / "out")]
    (own_models / "confidence_rgb.npz").unlink()
    for folder, named in ((own_models, "confidence_rgb.npz"), (tmp_path / "nowhere", "scene.npz")):
        assert main([*words, "--models", str(folder)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"room-layout: {folder / named} cannot be read: No such file or directory; --models")
        assert said.count("\n") == 1
        assert not list((tmp_path / "out").glob("*"))


def test_a_bag_without_camera_info_is_estimated_with_a_calibration_file(
    walk: Path, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed (extra playback)")
    from rosbags.rosbag2 import StoragePlugin, Writer

    from room_layout_ros.datasets import bag_messages as messages

    frame = next(iter(good_samples(open_source(walk)))).frame
    assert frame.color is not None
    assert frame.depth_m is not None
    bag, mm = tmp_path / "bag", np.nan_to_num(np.rint(frame.depth_m * 1000)).astype(np.uint16)
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, pixels, encoding in (("/rgb/image", frame.color, "rgb8"), ("/depth/image", mm, "16UC1")):
            connection = writer.add_connection(topic, messages.IMAGE, typestore=messages.typestore())
            writer.write(connection, 5, messages.encode_image_message(pixels, encoding, 5, "optical"))
    command = ["estimate", str(bag), "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert "give a calibration file with --camera" in capsys.readouterr().err
    assert main([*command, "--camera", str(walk / "camera.yaml")]) == 0
    (line,) = lines_of(tmp_path / "out")
    assert line["plane_distances_m"] == lines_of(result)[0]["plane_distances_m"]


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("robot_hieght_m=1", "the estimator has no parameter robot_hieght_m; the nearest name is robot_height_m"),
        ("zzz=1", "the estimator has no parameter zzz; docs/parameters.md has all of them"),
        ("warm_start=false", "warm_start is a parameter of the node, not of the estimator"),
        ("robot_height_m", "NAME=VALUE with a parameter of the estimator is needed"),
    ],
)
def test_a_setting_that_is_none_is_refused(
    setting: str, said: str, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(walk), "--out", str(tmp_path), "--set", setting]) == 2
    assert f"--set {setting}: {said}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "use_color=false", "--set", "use_depth=false"], "use_color and use_depth are both false"),
        (["--rgb-only", "--set", "use_color=false"], "--rgb-only leaves the depth unused, and use_color is false"),
    ],
)
@pytest.mark.parametrize(
    "command", [["estimate", "--out", "OUT"], ["view"], ["bench"], ["evaluate"]], ids=lambda c: c[0]
)
def test_with_neither_stream_there_is_nothing_to_estimate(
    command: list[str], words: list[str], said: str, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *more = [word.replace("OUT", str(tmp_path / "out")) for word in command]
    assert main([name, str(walk), *more, *words]) == 2
    assert f"{said}; the estimator needs at least one of the two streams" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "read"), [("images", False), ("image", True)])
def test_colour_that_is_not_read_is_told_once(
    name: str, read: bool, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(walk, tmp_path / "frames")
    (tmp_path / "frames" / "rgb").rename(tmp_path / "frames" / name)
    assert main(["estimate", str(tmp_path / "frames"), "--out", str(tmp_path / "out")]) == 0
    told = "is read as depth alone: it has no colour in a folder of the names rgb/, color/, image/; images/ is not read"
    assert capsys.readouterr().err.count(told) == (not read)


COLOR_ALONE = "estimated from colour alone, lengths have no unit"
ALLOWED = "; 16 bit must be millimetres, float metres, and 2 % of the pixels measured from 0.2 to 12 m"


@pytest.fixture
def two(walk: Path, tmp_path: Path) -> Path:
    """Two frames of the walk, to be spoilt."""
    folder = tmp_path / "frames"
    copy_frames(islice_source(walk, 2), FolderWriter(folder))
    return folder


def scale_depth(folder: Path, factor: float) -> None:
    for path in (folder / "depth").iterdir():
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        cv2.imwrite(str(path), np.clip(np.rint(depth * factor), 0, 65535).astype(np.uint16))


@pytest.mark.parametrize("command", ["estimate", "evaluate"])
@pytest.mark.parametrize("factor", [0.0, 0.001], ids=["zeros", "metres"])
def test_depth_that_is_of_no_use_is_told_once_unless_it_is_not_asked_for(
    command: str, factor: float, two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scale_depth(two, factor)
    words = [command, str(two), "--out", str(tmp_path / "out"), *(["--no-report"] if command == "evaluate" else [])]
    assert main(words) == 0
    told = f"2 of 2 frames have no usable depth: {COLOR_ALONE}{ALLOWED}\n"
    assert capsys.readouterr().err.count(told) == 1
    for unused in (["--rgb-only"], ["--set", "use_depth=false"]):
        assert main([*words, *unused]) == 0
        assert "usable depth" not in capsys.readouterr().err


def test_a_frame_without_colour_and_usable_depth_is_no_estimate(
    two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(two / "rgb")
    (two / "depth" / "000001.png").write_bytes(cv2.imencode(".png", np.zeros((480, 640), np.uint16))[1].tobytes())
    assert main(["estimate", str(two), "--out", str(tmp_path / "out")]) == 0
    assert f"1 of 2 frames has no usable depth: nothing could be estimated{ALLOWED}\n" in capsys.readouterr().err
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["OK", "NO_DEPTH"]


@pytest.mark.parametrize("dark", [1, 2])
def test_frames_without_a_room_are_counted_and_not_called_estimated(
    dark: int, two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("000000", "000001")[:dark]:
        for stream, pixels in (("rgb", np.zeros((480, 640, 3), np.uint8)), ("depth", np.zeros((480, 640), np.uint16))):
            cv2.imwrite(str(two / stream / f"{name}.png"), pixels)
    assert main(["estimate", str(two), "--out", str(tmp_path / "out")]) == 0
    assert [line["status"] for line in lines_of(tmp_path / "out")] == [*["NO_ROOM"] * dark, *["OK"] * (2 - dark)]
    said = capsys.readouterr().err
    have = "has" if dark == 1 else "have"
    assert f"{dark} of 2 frames {have} no room: no room in view ({dark})\n" in said
    assert f"{dark} of 2 frames {have} no usable depth: no room was found{ALLOWED}\n" in said
    assert COLOR_ALONE not in said


def test_where_every_frame_has_a_room_nothing_is_said_of_that(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(walk), "--limit", "1", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert "frames: 1 frame; results in " in said
    assert "no room" not in said


@pytest.mark.parametrize(
    "command",
    [["estimate", "--out", "OUT"], ["view", "--out", "OUT.png"], ["evaluate", "--no-report"]],
    ids=lambda c: c[0],
)
@pytest.mark.parametrize("kept", [True, False])
def test_that_the_first_start_compiles_is_told_once_and_nothing_where_it_does_not(
    command: list[str],
    kept: bool,
    two: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("room_layout_ros.commands.compiling.is_compiled", lambda _: kept)
    name, *words = [word.replace("OUT", str(tmp_path / "out")) for word in command]
    assert main([name, str(two), *words]) == 0
    told = "compiling the estimator, which takes one to four minutes the first time; the next start is fast\n"
    assert capsys.readouterr().err.count(told) == (not kept)


def test_kernels_are_kept_where_numba_has_them(walk: Path, result: Path, tmp_path: Path) -> None:
    asks = """
from room_layout_ros.commands.compiling import tell_if_compiling
from room_layout_ros.core.config import EstimatorConfig
tell_if_compiling(EstimatorConfig())
"""
    for where, silent in ({}, True), ({"NUMBA_CACHE_DIR": str(tmp_path)}, False):
        environment = {**os.environ, **where}
        done = subprocess.run([sys.executable, "-c", asks], env=environment, capture_output=True, text=True, check=True)
        assert (done.stderr == "") == silent, done.stderr


@pytest.mark.parametrize("name", ["Depth", None])
def test_depth_that_is_not_there_is_told_and_its_folder_if_it_is_misspelt(
    name: str | None, two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (two / "depth").rename(two / name if name else tmp_path / "elsewhere")
    assert main(["estimate", str(two), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert said.count(f"2 of 2 frames have no depth: {COLOR_ALONE}\n") == 1
    misspelt = "is read as colour alone: it has no depth in a folder of the name depth/; Depth/ is not read\n"
    assert said.count(misspelt) == (name is not None)


def test_a_room_of_a_strange_size_is_a_question_about_the_unit(
    two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(two), "--out", str(tmp_path / "out")]) == 0
    assert "depth unit" not in capsys.readouterr().err
    scale_depth(two, 3.0)
    assert main(["estimate", str(two), "--out", str(tmp_path / "out")]) == 0
    (asked,) = [line for line in capsys.readouterr().err.splitlines() if "depth unit" in line]
    assert re.fullmatch(
        r"is the depth unit right for a camera \d\.\d\d m above the floor and a median depth of \d+\.\d\d m\? "
        "16 bit must be millimetres, float metres",
        asked,
    ), "no word of TF, which there is none of here"


def test_the_first_frames_alone_are_estimated_where_that_is_asked(
    walk: Path, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(walk), "--out", str(tmp_path), "--limit", "2"]) == 0
    assert estimates_without_times(tmp_path) == estimates_without_times(result)[:2]
    assert main(["estimate", str(walk), "--out", str(tmp_path), "--limit", "0"]) == 2
    assert "argument --limit: '0' is given; it must be a whole number, 1 or more" in capsys.readouterr().err


def test_a_bound_that_is_not_computed_is_null(walk: Path, result: Path, tmp_path: Path) -> None:
    assert main(["estimate", str(walk), "--out", str(tmp_path), "--set", "joint_bound=false"]) == 0
    for line, proved in zip(lines_of(tmp_path), lines_of(result), strict=True):
        assert (line["lower_bound"], line["gap"]) == (None, None)
        assert line["energy"] == proved["energy"]
    assert images_of(tmp_path) == images_of(result), "proving changes nothing"


def test_two_processes_give_the_same_bytes(walk: Path, result: Path, tmp_path: Path) -> None:
    assert main(["estimate", str(walk), "--out", str(tmp_path), "--jobs", "2"]) == 0
    assert images_of(tmp_path) == images_of(result)
    assert estimates_without_times(tmp_path) == estimates_without_times(result)


def test_a_bag_gives_the_same_bytes_as_its_folder(walk: Path, result: Path, tmp_path: Path) -> None:
    copy_frames(open_source(walk), BagWriter(tmp_path / "bag"))
    assert main(["estimate", str(tmp_path / "bag"), "--out", str(tmp_path / "out")]) == 0
    assert images_of(tmp_path / "out") == images_of(result)
    assert estimates_without_times(tmp_path / "out") == estimates_without_times(result)


def test_a_run_in_which_no_frame_could_be_used_says_why_and_fails(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], rng: np.random.Generator
) -> None:
    folder, out = write_folder(tmp_path / "frames", make_samples(3, rng)), tmp_path / "out"
    for path in (folder / "depth").glob("*.png"):
        path.write_bytes(path.read_bytes()[:60])
    assert main(["estimate", str(folder), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "none of 3 frames could be used; the first is frame_000: " in error
    assert "frame_000.png" in error
    assert error.count("\n") == 1
    assert not out.exists(), "nothing was made for nothing"


def test_a_bad_frame_gets_a_line_with_its_error_and_the_run_goes_on(walk: Path, tmp_path: Path) -> None:
    shutil.copytree(walk, tmp_path / "frames")
    (tmp_path / "frames" / "depth" / "000001.png").write_bytes(b"\x89PNG broken")
    assert main(["estimate", str(tmp_path / "frames"), "--out", str(tmp_path / "out")]) == 0
    lines = lines_of(tmp_path / "out")
    assert [line["name"] for line in lines] == ["000000", "000001", "000002", "000003"]
    assert [line["status"] == "error" for line in lines] == [False, True, False, False]
    assert "000001.png" in lines[1]["error"]
    assert not (tmp_path / "out" / "layout" / "000001.png").exists()


def test_rgb_only_does_not_look_at_the_depth(walk: Path, tmp_path: Path) -> None:
    """Spoilt depth changes nothing."""
    assert main(["estimate", str(walk), "--out", str(tmp_path / "a"), "--rgb-only"]) == 0
    for sample in good_samples(open_source(walk)):
        assert sample.frame.depth_m is not None
    shutil.copytree(walk, tmp_path / "frames")
    flat = cv2.imencode(".png", np.full((480, 640), 1234, np.uint16))[1].tobytes()
    for path in (tmp_path / "frames" / "depth").iterdir():
        path.write_bytes(flat)
    assert main(["estimate", str(tmp_path / "frames"), "--out", str(tmp_path / "b"), "--rgb-only"]) == 0
    assert len(lines_of(tmp_path / "a")) == 4
    assert images_of(tmp_path / "a") == images_of(tmp_path / "b")


@pytest.fixture(scope="module", params=STORAGES)
def damaged(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of 40 small frames, damaged in the middle."""
    bag = tmp_path_factory.mktemp("damaged") / "bag"
    samples = make_samples(40, np.random.default_rng(3), CameraIntrinsics(160, 120, 131.0, 131.0, 79.5, 59.5))
    with BagWriter(bag, storage=request.param) as writer:
        for sample in samples:
            writer.write(sample)
    damage_middle(bag)
    return bag


def names_in(source: FrameSource) -> list[str]:
    part = ReadablePart(source)
    names = [item.name for item in part]
    assert part.damage is not None
    return names


@pytest.mark.parametrize("jobs", ("1", "2"))
def test_a_bag_damaged_midway_leaves_what_was_estimated(
    damaged: Path, jobs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    readable = names_in(open_source(damaged))
    assert 10 < len(readable) < 30
    assert main(["estimate", str(damaged), "--out", str(tmp_path), "--jobs", jobs]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "is damaged" in error
    assert f"{len(readable)} frames estimated before the damage" in error
    assert [line["name"] for line in lines_of(tmp_path)] == readable
    assert sorted(p.stem for p in (tmp_path / "layout").iterdir()) == readable


def test_recover_goes_on_behind_the_damage_and_states_the_loss(
    damaged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(damaged), "--out", str(tmp_path), "--recover"]) == 0
    error = capsys.readouterr().err
    assert re.search(r"is damaged .*: [1-9]\d* of its 240 messages are lost", error)
    names = [line["name"] for line in lines_of(tmp_path)]
    assert names == names_in(open_source(damaged, recover=True))
    assert names[-1] == "frame_273", "the last one lies behind the damage"
    assert len(names) > len(names_in(open_source(damaged)))


@pytest.mark.parametrize("command", ["estimate", "fit"])
def test_results_do_not_replace_the_truth_of_a_frames_folder(
    command: str, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, before = write_folder(tmp_path / "other", make_samples(1, np.random.default_rng(0))), files_of(walk)
    (tmp_path / "link").symlink_to(walk)
    assert main([command, str(walk), "--out", str(tmp_path / "link")]) == 2
    assert "link is the input; choose another folder" in capsys.readouterr().err
    assert files_of(walk) == before
    theirs = files_of(other)
    assert main([command, str(walk), "--out", str(other)]) == 2
    assert "other is a frames folder; choose another" in capsys.readouterr().err
    assert files_of(other) == theirs


@pytest.mark.parametrize("command", ["estimate", "fit"])
def test_a_folder_that_another_run_is_writing_into_is_refused(
    command: str, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with held_alone("--out", tmp_path / "out"):
        assert main([command, str(walk), "--out", str(tmp_path / "out")]) == 2
    assert "another run is writing into --out" in capsys.readouterr().err
    assert not list((tmp_path / "out").iterdir())
    assert main([command, str(walk), "--out", str(tmp_path / "out")]) == 0, "it was released"


def test_the_metadata_of_a_bag_is_told_from_the_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "metadata.yaml").touch()
    assert main(["estimate", str(tmp_path / "metadata.yaml"), "--out", str(tmp_path / "out")]) == 2
    assert f"metadata.yaml is the metadata of a rosbag2; give its folder, {tmp_path}\n" in capsys.readouterr().err


def test_a_link_to_nothing_is_no_folder(walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "disk").symlink_to(tmp_path / "gone")
    assert main(["estimate", str(walk), "--out", str(tmp_path / "disk")]) == 2
    assert "disk is a link to nothing; --out needs a folder" in capsys.readouterr().err


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_second_run_replaces_the_first_and_keeps_what_is_not_of_it(walk: Path, result: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(result, out)
    (out / "notes.txt").write_text("mine")
    assert main(["estimate", str(walk), "--out", str(out), "--limit", "1"]) == 0
    left = {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()}
    assert left == {"estimates.jsonl", "notes.txt", *(f"{kind}/000000.png" for kind in KINDS)}
    assert not (out / "overlay").exists()
    assert [line["name"] for line in lines_of(out)] == ["000000"]


@pytest.mark.parametrize("command", ["estimate", "fit"])
@pytest.mark.parametrize("why", ["no scheduler", "no usable frame"])
def test_an_earlier_run_stays_where_the_next_one_is_not_possible(
    command: str,
    why: str,
    walk: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, source, words = tmp_path / "out", walk, list[str]()
    assert main([command, str(walk), "--out", str(out), "--overlay"]) == 0
    before = files_of(out)
    if why == "no scheduler":
        pytest.importorskip("distributed", reason="distributed is not installed (extra train)")
        monkeypatch.setattr("room_layout_ros.parallel.CONNECT_TIMEOUT_S", 0.2)
        words, said = ["--scheduler", "tcp://127.0.0.1:9"], "no Dask scheduler answers at tcp://127.0.0.1:9"
    else:
        source, said = tmp_path / "frames", "none of 4 frames could be"
        shutil.copytree(walk, source)
        for path in (source / "depth").iterdir():
            path.write_bytes(b"\x89PNG broken")
    for folder in (out, tmp_path / "new" / "er"):
        assert main([command, str(source), "--out", str(folder), *words]) == 2
        assert said in capsys.readouterr().err
    assert files_of(out) == before
    assert not (tmp_path / "new").exists(), "nothing was made for nothing"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (None, "mine.png is of no frame of an earlier estimate; choose another folder by --out"),
        ('{"name": "../mine"}', "estimates.jsonl line 1 names no frame"),
        ('{"name": "mi', "estimates.jsonl line 1 names no frame"),
    ],
    ids=["another's image", "a path", "a cut line"],
)
def test_what_may_be_somebody_elses_is_refused_and_kept(
    lines: str | None, said: str, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "layout").mkdir()
    (tmp_path / "mine.png").write_text("mine")
    (tmp_path / "layout" / "mine.png").write_text("mine")
    if lines is not None:
        (tmp_path / "estimates.jsonl").write_text(lines)
    before = files_of(tmp_path)
    assert main(["estimate", str(walk), "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
    assert files_of(tmp_path) == before


def test_no_line_of_an_earlier_run_stays_beside_new_images(walk: Path, damaged: Path, tmp_path: Path) -> None:
    assert main(["estimate", str(walk), "--out", str(tmp_path)]) == 0
    assert main(["estimate", str(damaged), "--out", str(tmp_path)]) == 2
    assert [line["name"] for line in lines_of(tmp_path)] == names_in(open_source(damaged))


def test_a_line_comes_when_its_frame_is_done(walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that ends at its third frame, for whatever reason, leaves two lines and their images."""
    whole, frames = estimate_item, iter(range(4))

    def stop_at_third(job: FrameJob, item: Sample | BadFrame) -> FrameResult:
        if next(frames) == 2:
            raise KeyboardInterrupt
        return whole(job, item)

    monkeypatch.setattr(estimate_command, "estimate_item", stop_at_third)
    assert main(["estimate", str(walk), "--out", str(tmp_path)]) == 130
    assert [line["name"] for line in lines_of(tmp_path)] == ["000000", "000001"]
    assert sorted(p.stem for p in (tmp_path / "layout").iterdir()) == ["000000", "000001"]


def test_a_cut_bag_is_exit_code_2(walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy_frames(open_source(walk), BagWriter(tmp_path / "bag"))
    file = next((tmp_path / "bag").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:500_000])
    assert main(["estimate", str(tmp_path / "bag"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(tmp_path / "bag") in error
