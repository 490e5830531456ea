"""`room-layout evaluate`, the baselines, and the report: numbers agree with truth made by hand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from room_layout_ros.cli import main as room_layout
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import FrameTruth, Sample, open_folder
from room_layout_ros.datasets.images import write_image
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter
from room_layout_ros.evaluation import baselines, tables
from room_layout_ros.evaluation.calibration import face_reliability, frame_reliability
from room_layout_ros.evaluation.prediction import Prediction
from room_layout_ros.evaluation.scores import SetScore, run

CAMERA = CameraIntrinsics(640, 480, 520.0, 520.0, 319.5, 239.5)
ROOM = RoomCuboid(np.eye(3), np.array([1.3, 1.2, 1.5, 3.0, 1.4]))
N_FRAMES = 3


def room_sample(name: str = "a", seed: int = 0) -> Sample:
    """The analytic room, every pixel measured with 5 mm of noise, all of it wall (1), floor (2), ceiling (22)."""
    layout = ROOM.raster(CAMERA)
    depth = ROOM.depth(CAMERA) + np.random.default_rng(seed).normal(0, 0.005, layout.shape).astype(np.float32)
    classes = np.array([0, 22, 2, 1, 1, 1], np.uint8)[layout]
    return Sample(RgbdFrame(CAMERA, None, depth.astype(np.float32), name=name), FrameTruth(layout, classes))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames") / "rooms"
    with FolderWriter(path) as writer:
        for sample in SyntheticSource(frames=N_FRAMES, seed=3, walk=False, noise="clean"):
            assert isinstance(sample, Sample)
            writer.write(sample)
    names = open_folder(path).names
    (path / "splits.json").write_text(json.dumps({"first_two": list(names[:2])}))
    return path


def test_percentile_walls_find_an_empty_room() -> None:
    result = run("p", baselines.percentile_walls, [room_sample()])
    assert result.layout_errors[0] < 0.03
    assert result.labelling_errors[0] < 0.03


def test_constant_layout_never_looks_at_the_frame_it_answers() -> None:
    other = np.full(ROOM.raster(CAMERA).shape, 2, np.uint8)
    samples = [room_sample("a"), Sample(room_sample("b").frame, FrameTruth(other))]
    layouts = {s.name: s.truth.layout for s in samples if s.truth is not None and s.truth.layout is not None}
    method = baselines.ConstantLayout.of(layouts)
    np.testing.assert_array_equal(method(samples[0]).layout, other)
    np.testing.assert_array_equal(method(samples[1]).layout, ROOM.raster(CAMERA))


def test_a_frame_without_an_estimate_is_wrong_in_every_pixel_and_counted() -> None:
    result = run("nothing", lambda s: Prediction.nothing(s.frame.camera, "no room in view"), [room_sample()])
    assert (result.layout_errors[0], result.labelling_errors[0], result.without_estimate) == (1.0, 1.0, 1)


def test_perfect_and_confident_predictions_are_calibrated_and_wrong_ones_are_not() -> None:
    layout = ROOM.raster(CAMERA)
    sure = np.ones(5)

    def perfect(_: Sample) -> Prediction:
        return Prediction(layout, layout, confidence=1.0, face_confidence=sure)

    def wrong(_: Sample) -> Prediction:
        # floor and ceiling swapped: no renaming of walls mends it
        swapped = np.array([0, 2, 1, 3, 4, 5], np.uint8)[layout]
        return Prediction(swapped, swapped, confidence=1.0, face_confidence=np.array([1.0, 1.0, 0, 0, 0]))

    right, bad = run("right", perfect, [room_sample()]), run("wrong", wrong, [room_sample()])
    for score, frames, faces in ((right, 0.0, 0.0), (bad, np.isin(layout, (1, 2)).mean(), 1.0)):
        of_frames, of_faces = frame_reliability(score), face_reliability(score)
        assert of_frames is not None
        assert of_faces is not None
        assert of_frames.ece == pytest.approx(frames)
        assert of_faces.ece == pytest.approx(faces)


def test_table_and_summary_state_the_same_means() -> None:
    scores: list[SetScore] = [run("walls", baselines.percentile_walls, [room_sample("a"), room_sample("b", 1)])]
    summary = json.loads(tables.summary_json(scores))["methods"]["walls"]
    shown = re.search(r"walls\s+([\d.]+) \(", tables.text_table(scores))
    assert shown is not None
    assert float(shown[1]) == pytest.approx(100 * summary["layout_error"], abs=0.006)
    assert summary["layout_error"] == pytest.approx(float(np.mean(scores[0].layout_errors)), abs=1e-6)


def test_evaluate_writes_numbers_and_a_page_with_every_frame(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert room_layout(["evaluate", str(folder), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "paper, RGB-D" in printed
    assert "ours, RGB-D" in printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["methods"]["ours, RGB-D"]["frames"] == N_FRAMES
    assert summary["methods"]["ours, RGB-D"]["layout_error"] < 0.1  # noise-free rooms
    page = (tmp_path / "out" / "report.html").read_text()
    names = open_folder(folder).names
    assert all(f"<b>{name}</b>" in page for name in names)
    assert page.count("data:image/jpeg;base64,") == N_FRAMES
    assert not re.search(r"(src|href)='(?!data:)", page)  # everything is inside
    rows = (tmp_path / "out" / "frames.csv").read_text().splitlines()
    assert len(rows) == 1 + N_FRAMES * len(summary["methods"])


def test_true_layouts_given_as_estimates_score_zero(folder: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth"
    for sample in open_folder(folder):
        assert isinstance(sample, Sample)
        assert sample.truth is not None
        assert sample.truth.layout is not None
        assert sample.truth.labels is not None
        for kind, image in (("layout", sample.truth.layout), ("labels", sample.truth.labels)):
            (truth / kind).mkdir(parents=True, exist_ok=True)
            write_image(truth / kind / f"{sample.name}.png", image)
    out = tmp_path / "out"
    arguments = ["evaluate", str(folder), "--estimates", str(truth), "--baseline", "none", "--no-report"]
    assert room_layout([*arguments, "--out", str(out)]) == 0
    (scores,) = json.loads((out / "summary.json").read_text())["methods"].values()
    assert (scores["layout_error"], scores["labelling_error"], scores["mean_iou"]) == (0, 0, 1)


def test_a_subset_of_splits_json_is_what_is_scored(folder: Path, tmp_path: Path) -> None:
    arguments = ["evaluate", str(folder), "--frames", "first_two", "--baseline", "percentile", "--no-report"]
    assert room_layout([*arguments, "--rgb-only", "--out", str(tmp_path)]) == 0
    methods = json.loads((tmp_path / "summary.json").read_text())["methods"]
    assert set(methods) == {"ours, RGB", "walls at the 98th percentile"}
    assert {scores["frames"] for scores in methods.values()} == {2}


@pytest.mark.parametrize(
    ("arguments", "words"),
    (
        (["{folder}", "--frames", "nonsense"], "first_two"),
        (["{folder}/missing"], "does not exist"),
        (["{folder}", "--estimates", "{folder}/rgb"], "no layout/"),
        (["{folder}", "--curve", "{folder}/camera.yaml", "--frames", "first_two", "--out", "{tmp}"], "no curve"),
        (["{folder}", "--set", "superpixel_count=many"], "no int"),
    ),
)
def test_bad_input_ends_in_one_sentence_and_exit_code_2(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    filled = [word.format(folder=folder, tmp=tmp_path) for word in arguments]
    assert room_layout(["evaluate", *filled]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
