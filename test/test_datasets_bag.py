"""Bags: frames go in and come out bit by bit; pairing, topics and damage as stated."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damaged_bags import damage_middle
from frames_on_disk import SMALL, assert_same_samples, make_samples, write_folder

from room_layout_ros.cli import main
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.datasets import (
    BadFrame,
    CameraCalibration,
    DataError,
    FrameSource,
    Sample,
    good_samples,
    open_source,
)
from room_layout_ros.datasets import bag_messages as messages
from room_layout_ros.datasets.bag import BagSource
from room_layout_ros.datasets.bag_topics import choose_topics
from room_layout_ros.datasets.calibration import write_calibration
from room_layout_ros.datasets.convert import calibration_of, copy_frames
from room_layout_ros.datasets.images import encode_image
from room_layout_ros.datasets.readable import ReadablePart
from room_layout_ros.datasets.writers import STORAGES, BagWriter, FolderWriter

pytest.importorskip("rosbags", reason="rosbags is not installed (extra playback)")

IMAGE, INFO = messages.IMAGE, messages.CAMERA_INFO
QUARTER = CameraIntrinsics(160, 120, 131.0, 131.0, 79.5, 59.5)


def write_bag(path: Path, samples: list[Sample], storage: str = "mcap") -> Path:
    with BagWriter(path, storage=storage) as writer:
        for sample in samples:
            writer.write(sample)
    return path


def write_raw(path: Path, items: list[tuple[str, str, int, bytes]]) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, time_ns, raw in items:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=messages.typestore())
            writer.write(connections[topic], time_ns, raw)
    return path


def color_at(stamp_ns: int, value: int = 7, frame_id: str = "optical") -> bytes:
    return messages.encode_image_message(np.full((48, 64, 3), value, np.uint8), "rgb8", stamp_ns, frame_id)


def depth_at(stamp_ns: int, frame_id: str = "optical", mm: int = 1500) -> bytes:
    return messages.encode_image_message(np.full((48, 64), mm, np.uint16), "16UC1", stamp_ns, frame_id)


def info_at(stamp_ns: int) -> bytes:
    return messages.encode_camera_info(CameraCalibration.from_intrinsics(SMALL), stamp_ns, "optical")


@pytest.mark.parametrize("storage", STORAGES)
def test_a_folder_survives_the_way_through_a_bag_byte_by_byte(
    tmp_path: Path, rng: np.random.Generator, storage: str
) -> None:
    samples = make_samples(4, rng)
    folder = open_source(write_folder(tmp_path / "a", samples))
    copy_frames(folder, BagWriter(tmp_path / "bag", calibration_of(folder), storage))
    bag = open_source(tmp_path / "bag")
    assert bag.length == 4
    assert_same_samples(list(good_samples(bag)), samples)
    copy_frames(bag, FolderWriter(tmp_path / "b", calibration_of(bag)))
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path / "b") for p in (tmp_path / "b").rglob("*") if p.is_file())
    for file in files:
        if file.name != "poses.txt":  # matrix to quaternion and back moves the last bit; compared above
            assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_real_frames_survive_the_way_through_a_bag(data_root: Path, tmp_path: Path) -> None:
    from room_layout_ros.datasets import open_folder

    folder = open_folder(data_root / "nyuv2").subset(("0059", "0219"))
    copy_frames(folder, BagWriter(tmp_path / "bag", calibration_of(folder)))
    assert_some_equal(list(good_samples(open_source(tmp_path / "bag"))), [folder.read("0059"), folder.read("0219")])
    assert calibration_of(open_source(tmp_path / "bag")) == folder.calibration


def assert_some_equal(actual: list[Sample], expected: list[Sample]) -> None:
    assert [s.name for s in actual] == [s.name for s in expected]
    for a, b in zip(actual, expected, strict=True):
        np.testing.assert_array_equal(a.frame.color, b.frame.color)
        np.testing.assert_array_equal(a.frame.depth_m, b.frame.depth_m)


def test_depth_finer_than_a_millimetre_is_kept_in_bags(tmp_path: Path, rng: np.random.Generator) -> None:
    (sample,) = make_samples(1, rng)
    fine = rng.uniform(0.5, 5.0, (48, 64)).astype(np.float32)
    write_bag(tmp_path / "bag", [replace(sample, frame=replace(sample.frame, depth_m=fine))])
    (read,) = good_samples(open_source(tmp_path / "bag"))
    np.testing.assert_array_equal(read.frame.depth_m, fine)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_storage_file_alone_opens_too(tmp_path: Path, rng: np.random.Generator, storage: str) -> None:
    bag = write_bag(tmp_path / "bag", make_samples(2, rng), storage)
    (bag / "metadata.yaml").unlink()
    file = next(p for p in bag.iterdir())
    assert len(list(good_samples(open_source(bag)))) == 2
    assert len(list(good_samples(open_source(file)))) == 2


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", (0.0, 0.3, 0.97))
def test_a_cut_bag_is_one_sentence(tmp_path: Path, rng: np.random.Generator, storage: str, share: float) -> None:
    bag = write_bag(tmp_path / "bag", make_samples(5, rng), storage)
    file = next(p for p in bag.iterdir() if p.name != "metadata.yaml")
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(DataError) as caught:
        list(open_source(bag))
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def read_until_damage(source: FrameSource) -> tuple[list[str], str]:
    """Names of the usable frames, and what is said at the end."""
    names: list[str] = []
    with pytest.raises(DataError) as caught:
        names.extend(s.name for s in good_samples(source))
    assert "\n" not in str(caught.value)
    return names, str(caught.value)


@pytest.mark.parametrize("storage", STORAGES)
def test_frames_before_damage_come_and_with_recover_those_behind_it_too(
    tmp_path: Path, rng: np.random.Generator, storage: str
) -> None:
    samples = make_samples(40, rng, QUARTER)
    bag, names = write_bag(tmp_path / "bag", samples, storage), [s.name for s in samples]
    damage_middle(bag)
    before, told = read_until_damage(open_source(bag))
    assert "is damaged after" in told
    assert 10 < len(before) < 30
    assert before == names[: len(before)]
    around, told = read_until_damage(open_source(bag, recover=True))
    assert around[: len(before)] == before
    assert around[-1] == names[-1], "what lies behind the damage is read"
    assert around == [name for name in names if name in set(around)], "in order, once each"
    (lost, whole) = (int(n) for n in re.findall(r"(\d+) of its (\d+) messages are lost", told)[0])
    assert whole == 6 * len(samples)  # colour, depth, camera_info, layout, classes, pose
    assert len(samples) - len(around) <= lost <= 6 * (len(samples) - len(around)), "a lost frame lost 1 to 6 of them"
    good = dict(zip(names, samples, strict=True))
    assert_same_samples(list(_until_error(open_source(bag, recover=True))), [good[name] for name in around])


def _until_error(source: FrameSource) -> Iterator[Sample]:
    part = ReadablePart(source)
    yield from (item for item in part if isinstance(item, Sample))
    assert part.damage is not None


def test_messages_that_vanish_without_an_error_are_noticed(tmp_path: Path, rng: np.random.Generator) -> None:
    """A chunk without a checksum whose records lost their lengths reads as a shorter one."""
    bag = write_bag(tmp_path / "bag", make_samples(60, rng))
    file = next(bag.glob("*.mcap"))
    content = bytearray(file.read_bytes())
    middle = len(content) // 8192 * 4096
    content[middle : middle + 4096] = bytes(4096)
    file.write_bytes(content)
    names, told = read_until_damage(open_source(bag))
    assert 0 < len(names) < 60
    assert "messages are lost" in told


@pytest.mark.parametrize("storage", STORAGES)
def test_convert_with_recover_makes_a_whole_bag_of_a_damaged_one(
    tmp_path: Path, rng: np.random.Generator, storage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", make_samples(40, rng, QUARTER), storage)
    damage_middle(bag)
    assert main(["convert", str(bag), str(tmp_path / "strict"), "--to", "bag"]) == 2
    assert "is damaged" in capsys.readouterr().err
    with pytest.raises(DataError):
        open_source(tmp_path / "strict")
    assert main(["convert", str(bag), str(tmp_path / "whole"), "--to", "bag", "--recover"]) == 0
    assert "messages are lost" in capsys.readouterr().err
    around = list(_until_error(open_source(bag, recover=True)))
    assert_same_samples(list(good_samples(open_source(tmp_path / "whole"))), around)


@pytest.mark.parametrize("text", ["", "[", "rosbag2_bagfile_information: 3", "a: b"])
def test_bad_metadata_is_one_sentence(tmp_path: Path, rng: np.random.Generator, text: str) -> None:
    bag = write_bag(tmp_path / "bag", make_samples(1, rng))
    (bag / "metadata.yaml").write_text(text)
    with pytest.raises(DataError, match="cannot be opened"):
        open_source(bag)


def test_colour_pairs_exactly_before_nearest(tmp_path: Path) -> None:
    ms = 1_000_000
    items = [("/rgb/camera_info", INFO, 0, info_at(1))]
    for stamp, value in ((99 * ms, 1), (100 * ms, 2), (131 * ms, 3), (300 * ms, 4)):
        items.append(("/rgb/image", IMAGE, stamp, color_at(stamp, value)))
    items += [("/depth/image", IMAGE, s + ms // 2, depth_at(s)) for s in (100 * ms, 133 * ms, 200 * ms)]
    frames = list(open_source(write_raw(tmp_path / "bag", sorted(items, key=lambda i: i[2]))))
    assert isinstance(frames[0], Sample)
    assert isinstance(frames[1], Sample)
    assert isinstance(frames[2], BadFrame)
    assert frames[0].frame.color is not None
    assert frames[1].frame.color is not None
    assert frames[0].frame.color[0, 0, 0] == 2
    assert frames[1].frame.color[0, 0, 0] == 3
    assert "no colour image within 20 ms" in frames[2].error


def test_colour_that_comes_later_still_pairs(tmp_path: Path) -> None:
    ms = 1_000_000
    items = [("/rgb/camera_info", INFO, 0, info_at(1))]
    for i in range(1, 6):
        items.append(("/depth/image", IMAGE, 33 * i * ms, depth_at(33 * i * ms)))
        items.append(("/rgb/image", IMAGE, (33 * i + 400) * ms, color_at(33 * i * ms, i)))
    frames = list(good_samples(open_source(write_raw(tmp_path / "bag", sorted(items, key=lambda i: i[2])))))
    assert [int(f.frame.color[0, 0, 0]) for f in frames if f.frame.color is not None] == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(("apart_ns", "length"), ((0, 20), (5_000_000, 20), (0, 5)))
@pytest.mark.parametrize("depth_first", (True, False), ids=("depth first", "colour first"))
def test_a_recording_that_loops_pairs_no_images_of_two_loops(
    tmp_path: Path, depth_first: bool, apart_ns: int, length: int
) -> None:
    """Image k of all loops has the depth 1000 + k mm and the colour k."""
    period = 100_000_000
    items = [("/rgb/camera_info", INFO, 0, info_at(1))]
    for k in range(60):
        stamp = (50 + k % length) * period
        pair = [
            ("/depth/image", IMAGE, depth_at(stamp, mm=1000 + k)),
            ("/rgb/image", IMAGE, color_at(stamp + apart_ns, k)),
        ]
        for late, (topic, kind, raw) in enumerate(pair if depth_first else pair[::-1]):
            items.append((topic, kind, k * period + late * period // 10, raw))
    samples = list(good_samples(open_source(write_raw(tmp_path / "bag", items))))
    got = [(s.frame.color[0, 0, 0], round(s.frame.depth_m[0, 0] * 1000) - 1000) for s in samples]  # type: ignore[index]
    assert got == [(k, k) for k in range(60)]


def test_images_of_one_stamp_pair_in_their_order(tmp_path: Path) -> None:
    """Of a driver that sets no stamp."""
    items = [("/rgb/camera_info", INFO, 0, info_at(1))]
    for k in range(1, 6):
        items += [("/depth/image", IMAGE, 20 * k, depth_at(0)), ("/rgb/image", IMAGE, 20 * k + 10, color_at(0, k))]
    samples = good_samples(open_source(write_raw(tmp_path / "bag", items)))
    assert [int(s.frame.color[0, 0, 0]) for s in samples if s.frame.color is not None] == [1, 2, 3, 4, 5]


def test_depth_that_is_faster_than_colour_pairs_with_the_nearest(tmp_path: Path) -> None:
    """At 90 Hz and 30 Hz a colour image is the exact partner of one depth image and the nearest of its neighbours."""
    items = [("/rgb/camera_info", INFO, 0, info_at(1))]
    for k in range(31):
        stamp = 10**9 + k * 11_111_111
        if k % 3 == 0:
            items.append(("/rgb/image", IMAGE, stamp, color_at(stamp, k // 3)))
        items.append(("/depth/image", IMAGE, stamp + 10**6, depth_at(stamp)))
    samples = good_samples(open_source(write_raw(tmp_path / "bag", items)))
    nearest = [int(s.frame.color[0, 0, 0]) for s in samples if s.frame.color is not None]
    assert nearest == [round(k / 3) for k in range(31)]


def test_depth_in_another_frame_is_refused_unless_the_user_knows_better(tmp_path: Path) -> None:
    items = [
        ("/rgb/camera_info", INFO, 1, info_at(1)),
        ("/rgb/image", IMAGE, 1, color_at(1)),
        ("/depth/image", IMAGE, 1, depth_at(1, "depth_optical")),
    ]
    path = write_raw(tmp_path / "bag", items)
    (frame,) = open_source(path)
    assert isinstance(frame, BadFrame)
    assert "depth_optical" in frame.error
    assert "'optical'" in frame.error
    assert len(list(good_samples(open_source(path, assume_registered=True)))) == 1


def test_a_damaged_message_is_an_error_value_for_its_frame(tmp_path: Path) -> None:
    items = [
        ("/rgb/camera_info", INFO, 1, info_at(1)),
        ("/depth/image", IMAGE, 1, depth_at(1)),
        ("/depth/image", IMAGE, 2, depth_at(2)[:100]),
        ("/depth/image", IMAGE, 3, depth_at(3)),
    ]
    frames = list(open_source(write_raw(tmp_path / "bag", items)))
    assert [type(f) for f in frames] == [Sample, BadFrame, Sample]


def test_a_bag_without_calibration_or_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no camera_info"):
        open_source(write_raw(tmp_path / "a", [("/depth/image", IMAGE, 1, depth_at(1))]))
    with pytest.raises(DataError, match="no colour or depth images"):
        open_source(write_raw(tmp_path / "b", [("/rgb/camera_info", INFO, 1, info_at(1))]))


REALSENSE = {
    "/camera/camera/color/image_raw": IMAGE,
    "/camera/camera/color/camera_info": INFO,
    "/camera/camera/depth/image_rect_raw": IMAGE,
    "/camera/camera/depth/camera_info": INFO,
    "/camera/camera/aligned_depth_to_color/image_raw": IMAGE,
    "/camera/camera/aligned_depth_to_color/camera_info": INFO,
    "/camera/camera/infra1/image_rect_raw": IMAGE,
}
OAK = {
    "/oak/rgb/image_rect": IMAGE,
    "/oak/rgb/camera_info": INFO,
    "/oak/stereo/depth": IMAGE,
    "/oak/left/image_rect": IMAGE,
    "/oak/left/camera_info": INFO,
    "/oak/right/image_rect": IMAGE,
}


def test_topics_of_usual_cameras_are_found() -> None:
    chosen = choose_topics(REALSENSE)
    assert chosen.color == "/camera/camera/color/image_raw"
    assert chosen.depth == "/camera/camera/aligned_depth_to_color/image_raw"
    assert chosen.info == "/camera/camera/color/camera_info"
    chosen = choose_topics(OAK)
    assert (chosen.color, chosen.depth, chosen.info) == (
        "/oak/rgb/image_rect",
        "/oak/stereo/depth",
        "/oak/rgb/camera_info",
    )


def test_what_an_estimator_published_is_no_camera() -> None:
    results = {f"/estimator/{name}": IMAGE for name in ("labels", "layout", "furniture", "overlay")}
    results["/estimator/label_names"] = "std_msgs/msg/String"
    with pytest.raises(DataError, match=r"results of the estimator \(/estimator/furniture, .*no images of a camera"):
        choose_topics(results)
    camera = {"/head/image": IMAGE, "/head/camera_info": INFO}
    assert choose_topics(results | camera).color == "/head/image"
    assert choose_topics(results | camera, color_topic="/estimator/overlay").color == "/estimator/overlay"


def test_two_equal_cameras_are_not_guessed() -> None:
    two = {f"/{side}/color/image_raw": IMAGE for side in ("front", "back")} | {"/front/color/camera_info": INFO}
    with pytest.raises(DataError, match="--color-topic"):
        choose_topics(two)
    assert choose_topics(two, color_topic="/front/color/image_raw").info == "/front/color/camera_info"
    with pytest.raises(DataError, match="no image topic /nose"):
        choose_topics(two, color_topic="/nose")


def realsense(name: str) -> dict[str, str]:
    return {topic.replace("/camera/camera", f"/{name}/{name}_camera"): kind for topic, kind in REALSENSE.items()}


def streams(
    types: dict[str, str], color_topic: str | None = None, depth_topic: str | None = None
) -> tuple[str | None, str | None]:
    chosen = choose_topics(types, color_topic, depth_topic)
    return chosen.color, chosen.depth


def test_stereo_images_of_an_oak_are_depth_and_those_of_a_zed_are_none() -> None:
    oak = {"/oak/rgb/image_raw": IMAGE, "/oak/rgb/camera_info": INFO, "/oak/stereo/image_raw": IMAGE}
    assert streams(oak) == ("/oak/rgb/image_raw", "/oak/stereo/image_raw")
    zed = {f"/zed/zed_node/{name}/image_rect_color": IMAGE for name in ("rgb", "stereo")}
    assert streams(zed | {"/zed/zed_node/rgb/camera_info": INFO}) == ("/zed/zed_node/rgb/image_rect_color", None)


def test_a_camera_called_right_is_found_and_the_right_image_of_a_pair_passed_over() -> None:
    right = "/right/right_camera"
    found = (f"{right}/color/image_raw", f"{right}/aligned_depth_to_color/image_raw")
    assert streams(realsense("right")) == found
    pair = {f"/stereo/{side}/image_rect": IMAGE for side in ("left", "right")} | {"/stereo/left/camera_info": INFO}
    assert streams(pair) == ("/stereo/left/image_rect", None)
    with pytest.raises(DataError, match="several depth topics fit"):
        choose_topics(realsense("left") | realsense("right"))


def test_beside_a_stream_that_is_named_the_other_is_of_the_same_camera() -> None:
    two = realsense("left") | realsense("right")
    right = "/right/right_camera"
    color, depth = f"{right}/color/image_raw", f"{right}/aligned_depth_to_color/image_raw"
    assert streams(two, color_topic=color) == (color, depth)
    depth = f"{right}/depth/image_rect_raw"
    assert streams(two, depth_topic=depth) == (color, depth)
    front = realsense("front") | realsense("rear")
    color, depth = "/rear/rear_camera/color/image_raw", "/rear/rear_camera/depth/image_rect_raw"
    assert streams(front, depth_topic=depth) == (color, depth)
    tof = {"/rgb/image": IMAGE, "/rgb/camera_info": INFO, "/tof/range": IMAGE, "/tof/ir/image": IMAGE}
    assert streams(tof, depth_topic="/tof/range") == ("/rgb/image", "/tof/range"), "what is never taken hides nothing"


def test_depth_is_not_taken_from_a_jpeg_nor_from_a_transport_that_is_not_read() -> None:
    aligned = "/camera/aligned_depth_to_color/image_raw"
    bag = {"/camera/color/image_raw/compressed": messages.COMPRESSED, "/camera/color/camera_info": INFO}
    bag |= {f"{aligned}/{name}": messages.COMPRESSED for name in ("compressed", "compressedDepth", "zstd")}
    assert streams(bag) == ("/camera/color/image_raw/compressed", f"{aligned}/compressedDepth")


def without_info(tmp_path: Path) -> Path:
    items = [("/rgb/image", IMAGE, s, color_at(s)) for s in (1, 2)]
    return write_raw(tmp_path / "bag", items + [("/depth_registered/image", IMAGE, s, depth_at(s)) for s in (1, 2)])


def test_a_bag_without_camera_info_is_read_with_a_calibration_file(tmp_path: Path) -> None:
    bag, file = without_info(tmp_path), tmp_path / "camera.yaml"
    for open_it in (lambda: open_source(bag), lambda: choose_topics({"/rgb/image": IMAGE})):
        with pytest.raises(DataError, match=r"no camera_info belongs to .* give a calibration file with --camera"):
            open_it()
    calibration = CameraCalibration.from_intrinsics(SMALL)
    write_calibration(file, calibration)
    source = open_source(bag, camera=file)
    assert [s.frame.camera for s in good_samples(source)] == [SMALL, SMALL]
    assert calibration_of(source) == calibration


def test_a_calibration_file_takes_the_place_of_the_bags_camera_info(tmp_path: Path) -> None:
    other = replace(SMALL, fx=SMALL.fx + 7.0)
    file = tmp_path / "camera.yaml"
    write_calibration(file, CameraCalibration.from_intrinsics(other))
    items = [("/rgb/camera_info", INFO, 1, info_at(1)), ("/rgb/image", IMAGE, 1, color_at(1))]
    bag = write_raw(tmp_path / "bag", items)
    (sample,) = good_samples(open_source(bag, camera=file))
    assert sample.frame.camera == other
    with pytest.raises(DataError, match="takes the place of the camera_info; name no topic of one besides"):
        open_source(bag, camera=file, color_info_topic="/rgb/camera_info")
    with pytest.raises(DataError, match=r"none\.yaml is missing"):
        open_source(bag, camera=tmp_path / "none.yaml")


def test_a_topic_of_camera_info_that_is_empty_names_the_option(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        image, _ = (
            writer.add_connection(topic, kind, typestore=messages.typestore())
            for topic, kind in (("/rgb/image", IMAGE), ("/rgb/camera_info", INFO))
        )
        writer.write(image, 1, color_at(1))
    with pytest.raises(DataError, match=r"the camera is unknown \(give a calibration file with --camera"):
        list(open_source(tmp_path / "bag"))


def test_convert_takes_the_calibration_file_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, file, out = without_info(tmp_path), tmp_path / "camera.yaml", tmp_path / "folder"
    write_calibration(file, CameraCalibration.from_intrinsics(SMALL))
    assert main(["convert", str(bag), str(out), "--camera", str(file)]) == 0
    assert [s.frame.camera for s in good_samples(open_source(out))] == [SMALL, SMALL]
    capsys.readouterr()
    assert main(["convert", str(out), str(tmp_path / "b"), "--camera", str(file)]) == 2
    assert "--camera is for a bag" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"encoding": "yuv422"}, "encoding"),
        ({"step": 3}, "step 3"),
        ({"height": 0}, "each side"),
        ({"width": 2**31}, "each side"),
        ({"data": np.zeros(5, np.uint8)}, "5 bytes"),
    ],
)
def test_images_that_do_not_add_up_are_refused(change: dict[str, Any], words: str) -> None:
    message = messages.decode(color_at(1), IMAGE)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(DataError, match=words):
        messages.decode_color(message)


def test_binning_and_region_are_applied() -> None:
    message = messages.decode(info_at(1), INFO)
    message.binning_x = message.binning_y = 2
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 4, 6, 40, 30
    fx, cx, cy = SMALL.fx / 2, (SMALL.cx - 4 + 0.5) / 2 - 0.5, (SMALL.cy - 6 + 0.5) / 2 - 0.5
    assert messages.decode_calibration(message).intrinsics == CameraIntrinsics(20, 15, fx, SMALL.fy / 2, cx, cy)


def changed_info(change: str) -> Any:
    """A camera_info that the node refuses: no number of it says where the rectified image's rays go."""
    message = messages.decode(info_at(1), INFO)
    if change == "distorted without P":
        message.d, message.p = np.array([0.1, -0.2, 0, 0, 0]), np.zeros(12)
    elif change == "region beyond the image":
        message.roi.x_offset, message.roi.width, message.roi.height = 40, 40, 30
    else:
        message.k, message.p = np.zeros(9), np.zeros(12)
    return message


INFO_REFUSALS = {
    "distorted without P": "P of zeros",
    "region beyond the image": "must lie inside 64x48",
    "uncalibrated": "P of zeros",
}


@pytest.mark.parametrize("change", INFO_REFUSALS)
def test_a_camera_info_that_the_node_refuses_is_refused_in_a_bag(tmp_path: Path, change: str) -> None:
    raw = bytes(messages.typestore().serialize_cdr(changed_info(change), INFO))
    bad = ("/rgb/camera_info", INFO, 1, raw)
    with pytest.raises(DataError, match=rf"/rgb/camera_info: .*{INFO_REFUSALS[change]}.*--camera"):
        list(open_source(write_raw(tmp_path / "bag", [bad, ("/rgb/image", IMAGE, 1, color_at(1))])))


def test_a_folder_whose_camera_info_nobody_would_read_makes_no_bag(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_folder(tmp_path / "frames", make_samples(1, rng))
    bent = replace(CameraCalibration.from_intrinsics(SMALL), D=(0.1, 0.0, 0.0, 0.0, 0.0), P=(0.0,) * 12)
    write_calibration(folder / "camera.yaml", bent)
    assert len(list(good_samples(open_source(folder)))) == 1, "a folder says by K what its pixels are"
    assert main(["convert", str(folder), str(tmp_path / "bag")]) == 2
    assert "has distortion and no projection_matrix, which a camera_info needs then" in capsys.readouterr().err
    assert not (tmp_path / "bag" / "metadata.yaml").exists()


def test_a_bad_camera_info_on_the_way_spoils_its_frames_only(tmp_path: Path) -> None:
    raw = bytes(messages.typestore().serialize_cdr(changed_info("uncalibrated"), INFO))
    items = []
    for stamp, info in enumerate((raw, info_at(2), raw, info_at(4)), 1):
        items += [("/rgb/camera_info", INFO, 10 * stamp, info), ("/rgb/image", IMAGE, 10 * stamp + 1, color_at(stamp))]
    frames = list(open_source(write_raw(tmp_path / "bag", items)))
    assert [type(frame) for frame in frames] == [BadFrame, Sample, BadFrame, Sample]
    assert isinstance(frames[2], BadFrame)
    assert "/rgb/camera_info: camera_info has P of zeros" in frames[2].error


@pytest.mark.parametrize(
    ("encoding", "value", "words"), [("32FC1", 2000.0, "must be in metres"), ("16UC1", 2, "must be in millimetres")]
)
def test_depth_in_the_wrong_unit_is_refused(encoding: str, value: float, words: str) -> None:
    pixels = np.full((48, 64), value, np.float32 if encoding == "32FC1" else np.uint16)
    with pytest.raises(DataError, match=words):
        messages.decode_depth(messages.decode(messages.encode_image_message(pixels, encoding, 1, "optical"), IMAGE))


def compressed(content: bytes, form: str, stamp_ns: int) -> bytes:
    store = messages.typestore()
    message = store.types[messages.COMPRESSED](
        header=messages.decode(depth_at(stamp_ns), IMAGE).header, format=form, data=np.frombuffer(content, np.uint8)
    )
    return bytes(store.serialize_cdr(message, messages.COMPRESSED))


def test_compressed_colour_and_depth_are_read(tmp_path: Path, rng: np.random.Generator) -> None:
    color = rng.integers(0, 256, (48, 64, 3)).astype(np.uint8)
    depth_mm = rng.integers(0, 9000, (48, 64)).astype(np.uint16)
    items = [
        ("/rgb/camera_info", INFO, 1, info_at(1)),
        ("/rgb/image/compressed", messages.COMPRESSED, 1, compressed(encode_image(".png", color), "rgb8; png", 1)),
        (
            "/depth_registered/image/compressedDepth",
            messages.COMPRESSED,
            1,
            compressed(bytes(12) + encode_image(".png", depth_mm), "16UC1; compressedDepth png", 1),
        ),
    ]
    (sample,) = good_samples(open_source(write_raw(tmp_path / "bag", items)))
    np.testing.assert_array_equal(sample.frame.color, color)
    assert sample.frame.depth_m is not None
    np.testing.assert_array_equal(np.nan_to_num(sample.frame.depth_m * 1000).round(), depth_mm)


_FORMS = {".png": "png", ".jpg": "jpeg"}
ALIGNED = "/camera/aligned_depth_to_color/image_raw"


def with_depth_as_picture(path: Path, suffix: str, others: Sequence[str] = ()) -> Path:
    """A bag with image_transport's `compressed` of 2 m of depth, as PNG or JPEG."""
    depth_mm = np.full((48, 64), 2000, np.uint16)
    pixels = depth_mm if suffix == ".png" else (depth_mm >> 4).astype(np.uint8)
    picture, form = encode_image(suffix, pixels), f"16UC1; {_FORMS[suffix]} compressed "
    items = [
        ("/camera/color/camera_info", INFO, 1, info_at(1)),
        ("/camera/color/image_raw", IMAGE, 1, color_at(1)),
        (f"{ALIGNED}/compressed", messages.COMPRESSED, 1, compressed(picture, form, 1)),
    ]
    whole = compressed(bytes(12) + encode_image(".png", depth_mm), "16UC1; compressedDepth png", 1)
    kinds = {"": (IMAGE, depth_at(1)), "/compressedDepth": (messages.COMPRESSED, whole)}
    return write_raw(path, items + [(f"{ALIGNED}{end}", kinds[end][0], 1, kinds[end][1]) for end in others])


def test_depth_in_png_is_read_where_no_other_is(tmp_path: Path) -> None:
    """A camera whose image_transport is set to png for all it compresses: it was a bag without depth."""
    bag = with_depth_as_picture(tmp_path / "png", ".png")
    (sample,) = good_samples(open_source(bag))
    assert sample.frame.depth_m is not None
    assert (sample.frame.depth_m == 2.0).all()
    for i, others in enumerate(([""], ["/compressedDepth"], ["", "/compressedDepth"])):
        source = open_source(with_depth_as_picture(tmp_path / str(i), ".png", others))
        assert isinstance(source, BagSource)
        assert source.topics.depth == f"{ALIGNED}{others[0]}"


def test_depth_in_png_is_read_though_the_first_image_is_damaged(tmp_path: Path) -> None:
    picture = encode_image(".png", np.full((48, 64), 2000, np.uint16))
    items = []
    for stamp, content in ((1, picture[:60]), (2 * 10**9, picture)):
        depth = compressed(content, "16UC1; png compressed ", stamp)
        items += [
            ("/camera/color/camera_info", INFO, stamp, info_at(stamp)),
            ("/camera/color/image_raw", IMAGE, stamp, color_at(stamp)),
            (f"{ALIGNED}/compressed", messages.COMPRESSED, stamp, depth),
        ]
    source = open_source(write_raw(tmp_path / "bag", items))
    assert isinstance(source, BagSource)
    assert source.topics.depth == f"{ALIGNED}/compressed"
    (sample,) = good_samples(source)
    assert sample.frame.stamp_ns == 2 * 10**9


def test_a_jpeg_of_depth_is_passed_over_with_a_word(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = with_depth_as_picture(tmp_path / "jpg", ".jpg")
    (sample,) = good_samples(open_and_tell(bag))
    assert sample.frame.depth_m is None
    said = f"{ALIGNED}/compressed is not read: depth image has format '16UC1; jpeg compressed '; allowed are 16UC1"
    assert capsys.readouterr().err.startswith(said)
    open_and_tell(with_depth_as_picture(tmp_path / "both", ".jpg", ["/compressedDepth"]))
    assert capsys.readouterr().err == "", "there is depth"


def test_a_ros_1_bag_is_told_how_to_be_read(tmp_path: Path) -> None:
    (tmp_path / "walk.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(DataError, match=r"is a ROS 1 bag; rosbags-convert --src .*walk.bag --dst walk makes a rosbag2"):
        open_source(tmp_path / "walk.bag")


@pytest.mark.parametrize("make", [color_at, depth_at, info_at])
def test_mutated_messages_end_as_data_errors(make: Any, rng: np.random.Generator) -> None:
    """Whatever the bytes are: a message, an image, or one sentence."""
    whole = np.frombuffer(make(5), np.uint8)
    kind = INFO if make is info_at else IMAGE
    refused = 0
    for _ in range(400):
        raw = whole.copy()
        raw[rng.integers(0, min(120, raw.size), 4)] = rng.integers(0, 256, 4)
        try:
            message = messages.decode(raw[: rng.integers(1, raw.size + 1)].tobytes(), kind)
            if kind == INFO:
                _ = messages.decode_calibration(message).intrinsics
            else:
                (messages.decode_color if make is color_at else messages.decode_depth)(message)
        except DataError:
            refused += 1
    assert refused > 100


def test_compressed_float_depth_is_read(tmp_path: Path) -> None:
    """compressedDepth of 32FC1 is inverse depth in steps: z = A / (step - B)."""
    a, b = 1000.0, 5.0
    steps = np.arange(10, 10 + 48 * 64, dtype=np.uint16).reshape(48, 64)
    content = b"\0" * 4 + np.array([a, b], "<f4").tobytes() + encode_image(".png", steps)
    raw = compressed(content, "32FC1; compressedDepth png", 1)
    depth_m = messages.decode_depth(messages.decode(raw, messages.COMPRESSED))
    np.testing.assert_allclose(depth_m, a / (steps - b), rtol=1e-6)


def test_a_compressed_picture_that_unfolds_to_gigabytes_is_refused() -> None:
    content = bytearray(encode_image(".png", np.zeros((4, 4, 3), np.uint8)))
    content[16:24] = (8000).to_bytes(4, "big") * 2
    message = messages.decode(compressed(bytes(content), "rgb8; png", 1), messages.COMPRESSED)
    with pytest.raises(DataError, match=r"8000x8000; .* at most 32000000 pixels"):
        messages.decode_color(message)
