"""The labelled .mat: a small file in the documented layout reads as the frames that were put in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from nyu_on_disk import write_mat, write_nyu

from room_layout_ros.cli import main
from room_layout_ros.datasets import DataError, good_samples, open_source
from room_layout_ros.datasets.nyu import NYU_CAMERA, open_nyu

h5py = pytest.importorskip("h5py", reason="h5py is not installed (extra datasets)")


def classes40(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 41, (2, 480, 640)).astype(np.uint16)


def test_frames_come_out_upright_and_named_from_one(tmp_path: Path, rng: np.random.Generator) -> None:
    truth = write_nyu(tmp_path / "nyu.mat", rng, 2, labels40=classes40(rng))
    samples = list(good_samples(open_source(tmp_path / "nyu.mat")))
    assert [s.name for s in samples] == ["0001", "0002"]
    for i, sample in enumerate(samples):
        assert sample.frame.camera == NYU_CAMERA
        np.testing.assert_array_equal(sample.frame.color, truth["images"][i])
        np.testing.assert_array_equal(sample.frame.depth_m, truth["depths"][i])
        assert sample.truth is not None
        np.testing.assert_array_equal(sample.truth.labels40, truth["labels40"][i])


def test_raw_depth_keeps_its_holes(tmp_path: Path, rng: np.random.Generator) -> None:
    write_nyu(tmp_path / "nyu.mat", rng, 1)
    first = next(iter(good_samples(open_nyu(tmp_path / "nyu.mat", raw_depth=True))))
    assert first.frame.depth_m is not None
    assert np.isnan(first.frame.depth_m[:50]).all()
    assert np.isfinite(first.frame.depth_m[50:]).all()


def test_894_classes_are_not_passed_off_as_40(tmp_path: Path, rng: np.random.Generator) -> None:
    write_nyu(tmp_path / "nyu.mat", rng, 1)
    assert next(iter(good_samples(open_source(tmp_path / "nyu.mat")))).truth is None


def test_894_classes_become_40_by_the_mapping_given(tmp_path: Path, rng: np.random.Generator) -> None:
    truth = write_nyu(tmp_path / "nyu.mat", rng, 1, labels40=classes40(rng)[:1])
    mapping = np.concatenate([[0], rng.integers(1, 41, 894)]).astype(np.uint8)
    sample = next(iter(good_samples(open_nyu(tmp_path / "nyu.mat", class_map=mapping))))
    assert sample.truth is not None
    np.testing.assert_array_equal(sample.truth.labels40, mapping[truth["labels"][0]])


@pytest.mark.parametrize("name", ["nyu.mat", "NYU.MAT"])
def test_convert_makes_a_folder_to_learn_from_with_the_mapping(
    name: str, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = write_nyu(tmp_path / name, rng, 2)
    mapping = rng.integers(1, 41, (1, 894))
    write_mat(tmp_path / "map.mat", {"mapClass": mapping}, "5")
    words = ["--to", "folder", "--classes40", str(tmp_path / "map.mat")]
    assert open_source(tmp_path / name).title == f"NYU v2 file {tmp_path / name}"
    assert main(["convert", str(tmp_path / name), str(tmp_path / "made"), *words]) == 0
    for i, sample in enumerate(good_samples(open_source(tmp_path / "made"))):
        assert sample.truth is not None
        np.testing.assert_array_equal(sample.truth.labels40, np.append(0, mapping)[truth["labels"][i]])
    assert main(["convert", str(tmp_path / "made"), str(tmp_path / "again"), *words]) == 2
    assert "map.mat is for an NYU .mat; " in capsys.readouterr().err


def test_a_class_that_the_mapping_lacks_is_one_bad_frame(tmp_path: Path, rng: np.random.Generator) -> None:
    labels = np.ones((2, 480, 640), np.uint16)
    labels[1, 7, 7] = 12
    write_nyu(tmp_path / "nyu.mat", rng, 2, labels=labels)
    good, bad = open_nyu(tmp_path / "nyu.mat", class_map=np.ones(12, np.uint8))
    assert good.name == "0001"
    assert "labels holds 12; the mapping has classes 1 to 11" in getattr(bad, "error", "")


def test_a_subset_yields_its_frames_in_its_order(tmp_path: Path, rng: np.random.Generator) -> None:
    truth = write_nyu(tmp_path / "nyu.mat", rng, 3)
    source = open_nyu(tmp_path / "nyu.mat").subset(("0003", "0001"))
    samples = list(good_samples(source))
    assert ([s.name for s in samples], source.length) == (["0003", "0001"], 2)
    np.testing.assert_array_equal(samples[0].frame.color, truth["images"][2])
    with pytest.raises(DataError, match="no frame '0002'"):
        source.subset(("0002",))


def test_other_files_are_refused_in_one_sentence(tmp_path: Path, rng: np.random.Generator) -> None:
    (tmp_path / "old.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(DataError, match="no HDF5"):
        open_source(tmp_path / "old.mat")
    write_nyu(tmp_path / "cut.mat", rng, 1)
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
