"""`room-layout calibrate`: from frames and layouts to a file of coefficients; refuses what it cannot use."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from room_layout_ros.cli import main as room_layout
from room_layout_ros.commands import calibrate as calibrate_command
from room_layout_ros.core.confidence import FACE_SIGNS, FRAME_SIGNS, Signs, load_confidence
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.models import config_folder, model_file
from room_layout_ros.core.weights import N_FEATURES, ModelWeights, save_weights
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.images import write_image
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter
from room_layout_ros.evaluation.confidence_fit import JudgedSigns, fit_confidence
from room_layout_ros.learning.scene_folds import SceneFolds

COUNT = 36
CAMERA = CameraIntrinsics(212, 160, 174.0, 174.0, 105.5, 79.5)


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A frames folder of small synthetic rooms with their true layouts."""
    path = tmp_path_factory.mktemp("rooms") / "frames"
    with FolderWriter(path) as writer:
        for sample in good_samples(SyntheticSource(frames=COUNT, seed=5, walk=False, camera=CAMERA)):
            writer.write(sample)
    return path


def calibrate(rooms: Path, out: Path, *more: str) -> int:
    return room_layout(["calibrate", str(rooms), "--fits", str(rooms), "--out", str(out), *more])


@pytest.mark.parametrize("more", ((), ("--rgb-only",)))
def test_coefficients_are_written_with_their_origin(rooms: Path, tmp_path: Path, more: tuple[str, ...]) -> None:
    assert calibrate(rooms, tmp_path / "new" / "out", "--plain", *more) == 0
    model = load_confidence(tmp_path / "new" / "out" / model_file("confidence", not more, with_scene=False))
    assert np.isfinite(model.frame).all()
    assert np.isfinite(model.face).all()
    assert model.frame[:-1].any()
    assert 30 <= model.card["frames"] <= COUNT
    assert model.card["source"] == f"frames folder {rooms.name}"


def test_too_few_frames_are_refused(rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate(rooms, tmp_path, "--frames", "20") == 2
    assert "layouts for 20 frames; at least 30 are needed" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_ends_it_before_anything_is_estimated(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrate_command, "map_ordered", lambda *_: pytest.fail("estimated"))
    (tmp_path / "file").touch()
    assert calibrate(rooms, tmp_path / "file") == 2
    assert "file is a file; --out needs a folder" in capsys.readouterr().err


def test_a_full_disk_is_told_with_the_folder(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(calibrate_command, "map_ordered", lambda *_: [])
    monkeypatch.setattr(calibrate_command, "fit_confidence", lambda *_: None)
    monkeypatch.setattr(calibrate_command, "save_confidence", no_room)
    assert calibrate(rooms, tmp_path / "out", "--plain") == 2
    assert capsys.readouterr().err == f"room-layout: {tmp_path / 'out'} cannot be written: No space left on device\n"


def test_frames_that_cannot_be_used_are_counted(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    shutil.copytree(rooms, other)
    (other / "depth" / "000004.png").unlink()
    assert calibrate(other, tmp_path / "out", "--plain") == 0
    assert "1 of 36 frames could not be used" in capsys.readouterr().err


def copied(rooms: Path, other: Path, unannotated: int) -> Path:
    shutil.copytree(rooms, other)
    for i in range(unannotated):
        write_image(other / "layout" / f"{i:06d}.png", np.zeros((160, 212), np.uint8))
    return other


def test_frames_without_an_annotated_pixel_are_left_out_and_counted(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(copied(rooms, tmp_path / "other", 2), tmp_path / "out", "--plain") == 0
    assert "2 of 36 frames have no true layout and are left out" in capsys.readouterr().err
    model = load_confidence(tmp_path / "out" / "confidence_rgbd_plain.npz")  # refuses values that are not finite
    assert model.card["frames"] <= COUNT - 2


def test_too_few_annotated_frames_are_refused_before_anything_is_estimated(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LayoutEstimator, "estimate", None)
    assert calibrate(copied(rooms, tmp_path / "other", 7), tmp_path / "out", "--plain") == 2
    assert "layouts for 29 frames; at least 30 are needed" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_frame_of_which_nothing_is_known_is_no_frame_to_fit_confidences_to() -> None:
    none = Signs(np.zeros(len(FRAME_SIGNS)), np.zeros((5, len(FACE_SIGNS) - 1)))
    known = JudgedSigns(none, 0.9, np.ones(5, bool), np.full(5, 0.8))
    with pytest.raises(ValueError, match="1 of 31 layouts have no annotated pixel"):
        fit_confidence([*[known] * 30, replace(known, right=float("nan"))], {})


def models_with_no_weights(tmp_path: Path, name: str) -> Path:
    """A folder of the models that ship, the weights of one file all 0."""
    folder = tmp_path / "models"
    folder.mkdir()
    for path in config_folder().glob("*.npz"):
        (folder / path.name).symlink_to(path.resolve())
    (folder / name).unlink()
    save_weights(ModelWeights(np.zeros(N_FEATURES)), folder / name)
    return folder


def test_the_models_named_are_those_that_are_calibrated(rooms: Path, tmp_path: Path) -> None:
    """Weights of 0 know no room: what came true of their estimates is less."""
    folder = models_with_no_weights(tmp_path, "joint_rgbd_plain.npz")
    assert calibrate(rooms, tmp_path / "shipped", "--plain") == 0
    assert calibrate(rooms, tmp_path / "own", "--plain", "--models", str(folder)) == 0
    shipped, own = (load_confidence(tmp_path / out / "confidence_rgbd_plain.npz") for out in ("shipped", "own"))
    assert not np.allclose(shipped.frame, own.frame, atol=1e-3)


def test_a_folder_of_models_that_lacks_one_is_refused_before_anything_is_estimated(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LayoutEstimator, "estimate", None)
    assert calibrate(rooms, tmp_path / "out", "--models", str(tmp_path)) == 2
    assert "cannot be read: No such file or directory; --models needs a copy of" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_frames_held_out_are_never_used(rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert calibrate(rooms, tmp_path, "--hold-out", "000003,000015,000024,000033") == 2
    assert "at least 30 are needed" in capsys.readouterr().err


def test_with_and_without_the_network_at_once_is_refused(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(rooms, tmp_path, "--plain", "--scene", str(tmp_path)) == 2
    assert "--plain exclude each other" in capsys.readouterr().err


def test_a_source_that_is_no_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert room_layout(["calibrate", str(tmp_path / "absent"), "--fits", str(tmp_path), "--out", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert "absent does not exist" in message
    assert "Traceback" not in message


@pytest.mark.parametrize("damage", ["cut", "another size", "another id"])
def test_a_layout_that_is_none_is_named_before_anything_is_estimated(
    rooms: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    shutil.copytree(rooms / "layout", tmp_path / "fits" / "layout")
    file = tmp_path / "fits" / "layout" / "000000.png"
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-20])
    else:
        size, face = ((4, 4), 1) if damage == "another size" else ((160, 212), 9)
        write_image(file, np.full(size, face, np.uint8))
    monkeypatch.setattr(LayoutEstimator, "estimate", None)
    assert room_layout(["calibrate", str(rooms), "--fits", str(tmp_path / "fits"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert str(file) in said
    assert len(said.strip().splitlines()) == 1


def test_each_frame_is_looked_at_by_its_honest_network_and_the_estimator_stays_as_it_is(tmp_path: Path) -> None:
    asked: list[str] = []

    class Folds(SceneFolds):
        def look(self, frame: RgbdFrame) -> None:
            asked.append(frame.name)

    estimator = calibrate_command._HonestEstimator(EstimatorConfig(), Folds(tmp_path))
    before = estimator.network
    assert before is not None
    for sample in good_samples(SyntheticSource(frames=2, seed=5, walk=False, camera=CAMERA)):
        estimator.estimate(sample.frame)
    assert asked == ["000000", "000001"]
    assert estimator.network is before


def test_honest_networks_look_for_models_of_ones_own_too(tmp_path: Path) -> None:
    folder = models_with_no_weights(tmp_path, "joint_rgbd.npz")
    estimator = calibrate_command._estimator(EstimatorConfig(), SceneFolds(tmp_path), folder)
    assert isinstance(estimator, calibrate_command._HonestEstimator)
    assert not estimator.models[True, True].joint.vector.any()
