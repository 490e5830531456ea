"""`room-layout view` shows what was estimated; every stage is a picture of the frame's size."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from room_layout_ros.cli import main as room_layout
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import Sample
from room_layout_ros.datasets.images import read_color
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter
from room_layout_ros.evaluation import pictures
from room_layout_ros.evaluation.stages import STAGES, Look, draw_stage, look_at
from room_layout_ros.evaluation.top_down import draw_top_down

NEEDS_RERUN = pytest.mark.skipif(
    importlib.util.find_spec("rerun") is None, reason="rerun-sdk is not installed (extra viz)"
)
VIEWS = [[], pytest.param(["--rrd", "OUT"], marks=NEEDS_RERUN)]
FURNITURE = pictures.furniture_legend()
CAMERA = CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def sample() -> Sample:
    first = next(iter(SyntheticSource(frames=1, seed=4)))
    assert isinstance(first, Sample)
    return first


@pytest.fixture(scope="module")
def folder(sample: Sample, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames") / "room"
    with FolderWriter(path) as writer:
        writer.write(sample)
    return path


NEEDS_DEPTH = {"depth", "cues", "planes", "support", "top-down"}


@pytest.mark.parametrize("with_depth", (True, False))
def test_every_stage_is_a_picture_of_the_frames_size(sample: Sample, with_depth: bool) -> None:
    frame = sample.frame if with_depth else sample.frame.without_depth()
    look = look_at(frame, LayoutEstimator())
    drawn = {name: draw_stage(name, look) for name in STAGES}
    assert {name for name, image in drawn.items() if image is None} == (set() if with_depth else NEEDS_DEPTH)
    for name, image in drawn.items():
        if image is not None:
            assert image.shape == (480, 640, 3), name
            assert image.dtype == np.uint8, name


def test_evidence_shown_is_the_estimators(sample: Sample) -> None:
    look = look_at(sample.frame, LayoutEstimator())
    assert look.seen is not None
    np.testing.assert_array_equal(look.seen.superpixels.index, look.estimate.superpixels)


def test_support_stage_tells_what_lies_on_a_face_beyond_and_before() -> None:
    room = RoomCuboid(np.eye(3), np.array([1.0, 1.0, 1.5, 3.0, 1.5]))
    depth = room.depth(CAMERA)
    depth[:40], depth[80:] = depth[:40] * 0.7, depth[80:] * 1.3
    look = Look(RgbdFrame(CAMERA, None, depth), room_estimate(room))
    image = draw_stage("support", look)
    assert image is not None
    rows = {tuple(image[y, x].tolist()) for y in (20, 60, 100) for x in (40, 120)}
    assert rows == {(150, 150, 150), (80, 200, 110), (235, 70, 60)}


def room_estimate(room: RoomCuboid) -> RoomEstimate:
    layout = room.raster(CAMERA)
    empty = np.zeros_like(layout)
    return RoomEstimate(
        Status.OK, layout, layout, empty, empty.astype(np.int32), np.eye(3), 1.0, 1.0, np.ones(5), room, ()
    )


def test_furniture_stage_names_the_colours_of_its_classes() -> None:
    classes = np.full((240, 320), 5, np.uint8)
    shown = pictures.draw_legend(pictures.paint_classes(np.zeros((240, 320, 3), np.uint8), classes), FURNITURE)
    assert [name for name, _ in FURNITURE] == ["toilet", "bed", "table", "cabinet", "sofa", "chair"]
    for _, color in FURNITURE:
        assert (shown == np.array(color, np.uint8)).all(axis=2).sum() >= 13 * 13


def test_labels_stage_shows_the_colour_of_each_label() -> None:
    labels = np.repeat(np.arange(7, dtype=np.uint8), 10)[None].repeat(8, axis=0)
    image = np.full((*labels.shape, 3), 200, np.uint8)
    painted = pictures.paint_labels(image, labels, opacity=1.0)
    np.testing.assert_array_equal(painted[:, 10:], LABEL_COLORS[labels][:, 10:])
    assert painted[:, :10].max() < 100  # unknown is dark


def test_outlines_lie_on_the_borders_of_the_layout_alone() -> None:
    layout = np.full((50, 60), 4, np.uint8)
    layout[30:] = 2
    drawn = pictures.draw_outlines(np.zeros((50, 60, 3), np.uint8), layout, (9, 9, 9), 1)
    assert set(np.nonzero(drawn.any(axis=(1, 2)))[0].tolist()) == {29, 30}


def test_missing_depth_is_black_and_near_is_red() -> None:
    depth = np.linspace(1, 5, 100, dtype=np.float32)[None].repeat(4, axis=0)
    depth[:, :5] = np.nan
    painted = pictures.paint_depth(depth).astype(int)
    assert not painted[:, :5].any()
    assert (painted[:, 8, 0] > painted[:, 8, 2]).all()
    assert (painted[:, 90, 2] > painted[:, 90, 0]).all()


def test_top_down_draws_the_walls_where_they_are() -> None:
    room = RoomCuboid(np.eye(3), np.array([1.0, 1.0, 1.5, 3.0, 1.5]))
    frame, estimate = RgbdFrame(CAMERA, None, room.depth(CAMERA)), room_estimate(room)
    plan = draw_top_down(frame, estimate, (320, 240))
    walls = (plan == (40, 46, 56)).all(axis=2)
    columns, rows = np.nonzero(walls.sum(axis=0) > 60)[0], np.nonzero(walls.sum(axis=1) > 60)[0]
    scale = (columns.max() - columns.min() - 2) / 3.0  # the side walls are 3 m apart, lines 3 px wide
    assert len(rows) >= 1
    camera = np.nonzero((plan == (20, 90, 220)).all(axis=2))
    assert camera[0].max() - rows.mean() == pytest.approx(3.0 * scale, abs=12)


def test_view_writes_all_stages_and_one_stage(folder: Path, tmp_path: Path) -> None:
    assert room_layout(["view", str(folder), "--out", str(tmp_path / "all.png")]) == 0
    assert room_layout(["view", str(folder), "--stage", "layout", "--out", str(tmp_path / "new" / "one.png")]) == 0
    assert read_color(tmp_path / "new" / "one.png").shape == (480, 640, 3)
    sheet = read_color(tmp_path / "all.png")
    assert sheet.shape[0] > 3 * 360
    assert cv2.Laplacian(sheet, cv2.CV_64F).var() > 100  # pictures, not blank paper


@NEEDS_RERUN
def test_view_writes_a_recording_for_rerun(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "room.rrd"
    assert room_layout(["view", str(folder), "--rrd", str(path)]) == 0
    content = path.read_bytes()
    assert content[:3] == b"RRF"
    for entity in (b"room/camera/color", b"room/points", b"room/faces", b"confidence/front_wall"):
        assert entity in content


@pytest.mark.parametrize("to", VIEWS)
@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (0.0, "the frame has no usable depth: estimated from colour alone, lengths have no unit; 16 bit must be"),
        (2.5, "is the depth unit right for a camera "),
        (1.0, ""),
    ],
)
def test_depth_that_is_of_no_use_or_of_another_unit_is_told(
    sample: Sample, tmp_path: Path, capsys: pytest.CaptureFixture[str], to: list[str], factor: float, said: str
) -> None:
    assert sample.frame.depth_m is not None
    with FolderWriter(tmp_path / "frames") as writer:
        writer.write(Sample(replace(sample.frame, depth_m=sample.frame.depth_m * np.float32(factor))))
    out = [word.replace("OUT", str(tmp_path / "x.rrd")) for word in to] or ["--out", str(tmp_path / "x.png")]
    assert room_layout(["view", str(tmp_path / "frames"), *out]) == 0
    (told,) = capsys.readouterr().err.splitlines() or ("",)
    assert told.startswith(said)
    assert bool(told) == bool(said)


@NEEDS_RERUN
@pytest.mark.parametrize("display", ["", ":77"])
def test_where_no_viewer_can_be_opened_one_sentence_says_what_can_be_done(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, display: str
) -> None:
    import rerun

    def spawn(self: object) -> None:
        if not display:
            raise AssertionError("the viewer logs for 20 s and dies")
        raise RuntimeError("the transport has gone")

    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(rerun.RecordingStream, "spawn", spawn)
    assert room_layout(["view", str(folder), "--interactive"]) == 2
    said = capsys.readouterr().err
    assert "the viewer cannot be opened here; write a file with --rrd FILE" in said
    assert len(said.strip().splitlines()) == 1


@pytest.fixture
def two(sample: Sample, tmp_path: Path) -> Path:
    """Two frames of depth alone."""
    path = tmp_path / "two"
    with FolderWriter(path) as writer:
        for name in ("000000", "000001"):
            writer.write(Sample(replace(sample.frame, color=None, name=name)))
    return path


@NEEDS_RERUN
def test_the_viewer_gets_the_named_frame_whatever_the_limit(two: Path, tmp_path: Path) -> None:
    path = tmp_path / "one.rrd"
    assert room_layout(["view", str(two), "--frame", "000001", "--limit", "1", "--rrd", str(path)]) == 0
    assert path.stat().st_size > 0


@pytest.mark.parametrize("to", VIEWS)
@pytest.mark.parametrize(
    ("arguments", "words"),
    (
        (["--rgb-only"], "frame 000000 has no colour, and --rgb-only leaves the depth unused"),
        (["--frame", "000009"], "two has no frame '000009'; it has 2, 000000 to 000001"),
    ),
)
def test_picture_and_viewer_refuse_alike(
    two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str, to: list[str]
) -> None:
    out = [word.replace("OUT", str(tmp_path / "x.rrd")) for word in to]
    assert room_layout(["view", str(two), *arguments, *out]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "x.rrd").exists()


def test_a_bag_says_which_frames_it_has(two: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed (extra playback)")
    (two / "stamps.txt").write_text("000000 1\n000001 2\n")
    assert room_layout(["convert", str(two), str(tmp_path / "bag"), "--to", "bag"]) == 0
    for name, said in (("59", "it has 2, 000000 to 000001"), ("1", "did you mean '000001'?")):
        assert room_layout(["view", str(tmp_path / "bag"), "--frame", name]) == 2
        assert f"bag has no frame '{name}'; {said}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    (
        (["--frame", "nope"], "room has no frame 'nope'; its only frame is 000000"),
        (["--out", "picture.txt"], ".png or .jpg"),
        (["--out", __file__ + "/picture.png"], "test_view.py is a file; --out needs a folder"),
        (["--rrd", "x.rrd", "--limit", "0"], "1 or more"),
        (["--rrd", "x.rrd", "--interactive"], "--interactive and --rrd exclude each other"),
        (["--rrd", "x.rrd", "--out", "x.png"], "--out is of a picture, and --rrd shows all stages"),
        (["--interactive", "--stage", "layout"], "--stage is of a picture, and --interactive shows all stages"),
    ),
)
def test_bad_arguments_are_one_sentence_and_exit_code_2(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert room_layout(["view", str(folder), *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
