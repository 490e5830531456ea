"""Cameras that are read and used though something is odd about them: the commands say so once, in the node's words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import SMALL, make_samples, write_folder

from room_layout_ros.cli import main
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.datasets.calibration import CameraCalibration, write_calibration
from room_layout_ros.datasets.writers import BagWriter

BENT = "if the images are not rectified, the room will be bent"
HALF = CameraIntrinsics(SMALL.width, SMALL.height, SMALL.fx / 2, SMALL.fy / 2, SMALL.cx / 2, SMALL.cy / 2)
RIGHT = CameraCalibration.from_intrinsics(SMALL)
D = (-0.38, 0.16, 0.001, 0.0, -0.02)
OTHER = f"has its principal point at ({HALF.cx:g}, {HALF.cy:g}), far from the middle of {SMALL.width}x{SMALL.height}"
Words = tuple[str, ...]
CASES: tuple[tuple[CameraCalibration, Words], ...] = (
    (RIGHT, ()),
    (replace(RIGHT, D=D), (BENT,)),
    (CameraCalibration.from_intrinsics(HALF), (OTHER,)),
    (replace(CameraCalibration.from_intrinsics(HALF), D=D), (BENT, OTHER)),
)


@pytest.mark.parametrize(("calibration", "words"), CASES, ids=("right", "bent", "of another size", "both"))
@pytest.mark.parametrize("kind", ("folder", "bag", "bag with a file"))
def test_what_is_odd_about_a_camera_is_one_line(
    kind: str, calibration: CameraCalibration, words: Words, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples = make_samples(2, np.random.default_rng(1))
    file, bag = tmp_path / "frames" / "camera.yaml", tmp_path / "bag"
    options: dict[str, Path] = {}
    if kind == "folder":
        write_folder(file.parent, samples)
        where = f"{file} has"
    else:
        file.parent.mkdir()
        with BagWriter(bag, calibration) as writer:
            for sample in samples:
                writer.write(sample)
        options = {"camera": file} if kind == "bag with a file" else {}
        where = f"{file} has" if options else f"{bag}: camera_info has"
    write_calibration(file, calibration)
    open_and_tell(file.parent if kind == "folder" else bag, **options)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == bool(words)
    for line in lines:
        assert line.startswith(where)
        assert all(word in line for word in words)


def test_a_bag_of_an_uncalibrated_camera_is_refused_as_such_and_not_as_damaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag, replace(RIGHT, K=(0.0,) * 9, P=(0.0,) * 12)) as writer:
        writer.write(make_samples(1, np.random.default_rng(1))[0])
    assert main(["estimate", str(bag), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "camera_info has P of zeros" in error
    assert error.endswith("(give a calibration file with --camera)\n"), "nothing is damaged"
