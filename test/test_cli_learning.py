"""`room-layout fit` and `train` from a folder of frames to model files: the same bytes, wherever they run."""

from __future__ import annotations

import csv
import errno
import json
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sklearn", reason="scikit-learn is in the extra train")
pytest.importorskip("joblib", reason="joblib is in the extra train")

from frames_on_disk import write_folder

from room_layout_ros.cli import main as room_layout
from room_layout_ros.commands import train as train_command
from room_layout_ros.commands.output_folder import held_alone
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.evidence.geometric_context import load_context
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.furniture import load_furniture
from room_layout_ros.core.models import config_folder
from room_layout_ros.core.weights import BLOCKS, PAPER_BLOCKS, load_weights, start_weights
from room_layout_ros.datasets import FramesFolder, Sample, good_samples, open_folder
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation.c_curve import C_CURVE_FILE, read_c_curve
from room_layout_ros.evaluation.measures import score_pixels
from room_layout_ros.learning.fit_frame import read_fits
from room_layout_ros.learning.forest_export import BINS

CAMERA = CameraIntrinsics(240, 180, 140.0, 140.0, 119.5, 89.5)
"""Wide: most frames show four or five faces, so that every fold has all of them."""
TRAIN = ("--frames", "8", "--rounds", "2", "--validate", "2", "--folds", "2", "--trees", "6", "--synthetic", "2")
MODELS = ("context_rgbd_plain.npz", "furniture_rgbd_plain.npz", "joint_rgbd_plain.npz")


@pytest.fixture(scope="module", autouse=True)
def _fixed_origin() -> Iterator[None]:
    """Cards name the command of the process and the day; both are given here, so that files can be compared."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["room-layout", "train", "my frames"])
        patch.setenv("SOURCE_DATE_EPOCH", "1386201600")
        for forest in BINS:
            patch.setitem(BINS, forest, 8)  # quick
        yield


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> FramesFolder:
    """Ten small rooms, numbered so that no two are neighbours."""
    source = SyntheticSource(frames=10, seed=5, noise="kinect", walk=False, camera=CAMERA)
    return open_folder(write_folder(tmp_path_factory.mktemp("frames") / "rooms", list(numbered(good_samples(source)))))


def numbered(samples: Iterator[Sample]) -> Iterator[Sample]:
    for i, sample in enumerate(samples, 1):
        yield replace(sample, frame=replace(sample.frame, name=f"{10 * i:04d}"))


@pytest.fixture(scope="module")
def fits(frames: FramesFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fits")
    assert room_layout(["fit", str(frames.path), "--out", str(out)]) == 0
    return out


def train(frames: FramesFolder, fits: Path, out: Path, *more: str) -> int:
    return room_layout(["train", str(frames.path), "--fits", str(fits), "--out", str(out), *TRAIN, *more])


@pytest.fixture(scope="module")
def trained(frames: FramesFolder, fits: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("models")
    assert train(frames, fits, out) == 0
    return out


def bytes_of(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in MODELS}


def test_fits_are_near_the_rooms_that_were_rendered(frames: FramesFolder, fits: Path) -> None:
    rooms = read_fits(fits)
    assert len(rooms) >= 9
    lines = [json.loads(line) for line in (fits / "fits.jsonl").read_text().splitlines()]
    assert [line["name"] for line in lines] == list(frames.names)
    errors = []
    for name, room in rooms.items():
        sample = frames.read(name)
        assert sample.truth is not None
        assert sample.truth.layout is not None
        errors.append(score_pixels(sample.truth.layout, room.raster(CAMERA)).layout_error)
        assert (fits / "layout" / f"{name}.png").is_file()
    assert np.median(errors) < 0.03


def test_a_second_fit_replaces_the_first_and_nothing_else(
    frames: FramesFolder, fits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, few = tmp_path / "out", tmp_path / "few"
    shutil.copytree(fits, out)
    write_folder(few, [frames.read(name) for name in frames.names[:2]])
    assert room_layout(["fit", str(few), "--out", str(out)]) == 0
    assert [json.loads(line)["name"] for line in (out / "fits.jsonl").read_text().splitlines()] == ["0010", "0020"]
    assert {path.stem for path in out.glob("*/*.png")} == {"0010", "0020"}
    (out / "layout" / "mine.png").write_text("mine")
    assert room_layout(["fit", str(few), "--out", str(out)]) == 2
    assert "mine.png is of no frame of an earlier fit; choose another folder" in capsys.readouterr().err
    assert (out / "layout" / "mine.png").read_text() == "mine"


def test_a_fit_of_no_frame_says_why_and_fails(
    frames: FramesFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_folder(tmp_path / "few", [frames.read(name) for name in frames.names[:2]])
    for path in (tmp_path / "few" / "labels40").iterdir():
        path.rename(path.with_suffix(".PNG"))
    assert room_layout(["fit", str(tmp_path / "few"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "2 files in" in said, "what is not read is told"
    assert "none of 2 frames could be fitted; the first is 0010: it has no class labels (labels40/NAME.png)" in said


def no_room(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_told_with_the_folder_of_the_training(
    frames: FramesFolder, fits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, lost = tmp_path / "out", tmp_path / "lost"
    for describe, said in (
        (no_room, f"room-layout: {out} cannot be written: No space left on device"),
        (lambda *_: lost.read_bytes(), f"room-layout: {lost}: No such file or directory"),
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(train_command, "describe_frames", describe)
            assert train(frames, fits, out) == 2
        assert capsys.readouterr().err.splitlines()[-1] == said


def test_a_training_into_a_folder_where_another_one_writes_is_refused(
    frames: FramesFolder, fits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each removes examples that are not its own."""
    with held_alone("--out", tmp_path):
        assert train(frames, fits, tmp_path) == 2
    assert "another run is writing into --out" in capsys.readouterr().err


@pytest.mark.parametrize("folds", ("1", "-1", "two"))
def test_validation_in_one_fold_is_refused_by_the_name_of_the_option(
    folds: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All frames would be judged, and none learned from; told before minutes of fitting."""
    words = ["train", str(tmp_path), "--out", str(tmp_path / "out"), "--validate", folds]
    assert room_layout(words) == 2
    said = capsys.readouterr().err.strip()
    assert f"argument --validate: '{folds}' is given; it must be " in said
    assert len(said.splitlines()) == 1


def test_too_few_frames_for_the_folds_are_said_in_a_sentence(
    frames: FramesFolder, fits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_folder(tmp_path / "few", list(named_by_words(frames)))
    fitted = (json.loads(line) for line in (fits / "fits.jsonl").read_text().splitlines())
    (tmp_path / "fits").mkdir()
    lines = (json.dumps({**line, "name": f"hall {line['name']}"}) for line in fitted)
    (tmp_path / "fits" / "fits.jsonl").write_text("\n".join(lines))
    assert train(open_folder(tmp_path / "few"), tmp_path / "fits", tmp_path / "out") == 2
    assert "none is left to learn from beside a fold and its neighbours (5 numbers" in capsys.readouterr().err


def named_by_words(frames: FramesFolder) -> Iterator[Sample]:
    for sample in good_samples(frames):
        yield replace(sample, frame=replace(sample.frame, name=f"hall {sample.name}"))


def test_the_models_are_learned_and_say_where_they_come_from(trained: Path, frames: FramesFolder) -> None:
    joint = load_weights(trained / MODELS[2])
    start = start_weights().variant("full").variant("no_scene")
    assert np.abs(joint.vector - start.vector).max() > 1e-3
    for card in (joint.card, load_context(trained / MODELS[0]).card, load_furniture(trained / MODELS[1]).card):
        assert card["date"] == "2013-12-05"
        assert card["command"] == "room-layout train 'my frames'"
    assert load_context(trained / MODELS[0]).card["frames"] == 8, "--frames is for the forests too"
    assert joint.card["data"] == "rooms"
    assert joint.card["rounds"] == 2
    assert joint.card["context"]["trees"] == 6
    folds = joint.card["cross_validation"]
    assert len(folds) == 2
    assert sum(fold["frames"] for fold in folds) == joint.card["frames"] >= 6
    for fold in folds:
        assert 0 <= fold["layout"] < 40
        assert 0 <= fold["labelling"] < 60
        assert 20 < fold["mean_iou"] <= 100
    rows = json.loads((trained / "training_rgbd_plain.json").read_text())["history"]
    assert [row["round"] for row in rows] == [1, 2]


def test_the_usual_variant_and_start_are_those_without_options(
    trained: Path, frames: FramesFolder, fits: Path, tmp_path: Path
) -> None:
    assert train(frames, fits, tmp_path, "--variant", "full", "--start", "hand") == 0
    assert bytes_of(tmp_path) == bytes_of(trained)
    assert not {"variant", "start"} & set(load_weights(trained / MODELS[2]).card)


def test_the_papers_model_is_learned_as_the_paper_has_it(
    trained: Path, frames: FramesFolder, fits: Path, tmp_path: Path
) -> None:
    """Only its own blocks, and around 0: no weight is there that was set by hand."""
    assert train(frames, fits, tmp_path, "--variant", "paper", "--start", "zero", "--validate", "0") == 0
    joint, usual = load_weights(tmp_path / MODELS[2]), load_weights(trained / MODELS[2])
    for block in BLOCKS:
        assert joint.block(block).any() == (block in PAPER_BLOCKS), block
    assert (joint.card["variant"], joint.card["start"]) == ("paper", "zero")
    hand = start_weights().variant("paper").vector
    untouched = (hand != 0) & (usual.variant("paper").vector == hand)
    assert untouched.any(), "weights that the frames do not speak about stay at the centre"
    assert (joint.vector[untouched] == 0).any(), "here the centre is 0"
    assert not (joint.vector[hand != 0] == hand[hand != 0]).any(), "and no weight is one that was set by hand"


def test_a_variant_that_asks_no_network_is_not_learned_with_one(
    frames: FramesFolder, fits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train(frames, fits, tmp_path / "out", "--variant", "paper", "--scene", "nets") == 2
    said = capsys.readouterr().err
    assert said == "room-layout: --variant paper asks no network, and --scene nets is given; drop one\n"
    assert not (tmp_path / "out").exists()


def test_the_estimator_works_with_them(trained: Path, frames: FramesFolder) -> None:
    shipped = config_folder()
    for name in {path.name for path in shipped.glob("*_plain.npz")} - set(MODELS):
        (trained / name).write_bytes((shipped / name).read_bytes())
    estimator = LayoutEstimator(EstimatorConfig(scene_network=False), trained)
    estimate = estimator.estimate(frames.read("0030").frame)
    assert estimate.status.name == "OK"
    assert estimator.models[True, False].joint.card["data"] == "rooms"


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes with nannies, as on two machines."""
    distributed = pytest.importorskip("distributed", reason="Dask is in the extra train")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1", silence_logs=60
    ) as cluster:
        yield cluster


def kill_when(cluster: Any, begun: Callable[[], bool], killed: list[int]) -> None:
    """Kill one worker process as soon as the work has begun."""
    deadline = time.monotonic() + 300
    while not begun():
        if time.monotonic() > deadline:
            return
        time.sleep(0.01)
    process = next(iter(cluster.workers.values())).process
    killed.append(process.pid)
    os.kill(process.pid, signal.SIGKILL)


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_cluster_of_which_a_worker_dies_gives_the_same_bytes(
    trained: Path, frames: FramesFolder, fits: Path, tmp_path: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second run of the same training too: with relative paths, which mean nothing to the workers."""
    killed: list[int] = []
    examples = tmp_path / "work" / "examples"
    hunter = threading.Thread(target=kill_when, args=(cluster, lambda: any(examples.glob("*.joblib")), killed))
    hunter.start()
    monkeypatch.chdir(tmp_path)
    folder = open_folder(Path(os.path.relpath(frames.path)))
    assert train(folder, fits, Path(), "--scheduler", cluster.scheduler_address) == 0
    hunter.join()
    assert len(killed) == 1
    assert bytes_of(tmp_path) == bytes_of(trained)


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_fits_and_scores_from_a_cluster_are_the_same(
    frames: FramesFolder, fits: Path, tmp_path: Path, cluster: Any
) -> None:
    where = ("--scheduler", cluster.scheduler_address)
    assert room_layout(["fit", str(frames.path), "--out", str(tmp_path / "fits"), *where]) == 0
    assert files_of(tmp_path / "fits") == files_of(fits)
    score = ["evaluate", str(frames.path), "--frames", "0010,0050", "--rgb-only", "--no-report", "--baseline", "none"]
    assert room_layout([*score, "--out", str(tmp_path / "alone")]) == 0
    assert room_layout([*score, "--out", str(tmp_path / "spread"), *where]) == 0
    assert scores_of(tmp_path / "spread") == scores_of(tmp_path / "alone")


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def scores_of(folder: Path) -> list[list[str]]:
    rows = list(csv.reader((folder / "frames.csv").read_text().splitlines()))
    assert rows[0][-1] == "milliseconds"
    assert len(rows) == 3
    return [row[:-1] for row in rows]


def test_the_curve_over_c_is_measured_on_the_half_not_learned_from(
    frames: FramesFolder, fits: Path, tmp_path: Path
) -> None:
    assert train(frames, fits, tmp_path, "--c-curve", "100,1") == 0
    curve = read_c_curve(tmp_path / C_CURVE_FILE)
    assert [point.C for point in curve.rgbd] == [1.0, 100.0]
    for point in curve.rgbd:
        assert 0 <= point.layout < 40
        assert 0 <= point.labelling < 60
        assert 20 < point.mean_iou <= 100
        assert point.gap is not None
        assert point.objective is not None
        assert 0 <= point.gap <= point.objective
    assert not curve.rgb
    ((kind, about),) = curve.about
    assert kind == "rgbd"
    assert "my frames" in about
    assert "2013-12-05" in about
    assert not list(tmp_path.glob("*.npz"))


@pytest.mark.parametrize("values", ["", "0,1", "1,-2", "1,x", "nan", "inf"])
def test_a_curve_over_no_numbers_is_refused(
    values: str, frames: FramesFolder, fits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert train(frames, fits, tmp_path, f"--c-curve={values}") == 2
    assert "no list of numbers above 0" in capsys.readouterr().err
