"""The labelled .mat: a small file in the documented layout reads as the frames that were put in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from room_layout_ros.datasets import DataError, good_samples, open_source
from room_layout_ros.datasets.nyu import NYU_CAMERA, open_nyu

h5py = pytest.importorskip("h5py", reason="h5py is not installed (extra datasets)")

SIZE = (480, 640)


def write_mat(path: Path, rng: np.random.Generator, labels40: bool = True) -> dict[str, Any]:
    """Write H x W x 3 x N by columns, as MATLAB does."""
    truth: dict[str, Any] = {
        "images": rng.integers(0, 256, (2, *SIZE, 3)).astype(np.uint8),
        "depths": rng.uniform(0.7, 9.9, (2, *SIZE)).astype(np.float32),
        "labels40": rng.integers(0, 41, (2, *SIZE)).astype(np.uint16),
    }
    raw = truth["depths"].copy()
    raw[:, :50] = 0
    with h5py.File(path, "w") as file:
        file["images"] = truth["images"].transpose(0, 3, 2, 1)
        file["depths"] = truth["depths"].transpose(0, 2, 1)
        file["rawDepths"] = raw.transpose(0, 2, 1)
        file["labels"] = rng.integers(0, 895, (2, 640, 480)).astype(np.uint16)
        if labels40:
            file["labels40"] = truth["labels40"].transpose(0, 2, 1)
    return truth


def test_frames_come_out_upright_and_named_from_one(tmp_path: Path, rng: np.random.Generator) -> None:
    truth = write_mat(tmp_path / "nyu.mat", rng)
    samples = list(good_samples(open_source(tmp_path / "nyu.mat")))
    assert [s.name for s in samples] == ["0001", "0002"]
    for i, sample in enumerate(samples):
        assert sample.frame.camera == NYU_CAMERA
        np.testing.assert_array_equal(sample.frame.color, truth["images"][i])
        np.testing.assert_array_equal(sample.frame.depth_m, truth["depths"][i])
        assert sample.truth is not None
        np.testing.assert_array_equal(sample.truth.labels40, truth["labels40"][i])


def test_raw_depth_keeps_its_holes(tmp_path: Path, rng: np.random.Generator) -> None:
    write_mat(tmp_path / "nyu.mat", rng)
    first = next(iter(good_samples(open_nyu(tmp_path / "nyu.mat", raw_depth=True))))
    assert first.frame.depth_m is not None
    assert np.isnan(first.frame.depth_m[:50]).all()
    assert np.isfinite(first.frame.depth_m[50:]).all()


def test_894_classes_are_not_passed_off_as_40(tmp_path: Path, rng: np.random.Generator) -> None:
    write_mat(tmp_path / "nyu.mat", rng, labels40=False)
    assert next(iter(good_samples(open_source(tmp_path / "nyu.mat")))).truth is None


def test_other_files_are_refused_in_one_sentence(tmp_path: Path, rng: np.random.Generator) -> None:
    (tmp_path / "old.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(DataError, match="no HDF5"):
        open_source(tmp_path / "old.mat")
    write_mat(tmp_path / "cut.mat", rng)
    (tmp_path / "cut.mat").write_bytes((tmp_path / "cut.mat").read_bytes()[:5000])
    with pytest.raises(DataError, match="cut"):
        open_source(tmp_path / "cut.mat")
    with h5py.File(tmp_path / "empty.mat", "w") as file:
        file["x"] = 1
    with pytest.raises(DataError, match="no field 'images'"):
        open_source(tmp_path / "empty.mat")
    with h5py.File(tmp_path / "small.mat", "w") as file:
        file["images"] = np.zeros((1, 3, 20, 10), np.uint8)
        file["depths"] = np.zeros((1, 20, 10), np.float32)
    with pytest.raises(DataError, match="3 x 640 x 480"):
        open_source(tmp_path / "small.mat")
