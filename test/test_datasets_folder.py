"""Frames folders: what is there is read exactly, what is wrong is said in one sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import assert_same_samples, make_samples, write_folder

from room_layout_ros.commands.frame_choice import choose_frames
from room_layout_ros.commands.view import find_frame
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.datasets import (
    BadFrame,
    DataError,
    FramesFolder,
    FrameSource,
    Sample,
    good_samples,
    labels_from_classes,
    open_source,
)
from room_layout_ros.datasets.calibration import read_calibration, write_calibration
from room_layout_ros.datasets.convert import copy_frames
from room_layout_ros.datasets.folder import unread
from room_layout_ros.datasets.images import depth_to_millimetres, read_depth
from room_layout_ros.datasets.writers import BagWriter, FolderWriter
from room_layout_ros.decoding.image import depth_from_mm
from room_layout_ros.learning.frames_apart import frames_apart, read_frame


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    return write_folder(tmp_path / "frames", make_samples(3, rng))


def test_a_written_folder_reads_back_equal(tmp_path: Path, rng: np.random.Generator) -> None:
    samples = make_samples(3, rng)
    source = open_source(write_folder(tmp_path / "frames", samples))
    assert isinstance(source, FrameSource)
    assert source.length == 3
    assert_same_samples(list(good_samples(source)), samples)


def test_millimetres_survive_metres_and_back_for_every_value() -> None:
    every = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(depth_to_millimetres(depth_from_mm(every)), every)


def test_labels_are_faces_on_structure_clutter_elsewhere_and_unknown_where_unlabelled() -> None:
    layout = np.array([[1, 2, 3, 4, 5]], np.uint8)
    classes = np.array([[22, 2, 5, 0, 9]], np.uint8)
    np.testing.assert_array_equal(labels_from_classes(layout, classes), [[1, 2, CLUTTER, 0, 5]])


def test_real_frames_are_read_whole_with_their_classes(data_root: Path) -> None:
    source = open_source(data_root / "nyuv2")
    assert isinstance(source, FramesFolder)
    assert source.length == 1050
    sample = source.read("0059")
    assert sample.frame.color is not None
    assert sample.frame.color.shape == (480, 640, 3)
    assert sample.truth is not None
    assert sample.truth.layout is not None
    assert set(np.unique(sample.truth.layout)) <= {0, 1, 2, 3, 4, 5}
    assert source.subset(("0059", "0006")).read("0006").name == "0006"


def test_folders_without_stamps_run_at_30_hz_and_never_at_stamp_zero(data_root: Path) -> None:
    source = open_source(data_root / "corridor")
    stamps = [item.frame.stamp_ns for item, _ in zip(good_samples(source), range(4), strict=False)]
    assert stamps[0] > 0
    np.testing.assert_allclose(np.diff(stamps), 1e9 / 30, atol=1)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


@pytest.mark.parametrize("name", ("color", "image"))
def test_the_colour_folder_may_have_the_name_of_other_data_sets(folder: Path, name: str) -> None:
    expected = list(good_samples(open_source(folder)))
    (folder / "rgb").rename(folder / name)
    assert_same_samples(list(good_samples(open_source(folder))), expected)
    apart = [read_frame(item) for item in frames_apart(open_source(folder))]
    assert [isinstance(item, Sample) and item.frame.color is not None for item in apart] == [True] * 3
    (folder / name / "frame_007.png").unlink()
    bad = list(open_source(folder))[1]
    assert isinstance(bad, BadFrame)
    assert f"{name}/frame_007.png is missing" in bad.error


def test_what_of_a_folder_is_not_read_is_told(folder: Path) -> None:
    assert unread(folder) == ""
    for kind, picture in (("rgb", "frame_007.PNG"), ("depth", "frame_007.PNG")):
        (folder / kind / "frame_007.png").rename(folder / kind / picture)
        assert f"1 files in {folder / kind} are not read, as frame_007.PNG; names must end in .png" in unread(folder)
        (folder / kind / picture).rename(folder / kind / "frame_007.png")
    for path in [*folder.glob("rgb/*.png"), *folder.glob("depth/*.png")]:
        path.rename(path.with_suffix(".PNG"))
    with pytest.raises(DataError, match=r"holds no frames; .* are needed \(3 files in .*rgb are not read, as"):
        open_source(folder)
    for path in folder.glob("depth/*.PNG"):
        path.rename(path.with_suffix(".png"))
    (folder / "rgb").rename(folder / "images")
    assert unread(folder) == (
        f"{folder} is read as depth alone: it has no colour in a folder of the names rgb/, color/, image/; "
        "images/ is not read"
    )
    (folder / "images").rename(folder / "rgb")
    (folder / "depth").rename(folder / "Depth")
    assert unread(folder) == (
        f"{folder} is read as colour alone: it has no depth in a folder of the name depth/; Depth/ is not read"
    )


def test_two_folders_that_may_be_the_colour_are_refused_unless_one_is_rgb(folder: Path) -> None:
    (folder / "color").mkdir()
    assert next(iter(good_samples(open_source(folder)))).frame.color is not None
    (folder / "rgb").rename(folder / "image")
    with pytest.raises(DataError, match="color/ and image/; name the colour images' folder rgb/"):
        open_source(folder)


@pytest.mark.parametrize("wanted", ("7", "0007"))
def test_a_name_without_its_zeros_means_the_only_frame_of_that_number(folder: Path, wanted: str) -> None:
    for path in folder.glob("*/frame_007.png"):
        path.rename(path.with_name("007.png"))
    (folder / "stamps.txt").unlink()
    (folder / "poses.txt").unlink()
    source = open_source(folder)
    assert isinstance(source, FramesFolder)
    chosen = choose_frames(source, f"frame_000,{wanted}")
    assert isinstance(chosen, FramesFolder)
    assert chosen.names == ("frame_000", "007")
    (folder / "list.txt").write_text(f"{wanted} frame_014")
    chosen = choose_frames(source, str(folder / "list.txt"))
    assert isinstance(chosen, FramesFolder)
    assert chosen.names == ("007", "frame_014")
    assert find_frame(source, wanted).name == "007"
    with pytest.raises(DataError, match=r"--frames 8: neither one of its lists .* nor names of frames$"):
        choose_frames(source, "8")
    for path in folder.glob("*/frame_014.png"):
        path.rename(path.with_name("07.png"))
    both = open_source(folder)
    assert isinstance(both, FramesFolder)
    if wanted == "7":
        with pytest.raises(DataError, match="no frame '7'"):
            find_frame(both, "7")
    with pytest.raises(DataError, match="nor names of frames"):
        choose_frames(both, wanted)
    chosen = choose_frames(both, "007")
    assert isinstance(chosen, FramesFolder)
    assert chosen.names == ("007",)


@pytest.mark.parametrize("content", ['["0001", "0002"]', "[1", "7", "null"])
def test_a_splits_file_that_is_no_table_is_one_sentence(folder: Path, content: str) -> None:
    (folder / "splits.json").write_text(content)
    with pytest.raises(DataError, match=r"splits\.json is no table of lists; it must be a JSON object"):
        choose_frames(open_source(folder), "frame_000")


@pytest.mark.parametrize(
    ("file", "damage", "words"),
    [
        ("rgb/frame_007.png", cut, "cut"),
        ("depth/frame_007.png", cut, "cut"),
        ("depth/frame_007.png", Path.unlink, "missing"),
        ("rgb/frame_007.png", Path.unlink, "missing"),
        ("rgb/frame_007.png", lambda p: p.write_bytes(b"not a picture"), "neither PNG nor JPEG"),
        ("rgb/frame_007.png", lambda p: p.write_bytes(b""), "neither PNG nor JPEG"),
    ],
)
def test_a_bad_file_is_an_error_value_for_its_frame_alone(folder: Path, file: str, damage, words: str) -> None:  # type: ignore[no-untyped-def]
    damage(folder / file)
    items = list(open_source(folder))
    assert [type(item) for item in items] == [Sample, BadFrame, Sample]
    assert isinstance(items[1], BadFrame)
    assert words in items[1].error
    assert "007" in items[1].error


def test_a_picture_of_another_size_is_refused_with_both_sizes(folder: Path, rng: np.random.Generator) -> None:
    from room_layout_ros.datasets.images import write_image

    write_image(folder / "rgb" / "frame_000.png", rng.integers(0, 255, (30, 40, 3)).astype(np.uint8))
    first = next(iter(open_source(folder)))
    assert isinstance(first, BadFrame)
    assert "(30, 40, 3)" in first.error
    assert "(48, 64, 3)" in first.error


def test_eight_bit_depth_is_refused(folder: Path) -> None:
    from room_layout_ros.datasets.images import write_image

    write_image(folder / "depth" / "frame_000.png", np.ones((48, 64), np.uint8))
    with pytest.raises(DataError, match="uint16 millimetres"):
        read_depth(folder / "depth" / "frame_000.png")


def test_a_folder_of_colour_alone_gives_frames_without_depth(folder: Path) -> None:
    for path in (folder / "depth").iterdir():
        path.unlink()
    (folder / "depth").rmdir()
    assert [s.frame.depth_m for s in good_samples(open_source(folder))] == [None] * 3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "missing"),
        ("a: [1", r"is no YAML; a ROS camera calibration with image_width, .* is needed"),
        ("just words", "no camera calibration"),
        ("image_width: 640\nimage_height: 480\n", "no camera_matrix"),
        ("image_width: 64\nimage_height: 48\ncamera_matrix: {data: [1, 0, 0]}\n", "3 numbers"),
        ("image_width: 64\nimage_height: 48\ncamera_matrix: {data: [0,0,0,0,0,0,0,0,1]}\n", "calibrated"),
        ("image_width: 64\nimage_height: 48\ncamera_matrix: [[9, 0, 9], [0, 9, 9]]\n", "6 numbers"),
        ("image_width: 64\nimage_height: 48\ncamera_matrix: [[9, 0, 9], [0, [9], 9], 1]\n", "nor rows"),
        ("image_width: 64\nimage_height: 48\ncamera_matrix: !!python/tuple [9, 0]\n", "is no YAML"),
        ("image_width: wide\nimage_height: 48\ncamera_matrix: {data: [9,0,9,0,9,9,0,0,1]}\n", "image_width"),
        ("a: &x [1]\nb: [*x, *x]\n", "aliases"),
        ("x" * 70000, "at most"),
    ],
)
def test_a_bad_calibration_refuses_the_folder_in_one_sentence(folder: Path, text: str | None, words: str) -> None:
    (folder / "camera.yaml").unlink()
    if text is not None:
        (folder / "camera.yaml").write_text(text)
    with pytest.raises(DataError, match=words) as caught:
        open_source(folder)
    assert "\n" not in str(caught.value)


K_ROWS = "[[525.0, 0, 319.5], [0, 525.0, 239.5], [0, 0, 1]]"
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 525., 0., 319.5, 0.,
       525., 239.5, 0., 0., 1. ]
"""


@pytest.mark.parametrize(
    "text",
    (
        "image_width: 640\nimage_height: 480\ncamera_matrix: [525.0, 0, 319.5, 0, 525.0, 239.5, 0, 0, 1]\n",
        f"image_width: 640\nimage_height: 480\ncamera_matrix: {K_ROWS}\n",
        f"image_width: 640\nimage_height: 480\ncamera_matrix: {{data: {K_ROWS}}}\n",
        OPENCV,
    ),
    ids=("list", "rows", "rows as data", "OpenCV's"),
)
def test_camera_files_of_other_hands_are_read(text: str, tmp_path: Path) -> None:
    (tmp_path / "camera.yaml").write_text(text)
    calibration = read_calibration(tmp_path / "camera.yaml")
    assert calibration.intrinsics == CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
    assert calibration.warning == ""


def test_a_calibration_reads_back_equal(data_root: Path, tmp_path: Path) -> None:
    calibration = read_calibration(data_root / "corridor" / "camera.yaml")
    assert calibration.is_distorted
    write_calibration(tmp_path / "camera.yaml", calibration)
    assert read_calibration(tmp_path / "camera.yaml") == calibration


@pytest.mark.parametrize("text", ["", "on", "0123", "null", "1e3", "a: b", '#"\\', "küche 🙂", "x\x7f", "long " * 40])
def test_names_in_a_calibration_are_words_whatever_they_look_like(data_root: Path, tmp_path: Path, text: str) -> None:
    calibration = read_calibration(data_root / "corridor" / "camera.yaml")
    calibration = replace(calibration, camera_name=text, distortion_model=text)
    write_calibration(tmp_path / "camera.yaml", calibration)
    assert read_calibration(tmp_path / "camera.yaml") == calibration


def test_frames_that_are_numbered_without_zeros_come_in_order(tmp_path: Path, rng: np.random.Generator) -> None:
    numbered = [replace(s, frame=replace(s.frame, name=str(i))) for i, s in enumerate(make_samples(12, rng))]
    folder = write_folder(tmp_path / "frames", numbered)
    assert [s.name for s in good_samples(open_source(folder))] == [str(i) for i in range(12)]
    for picture in folder.glob("*/10.png"):
        picture.rename(picture.with_name("x.png"))
    (folder / "stamps.txt").unlink()
    (folder / "poses.txt").unlink()
    assert [s.name for s in open_source(folder)] == ["0", "1", "11", *map(str, range(2, 10)), "x"]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("frame_000 1 2 3", "is no pose"),
        ("frame_000 1 2 3 0 0 0 nan", "is no pose"),
        ("frame_000 1 2 3 0 0 0 2", "length 2"),
        ("1.5 1 2 3 0 0 0 1", "1 poses for 3 frames"),
        ("frame_001 1 2 3 0 0 0 1", "a pose of 'frame_001'; it is neither the name of a frame nor seconds"),
        ("1.5 1 2 3 0 0 0 1 0", "neither the name of a frame nor seconds"),
    ],
)
def test_bad_poses_are_refused(folder: Path, line: str, words: str) -> None:
    (folder / "poses.txt").write_text(line + "\n")
    with pytest.raises(DataError, match=words):
        open_source(folder)


def test_poses_with_a_wrong_name_are_not_taken_for_poses_in_order(folder: Path) -> None:
    names = ("frame_014", "frame_0007", "frame_000")
    (folder / "poses.txt").write_text("".join(f"{name} {i} 0 0 0 0 0 1\n" for i, name in enumerate(names)))
    with pytest.raises(DataError, match="a pose of 'frame_0007'; it is neither the name of a frame nor seconds"):
        open_source(folder)


def test_names_with_spaces_survive_the_way_through_bag_and_folder(tmp_path: Path, rng: np.random.Generator) -> None:
    named = [replace(s, frame=replace(s.frame, name=f"küche {i} links")) for i, s in enumerate(make_samples(3, rng))]
    write_folder(tmp_path / "made", named)
    copy_frames(open_source(tmp_path / "made"), BagWriter(tmp_path / "bag"))
    copy_frames(open_source(tmp_path / "bag"), FolderWriter(tmp_path / "again"))
    assert_same_samples(list(good_samples(open_source(tmp_path / "again"))), named)


def test_truth_that_is_not_read_is_told(folder: Path) -> None:
    (folder / "labels40" / "frame_007.png").rename(folder / "labels40" / "frame_007.jpg")
    assert unread(folder) == (
        f"1 files in {folder / 'labels40'} are not read, as frame_007.jpg; names must end in .png"
    )


def test_tum_poses_without_names_go_to_the_frames_in_order(folder: Path) -> None:
    (folder / "poses.txt").write_text("".join(f"{i}.5 {i} 0 0 0 0 0 1\n" for i in range(3)))
    xs = [s.T_world_camera[0, 3] for s in good_samples(open_source(folder)) if s.T_world_camera is not None]
    assert xs == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("stamp", ["17000000001000000000", "2147483648000000000", "9" * 5000])
def test_a_stamp_that_ros_cannot_say_is_refused(folder: Path, stamp: str) -> None:
    (folder / "stamps.txt").write_text(f"frame_000 5\nframe_007 {stamp}\nframe_014 7\n")
    with pytest.raises(DataError, match=rf"stamps.txt line 2: {stamp[:40]} ns; allowed is 0 to 2147483647999999999 "):
        open_source(folder)
    (folder / "stamps.txt").write_text("frame_000 5\nframe_007 2147483647999999999\nframe_014 7\n")
    copy_frames(open_source(folder), BagWriter(folder.parent / "bag"))
    assert [s.frame.stamp_ns for s in good_samples(open_source(folder.parent / "bag"))] == [5, 7, 2147483647999999999]


def test_a_frame_without_its_stamp_is_a_bad_one_and_gets_none_invented(folder: Path) -> None:
    (folder / "stamps.txt").write_text("frame_000 1700000000000000000\nframe_014 1700000000100000000\n")
    items = list(open_source(folder))
    assert [type(item) for item in items] == [Sample, BadFrame, Sample]
    assert isinstance(items[1], BadFrame)
    assert items[1].error == f"{folder / 'stamps.txt'} has no stamp of frame frame_007"
    apart = [read_frame(item) for item in frames_apart(open_source(folder))]
    assert [type(item) for item in apart] == [Sample, BadFrame, Sample]


@pytest.mark.parametrize("make", [lambda p: None, lambda p: p.mkdir(), lambda p: p.write_bytes(b"x")])
def test_what_is_no_source_is_refused(tmp_path: Path, make) -> None:  # type: ignore[no-untyped-def]
    make(tmp_path / "thing")
    with pytest.raises(DataError, match="thing"):
        open_source(tmp_path / "thing")


def test_nothing_is_written_over_an_existing_folder(folder: Path, rng: np.random.Generator) -> None:
    with pytest.raises(DataError, match="exists already"):
        write_folder(folder, make_samples(1, rng))
