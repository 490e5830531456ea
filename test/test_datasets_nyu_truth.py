"""Layouts and the mapping of classes, published apart from the NYU v2 file, in every form that is known of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from nyu_on_disk import true_layouts, write_mat, write_nyu

from room_layout_ros.datasets import DataError, good_samples
from room_layout_ros.datasets.nyu import open_nyu
from room_layout_ros.datasets.nyu_truth import read_class_map, read_layouts

pytest.importorskip("h5py", reason="h5py is not installed (extra datasets)")

NUMBERS = (5, 2, 9)
VERSIONS = ("5", "7.3", "npz")


def fields(numbers: tuple[int, ...] = NUMBERS) -> dict[str, NDArray[Any]]:
    """Return `index` and `layout` as MATLAB has them: H x W x N, numbers as a row of doubles."""
    return {"index": np.array([numbers], np.float64), "layout": np.moveaxis(true_layouts(), 0, -1)}


def file_name(version: str) -> str:
    return "layouts.npz" if version == "npz" else "layouts.mat"


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("dtype", (np.uint8, np.float64))
def test_each_layout_belongs_to_the_image_that_index_names(tmp_path: Path, version: str, dtype: type) -> None:
    content = fields()
    content["layout"] = content["layout"].astype(dtype)
    found = read_layouts([write_mat(tmp_path / file_name(version), content, version)])
    assert found.numbers == (2, 5, 9)
    for number, layout in zip(NUMBERS, true_layouts(), strict=True):
        np.testing.assert_array_equal(found.of(number), layout)
    assert found.of(1) is None


def test_a_mask_over_all_images_and_a_file_for_each_field_read_the_same(tmp_path: Path) -> None:
    mask = np.zeros((1449, 1), np.uint8)
    mask[[1, 4, 8]] = 1
    paths = [
        write_mat(tmp_path / "index_303.mat", {"index": mask}, "5"),
        write_mat(tmp_path / "layout_GT.mat", {"layout_GT": fields()["layout"]}, "7.3"),
        write_mat(tmp_path / "data_split.mat", {"train": np.array([[3, 1]]), "test": np.array([[2]])}, "5"),
    ]
    found = read_layouts(paths)
    assert found.numbers == (2, 5, 9)
    np.testing.assert_array_equal(found.faces, true_layouts())
    assert found.splits == {"train": (2, 9), "test": (5,)}


@pytest.mark.parametrize("face_ids", ((5, 4, 2, 1, 3), (10, 20, 30, 40, 50)))
def test_other_ids_are_read_by_their_order_and_refused_without_it(tmp_path: Path, face_ids: tuple[int, ...]) -> None:
    content = fields()
    content["layout"] = np.array([0, *face_ids], np.uint8)[content["layout"]]
    path = write_mat(tmp_path / "layouts.mat", content, "5")
    np.testing.assert_array_equal(read_layouts([path], face_ids).of(5), true_layouts()[0])
    with pytest.raises(DataError, match="--face-ids"):
        read_layouts([path])


def test_every_wrong_order_of_the_ids_is_noticed(tmp_path: Path) -> None:
    content = fields()
    for a in range(1, 6):
        for b in range(a + 1, 6):
            swapped = np.arange(6, dtype=np.uint8)
            swapped[[a, b]] = b, a
            path = write_mat(tmp_path / "layouts.npz", content | {"layout": swapped[content["layout"]]}, "npz")
            with pytest.raises(DataError, match=r"lies (below|right of) what they call"):
                read_layouts([path])


def test_pixels_that_are_not_annotated_have_no_face(tmp_path: Path) -> None:
    content = fields()
    content["layout"] = content["layout"].astype(np.int16)
    content["layout"][:3] = -1
    content["layout"][3:5] = 0
    found = read_layouts([write_mat(tmp_path / "layouts.mat", content, "5")])
    assert not found.faces[:, :5].any()
    assert found.faces[:, 5:].all()


@pytest.mark.parametrize(
    ("change", "words"),
    (
        ({"index": np.array([[1, 2]])}, "index names 2 images and layout holds 3"),
        ({"index": np.array([[1, 2, 2]])}, "different image numbers"),
        ({"index": np.array([[0, 1, 2]])}, "counted from 1"),
        ({"index": np.array([[1, 2.5, 3]])}, "whole numbers"),
        ({"layout": np.full((480, 640, 3), 7, np.uint8)}, "holds id 7"),
        ({"layout": np.ones((480, 640, 3, 2), np.uint8)}, "H x W x N"),
        ({"layout": np.array(["no", "numbers"])}, "numbers are needed"),
        ({"test": np.array([[4]])}, "test must count the 3 layouts from 1"),
    ),
)
def test_what_does_not_fit_is_refused_in_a_sentence(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    path = write_mat(tmp_path / "layouts.npz", fields() | change, "npz")
    with pytest.raises(DataError, match=words):
        read_layouts([path])


@pytest.mark.parametrize("version", VERSIONS)
def test_cut_and_foreign_files_are_refused_in_a_sentence(tmp_path: Path, version: str) -> None:
    path = write_mat(tmp_path / file_name(version), fields(), version)
    content = path.read_bytes()
    for size in (0, 4, 200, len(content) // 2):
        path.write_bytes(content[:size])
        with pytest.raises(DataError, match=path.name):
            read_layouts([path])
    with pytest.raises(DataError, match="fields index and layout are needed; found are none"):
        read_layouts([write_mat(path, {"other": np.zeros(3)}, version)])
    with pytest.raises(DataError, match="missing"):
        read_layouts([tmp_path / "nowhere.mat"])


def test_the_source_is_restricted_to_the_images_with_a_layout(tmp_path: Path, rng: np.random.Generator) -> None:
    write_nyu(tmp_path / "nyu.mat", rng, 4)
    layouts = read_layouts([write_mat(tmp_path / "layouts.mat", fields((4, 1, 2)), "5")])
    samples = list(good_samples(open_nyu(tmp_path / "nyu.mat", layouts=layouts)))
    assert [s.name for s in samples] == ["0001", "0002", "0004"]
    for sample, i in zip(samples, (1, 2, 0), strict=True):
        assert sample.truth is not None
        np.testing.assert_array_equal(sample.truth.layout, true_layouts()[i])
    layouts = read_layouts([write_mat(tmp_path / "layouts.mat", fields((4, 1, 5)), "5")])
    with pytest.raises(DataError, match=r"name image 5; .* holds 4"):
        open_nyu(tmp_path / "nyu.mat", layouts=layouts)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_class_mapping_counts_from_one_and_keeps_unlabelled(tmp_path: Path, version: str) -> None:
    classes = np.random.default_rng(0).integers(1, 41, (1, 894))
    found = read_class_map(write_mat(tmp_path / file_name(version), {"mapClass": classes}, version))
    assert (found[0], len(found)) == (0, 895)
    np.testing.assert_array_equal(found[1:], classes[0])


@pytest.mark.parametrize(
    ("content", "words"),
    (
        ({"mapClass": np.array([[1, 41]])}, "NYU40 classes, 0 to 40"),
        ({"mapClass": np.array([[]])}, "NYU40 classes, 0 to 40"),
        ({"mapping": np.array([[1, 2]])}, "no field mapClass"),
    ),
)
def test_a_mapping_to_other_classes_is_refused(tmp_path: Path, content: dict[str, Any], words: str) -> None:
    with pytest.raises(DataError, match=words):
        read_class_map(write_mat(tmp_path / "map.mat", content, "5"))
