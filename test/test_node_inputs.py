"""Inputs as robots have them: compressed, unregistered, without camera_info, with TF and IMU."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from dds_player import camera_info
from fake_tf import FakeBuffer, install
from node_bench import Bench, running
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from room_frames import CAMERA, FRAME_ID, room_frame, room_images, stamp_ns

from msg_adapters import messages
from msg_adapters.encode_image import encode_image, pack_bytes
from msg_adapters.header import encode_header
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.registration import register_depth
from room_layout_ros.datasets.calibration import CameraCalibration, write_calibration
from room_layout_ros.estimator_node import EstimatorNode
from room_layout_ros.inputs import INPUT_TOPICS
from room_layout_ros.node_config import parse_pose

pytestmark = pytest.mark.dds

POSE = "0.05 0 0 0 0 0.01 1"
DEPTH_FRAME = "camera_depth_optical_frame"


def compressed(content: NDArray[np.uint8], kind: str, stamp: int, frame_id: str = FRAME_ID) -> Any:
    return messages.CompressedImage(header=encode_header(stamp, frame_id), format=kind, data=pack_bytes(content))


def compressed_color(i: int) -> Any:
    picture = cv2.imencode(".png", room_images(i)[0][..., ::-1])[1]
    return compressed(picture, "rgb8; png compressed bgr8", stamp_ns(i))


def compressed_depth(i: int) -> Any:
    picture = cv2.imencode(".png", room_images(i)[1])[1]
    header = np.frombuffer(struct.pack("<iff", 0, 0.0, 0.0), np.uint8)
    return compressed(np.concatenate([header, picture.ravel()]), "16UC1; compressedDepth png", stamp_ns(i))


def depth_as_picture(i: int) -> Any:
    return compressed(cv2.imencode(".png", room_images(i)[1])[1], "16UC1; png compressed ", stamp_ns(i))


def compress_cameras(bench: Bench, depth: str = "compressedDepth") -> None:
    """Let the bench publish compressed images in the place of raw ones."""
    for stream, topic in (
        ("color", "rgb/image_rect_color/compressed"), ("depth", f"depth_registered/image_rect/{depth}"),
    ):  # fmt: skip
        bench.other.destroy_publisher(bench.cameras[stream])
        bench.cameras[stream] = bench.other.create_publisher(messages.CompressedImage, topic, QoSProfile(depth=10))


@pytest.mark.parametrize(
    ("transport", "depth"), (("compressedDepth", compressed_depth), ("compressed", depth_as_picture))
)
def test_compressed_images_give_the_same_frame_as_raw_ones(transport: str, depth: Callable[[int], Any]) -> None:
    with running(color_transport="compressed", depth_transport=transport) as bench:
        compress_cameras(bench, transport)
        bench.connect()
        bench.send(0, compressed_color(0), depth(0))
        bench.until(lambda: bench.labels_of(0))
        frame, offline = bench.estimators[0].frames[-1], room_frame(0)
        np.testing.assert_array_equal(frame.color, offline.color)
        np.testing.assert_array_equal(frame.depth_m, offline.depth_m)


def test_the_transport_can_change_while_it_runs() -> None:
    with running() as bench:
        bench.connect()
        bench.expect(0)
        change = [
            Parameter("color_transport", value="compressed"),
            Parameter("depth_transport", value="compressedDepth"),
        ]
        assert bench.node.set_parameters_atomically(change).successful
        compress_cameras(bench)
        bench.until_subscribed()
        bench.send(1, compressed_color(1), compressed_depth(1))
        bench.until(lambda: bench.labels_of(1))


@pytest.mark.parametrize(
    ("published", "subscribed", "depth"),
    (("raw", "compressed", "compressedDepth"), ("compressed", "raw", "raw")),
)
def test_f01_a_stream_that_comes_by_another_transport_is_said_with_topic_and_parameter(
    published: str, subscribed: str, depth: str
) -> None:
    with running(no_data_timeout=0.5, color_transport=subscribed, depth_transport=depth) as bench:
        if published == "compressed":
            compress_cameras(bench)
        bench.listen("estimator/labels", messages.Image)
        for name, stream, kinds in (
            ("colour", "color", {"raw": "", "compressed": "/compressed"}),
            ("depth", "depth", {"raw": "", "compressed": "/compressedDepth"}),
        ):
            topic = f"{bench.namespace}/{INPUT_TOPICS[stream]}"
            there = f"{topic}{kinds[published]}"
            kind = kinds[published].strip("/") or "raw"
            words = f"on {topic}{kinds[subscribed]}; nobody publishes it, but {there} is there; set {stream}_transport"
            bench.until(partial(bench.said, f"input {name}", f"{words} to {kind}"))


def test_a_damaged_compressed_image_is_refused_and_the_next_works() -> None:
    with running(color_transport="compressed", depth_transport="compressedDepth") as bench:
        compress_cameras(bench)
        bench.connect()
        cut = compressed_color(0)
        cut.data = cut.data[:-100]
        bench.send(0, cut, compressed_depth(0))
        bench.until(lambda: bench.said("input colour", "compressed colour image of", "is cut"))
        damaged = compressed_depth(1)
        damaged.data[200:260] = damaged.data[100:160]
        bench.send(1, compressed_color(1), damaged)
        bench.until(lambda: bench.said("estimates", "damaged and does not decode"))
        bench.send(2, compressed_color(2), compressed_depth(2))
        bench.until(lambda: bench.labels_of(2))


def test_a_calibration_file_takes_the_place_of_camera_info(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    write_calibration(path, CameraCalibration.from_intrinsics(CAMERA))
    with running(camera_file=str(path)) as bench:
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.cameras["color"].get_subscription_count())
        bench.until(lambda: bench.cameras["depth"].get_subscription_count())
        bench.spin(0.2)
        assert bench.cameras["camera_info"].get_subscription_count() == 0
        bench.send(0, info=False)
        bench.until(lambda: bench.labels_of(0))
        assert bench.estimators[0].frames[-1].camera == CAMERA
        assert bench.diagnosis()["input camera_info"] == (0, "camera_info is not used (parameter)")
        assert bench.health().streams["camera_info"].received == 0, "none came"


BENT = "has distortion but the same K and P, or no P; if the images are not rectified, the room will be bent"

OTHER_SIZE = (
    f"has its principal point at (0.5, 0.5), far from the middle of {CAMERA.width}x{CAMERA.height}; "
    "are fx, fy, cx and cy of images of this size, in pixels?"
)


@pytest.mark.parametrize(
    ("changes", "warning"),
    (
        ({}, ""),
        ({"D": (0.1, 0.0, 0.0, 0.0, 0.0)}, BENT),
        ({"D": (0.1, 0.0, 0.0, 0.0, 0.0), "P": (0.0,) * 12}, BENT),
        ({"D": (0.1, 0.0, 0.0, 0.0, 0.0), "K": (530.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0)}, ""),
        ({"K": (0.8, 0.0, 0.5, 0.0, 1.1, 0.5, 0.0, 0.0, 1.0), "P": (0.0,) * 12}, OTHER_SIZE),
    ),
    ids=("no distortion", "K and P are equal", "no P", "rectified", "of another size"),
)
def test_a_calibration_file_gets_the_warning_that_camera_info_gets(
    tmp_path: Path, changes: dict[str, Any], warning: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "camera.yaml"
    write_calibration(path, replace(CameraCalibration.from_intrinsics(CAMERA), **changes))
    with running(camera_file=str(path)) as bench:
        bench.spin(0.1)
    said = [line for line in capfd.readouterr().err.splitlines() if str(path) in line and "[WARN]" in line]
    assert [line.partition(f"{path} ")[2] for line in said] == ([warning] if warning else [])


def bent_info(i: int) -> Any:
    info = camera_info(stamp_ns(i))
    info.d = [0.1, 0.0, 0.0, 0.0, 0.0]
    return info


BENT_TOPIC = "camera_info has distortion but the same K and P; if the images are not rectified, the room will be bent"


def test_images_that_may_be_bent_are_a_warning_on_diagnostics_and_one_line_in_the_log(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with running() as bench:
        bench.connect()
        bench.send(0, info=bent_info(0))
        bench.until(lambda: bench.labels_of(0))
        bench.until(lambda: bench.diagnosis()["input camera_info"] == (1, BENT_TOPIC))
        bench.spin(0.5)
        bench.expect(1)
        bench.until(lambda: bench.well("input camera_info"))
    assert capfd.readouterr().err.count(BENT_TOPIC) == 1


def test_a_calibration_file_of_a_bent_camera_is_a_warning_on_diagnostics(tmp_path: Path) -> None:
    color, depth = tmp_path / "color.yaml", tmp_path / "depth.yaml"
    for path in (color, depth):
        write_calibration(path, replace(CameraCalibration.from_intrinsics(CAMERA), D=(0.1, 0.0, 0.0, 0.0, 0.0)))
    files: dict[str, Any] = {"camera_file": str(color), "depth_camera_file": str(depth)}
    with running(lazy_inputs=False, depth_registered=False, **files) as bench:
        for name, path in (("input camera_info", color), ("input camera_info of depth", depth)):
            bench.until(partial(bench.said, name, f"{path} {BENT}"))


def test_f14_a_camera_info_of_another_frame_is_a_warning_with_both_frames_once_it_lasts() -> None:
    """It has the size of the images, and is that of another camera: nothing else would tell."""

    def infrared(i: int) -> Any:
        info = camera_info(stamp_ns(i))
        info.header.frame_id = "infrared"
        return info

    words = f"camera_info is in frame 'infrared' and its images in frame '{FRAME_ID}'; is it that of another camera?"
    with running() as bench:
        bench.connect()
        bench.send(0, info=infrared(0))
        bench.until(lambda: bench.labels_of(0))
        bench.spin(0.3)
        assert bench.well("input camera_info"), "not yet"
        bench.until(lambda: bench.diagnosis()["input camera_info"] == (1, words))
        bench.expect(30)
        bench.until(lambda: bench.well("input camera_info"))


def test_depth_in_the_frame_of_colour_needs_no_transform() -> None:
    with running(depth_registered=False) as bench:
        bench.connect()
        add_depth_camera(bench).publish(depth_info(0))
        bench.until(lambda: bench.health().streams["depth_camera_info"].received)
        bench.send(0, depth=unregistered(0, FRAME_ID))
        bench.until(lambda: bench.labels_of(0))
        np.testing.assert_array_equal(bench.estimators[0].frames[-1].depth_m, registered(0, "0 0 0 0 0 0 1"))


def unregistered(i: int, frame_id: str = DEPTH_FRAME) -> Any:
    """Return a depth image of half the size in a frame of its own."""
    half = np.ascontiguousarray(room_images(i)[1][::2, ::2])
    return encode_image(half, stamp_ns(i), frame_id)


def depth_info(i: int) -> Any:
    info = camera_info(stamp_ns(i))
    info.header.frame_id = DEPTH_FRAME
    info.width, info.height = 320, 240
    info.k = [CAMERA.fx / 2, 0.0, CAMERA.cx / 2, 0.0, CAMERA.fy / 2, CAMERA.cy / 2, 0.0, 0.0, 1.0]
    info.p = [CAMERA.fx / 2, 0.0, CAMERA.cx / 2, 0.0, 0.0, CAMERA.fy / 2, CAMERA.cy / 2, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


def registered(i: int, pose: str) -> NDArray[np.float32]:
    half = CameraIntrinsics(320, 240, CAMERA.fx / 2, CAMERA.fy / 2, CAMERA.cx / 2, CAMERA.cy / 2)
    mm = room_images(i)[1][::2, ::2]
    depth_m = mm.astype(np.float32) * np.float32(0.001)
    return register_depth(depth_m, half, CAMERA, parse_pose(pose))


def add_depth_camera(bench: Bench) -> Any:
    publisher = bench.camera("depth_camera_info", QoSProfile(depth=10))
    bench.until(publisher.get_subscription_count)
    bench.spin(0.2)
    return publisher


def test_unregistered_depth_is_registered_by_the_pose_that_is_given() -> None:
    with running(depth_registered=False, depth_to_color=POSE) as bench:
        bench.connect()
        add_depth_camera(bench).publish(depth_info(0))
        bench.until(lambda: bench.health().streams["depth_camera_info"].received)
        bench.send(0, depth=unregistered(0))
        bench.until(lambda: bench.labels_of(0))
        frame = bench.estimators[0].frames[-1]
        assert (frame.frame_id, frame.camera, frame.stamp_ns) == (FRAME_ID, CAMERA, stamp_ns(0))
        np.testing.assert_array_equal(frame.depth_m, registered(0, POSE))


def own_view(bench: Bench, streams: tuple[str, ...]) -> None:
    """Listen to ~/labels; the node subscribes `streams` alone."""
    bench.listen("estimator/labels", messages.Image)
    bench.until(lambda: all(bench.cameras[s].get_subscription_count() for s in streams))
    bench.spin(0.2)
    assert {s for s, camera in bench.cameras.items() if camera.get_subscription_count()} == set(streams)


OWN_VIEW: dict[str, Any] = {"use_color": False, "depth_registered": False}
DEPTH_CAMERA = replace(CAMERA, fx=380.0, fy=380.0)
"""Of depth in its own view: another than the colour camera's (fx 525)."""


def test_depth_alone_in_its_own_view_has_the_depth_cameras_intrinsics() -> None:
    with running(**OWN_VIEW) as bench:
        bench.cameras["depth_camera_info"] = bench.camera("depth_camera_info", QoSProfile(depth=10))
        own_view(bench, ("depth", "depth_camera_info"))
        bench.send(0, color=False, depth=encode_image(room_images(0)[1], stamp_ns(0), DEPTH_FRAME))
        bench.until(lambda: bench.said("estimates", "no camera_info of the depth camera has come yet"))
        info = camera_info(stamp_ns(1))
        info.k = [380.0, 0.0, CAMERA.cx, 0.0, 380.0, CAMERA.cy, 0.0, 0.0, 1.0]
        info.p = [380.0, 0.0, CAMERA.cx, 0.0, 0.0, 380.0, CAMERA.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
        bench.cameras["depth_camera_info"].publish(info)
        bench.until(lambda: bench.health().streams["depth_camera_info"].received)
        bench.send(1, color=False, depth=encode_image(room_images(1)[1], stamp_ns(1), DEPTH_FRAME))
        bench.until(lambda: bench.labels_of(1))
        frame = bench.estimators[0].frames[-1]
        assert (frame.camera, frame.frame_id, frame.color) == (DEPTH_CAMERA, DEPTH_FRAME, None)
        np.testing.assert_array_equal(frame.depth_m, room_frame(1).depth_m)
        assert bench.diagnosis()["input camera_info"] == (0, "camera_info is not used (parameter)")


def test_a_calibration_file_takes_the_place_of_the_depth_cameras_camera_info(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "depth.yaml"
    bent = replace(CameraCalibration.from_intrinsics(DEPTH_CAMERA), D=(0.1, 0.0, 0.0, 0.0, 0.0))
    write_calibration(path, bent)
    with running(depth_camera_file=str(path), **OWN_VIEW) as bench:
        own_view(bench, ("depth",))
        bench.send(0, color=False, info=False)
        bench.until(lambda: bench.labels_of(0))
        assert bench.estimators[0].frames[-1].camera == DEPTH_CAMERA
    assert f"{path} {BENT}" in capfd.readouterr().err


def test_depth_is_registered_by_the_calibration_files_of_both_cameras(tmp_path: Path) -> None:
    color, depth = tmp_path / "color.yaml", tmp_path / "depth.yaml"
    half = CameraIntrinsics(320, 240, CAMERA.fx / 2, CAMERA.fy / 2, CAMERA.cx / 2, CAMERA.cy / 2)
    write_calibration(color, CameraCalibration.from_intrinsics(CAMERA))
    write_calibration(depth, CameraCalibration.from_intrinsics(half))
    files: dict[str, Any] = {"camera_file": str(color), "depth_camera_file": str(depth)}
    with running(depth_registered=False, depth_to_color=POSE, **files) as bench:
        own_view(bench, ("color", "depth"))
        bench.send(0, depth=unregistered(0), info=False)
        bench.until(lambda: bench.labels_of(0))
        frame = bench.estimators[0].frames[-1]
        assert frame.camera == CAMERA
        np.testing.assert_array_equal(frame.depth_m, registered(0, POSE))


def test_a_depth_camera_file_that_is_none_ends_the_start_in_one_sentence(tmp_path: Path) -> None:
    missing = tmp_path / "none.yaml"
    with pytest.raises(ValueError, match=r"none\.yaml is missing"), running(depth_camera_file=str(missing)):
        pass


def test_unregistered_depth_without_a_transform_is_refused_with_both_frames() -> None:
    with running(depth_registered=False) as bench:
        bench.connect()
        publisher = add_depth_camera(bench)
        bench.send(0, depth=unregistered(0))
        bench.until(lambda: bench.said("estimates", "no camera_info of the depth camera"))
        publisher.publish(depth_info(1))
        bench.until(lambda: bench.health().streams["depth_camera_info"].received)
        bench.send(1, depth=unregistered(1))
        bench.until(lambda: bench.said("estimates", f"no transform from depth frame '{DEPTH_FRAME}'", FRAME_ID))
        assert bench.node.set_parameters([Parameter("depth_to_color", value=POSE)])[0].successful
        bench.send(2, depth=unregistered(2))
        bench.until(lambda: bench.labels_of(2))


@pytest.fixture
def tf(monkeypatch: pytest.MonkeyPatch) -> FakeBuffer:
    return install(monkeypatch)


def test_unregistered_depth_is_registered_by_tf(tf: FakeBuffer) -> None:
    tf.add(FRAME_ID, DEPTH_FRAME, POSE)
    with running(depth_registered=False) as bench:
        bench.connect()
        add_depth_camera(bench).publish(depth_info(0))
        bench.until(lambda: bench.health().streams["depth_camera_info"].received)
        bench.send(0, depth=unregistered(0))
        bench.until(lambda: bench.labels_of(0))
        np.testing.assert_array_equal(bench.estimators[0].frames[-1].depth_m, registered(0, POSE))


def said(bench: Bench, key: str, name: str = "floor") -> str:
    """Return a value of the newest diagnostic of a name; "" where it has none."""
    statuses = bench.heard["/diagnostics"][-1].status
    return next((v.value for s in statuses if s.name.endswith(f": {name}") for v in s.values if v.key == key), "")


def test_diagnostics_say_where_the_pose_of_the_depth_camera_comes_from() -> None:
    with running(depth_registered=False) as bench:
        bench.until(lambda: bench.heard["/diagnostics"] and said(bench, "extrinsics", "input depth") == "TF")
        assert bench.node.set_parameters([Parameter("depth_to_color", value=POSE)])[0].successful
        bench.until(lambda: said(bench, "extrinsics", "input depth") == "parameter depth_to_color")
        assert bench.node.set_parameters([Parameter("use_color", value=False)])[0].successful
        bench.until(lambda: said(bench, "extrinsics", "input depth") == "")


@pytest.mark.parametrize(("use_depth", "words"), ((True, "yes"), (False, "no (front wall is 1)")))
def test_diagnostics_say_whether_the_room_is_in_metres(use_depth: bool, words: str) -> None:
    with running(use_depth=use_depth) as bench:
        own_view(bench, ("color", "depth", "camera_info") if use_depth else ("color", "camera_info"))
        assert said(bench, "metric", "estimates") == ""
        bench.send(0, depth=None if use_depth else False)
        bench.until(lambda: bench.labels_of(0))
        bench.until(lambda: said(bench, "metric", "estimates") == words)


def test_auto_says_that_tf_is_there_and_does_not_know_the_robot() -> None:
    make = partial(EstimatorNode, cli_args=["--ros-args", "-r", "/tf:=/t1", "-r", "/tf_static:=/t2"])
    with running(make) as bench:
        bench.connect()
        bench.expect(0)
        bench.until(lambda: "no transform" in said(bench, "expected"))
        assert "TF is there" not in bench.diagnosis()["floor"][1], "nobody publishes TF"
        driver = bench.other.create_publisher(messages.String, "/t2", 1)
        words = f"TF is there, but no transform between 'base_footprint' and '{FRAME_ID}' is known"
        bench.until(lambda: bench.diagnosis()["floor"][1].startswith(words))
        assert bench.well("floor")
        bench.other.destroy_publisher(driver)
        bench.node.create_publisher(messages.String, "/t1", 1)  # as the node's own broadcaster is
        bench.until(lambda: "TF is there" not in bench.diagnosis()["floor"][1])


FLOOR_GIVEN: dict[str, Any] = {"pose_source": "parameters", "camera_height": 1.3}
LEVEL = "0 0.3 0.1 0.5 -0.5 0.5 0.5"
NODDING = "0 0.3 0.1 0.547419 -0.547419 0.447585 0.447585"
"""The pose of the robot in the camera's frame: as LEVEL, the camera looking 0.2 rad down."""


def test_gravity_comes_from_tf(tf: FakeBuffer) -> None:
    """A camera that looks ahead, level: the robot's z axis is the camera's -y."""
    tf.add(FRAME_ID, "base_footprint", LEVEL)
    with running() as bench:
        bench.connect()
        bench.expect(0)
        prior = bench.estimators[0].priors[-1]
        np.testing.assert_allclose(prior.gravity, [0.0, 1.0, 0.0], atol=1e-9)
        bench.until(lambda: said(bench, "expected") == "tf")
        assert said(bench, "transforms") == ""


def test_gravity_is_that_of_the_frames_time_not_the_newest(tf: FakeBuffer) -> None:
    """The camera nods between the frames: each gets the pose of its own time."""
    tf.add(FRAME_ID, "base_footprint", LEVEL, stamp_ns(1))
    tf.add(FRAME_ID, "base_footprint", NODDING, stamp_ns(2))
    with running() as bench:
        bench.connect()
        for i in (1, 2):
            bench.expect(i)
        level, nodding = (prior.gravity for prior in bench.estimators[0].priors[-2:])
        np.testing.assert_allclose(level, [0.0, 1.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(nodding, [0.0, np.cos(0.2), np.sin(0.2)], atol=1e-5)
        bench.until(lambda: said(bench, "expected") == "tf")
        assert said(bench, "transforms") == ""


def test_the_newest_pose_is_used_and_told_where_tf_lags_behind_the_frame(tf: FakeBuffer) -> None:
    tf.add(FRAME_ID, "base_footprint", LEVEL, stamp_ns(0))
    tf.add(FRAME_ID, "base_footprint", NODDING, stamp_ns(1))
    with running() as bench:
        bench.connect()
        bench.expect(4)
        np.testing.assert_allclose(bench.estimators[0].priors[-1].gravity[2], np.sin(0.2), atol=1e-5)
        bench.until(lambda: said(bench, "transforms"))
        words = f"base_footprint to {FRAME_ID}: 1 times not known at the frame's time, the newest was used"
        bench.until(lambda: said(bench, "transforms") == f"{words} (last 0.100 s older)")


def scan(bench: Bench, first: int) -> list[Any]:
    """Return the scans of frames from number `first` on, sent until the node knows that somebody listens."""
    bench.listen("estimator/scan", messages.LaserScan)
    for i in range(first, first + 100):
        bench.expect(i)
        bench.spin(0.1)
        if bench.heard["estimator/scan"]:
            break
    return bench.heard["estimator/scan"]


def test_the_floor_frame_is_broadcast_while_somebody_listens_to_a_topic_on_it(tf: FakeBuffer) -> None:
    with running(**FLOOR_GIVEN) as bench:
        bench.connect()
        bench.expect(0)
        assert not tf.sent
        scans = scan(bench, 1)
        bench.until(lambda: tf.sent)
        assert (tf.sent[0].header.frame_id, tf.sent[0].child_frame_id) == (FRAME_ID, f"{FRAME_ID}_floor")
        bench.until(lambda: said(bench, "frame") == f"{FRAME_ID}_floor")
        assert tf.sent[0].header.stamp == scans[0].header.stamp


def test_the_cameras_own_frame_is_no_floor_frame() -> None:
    with running(floor_frame=FRAME_ID) as bench:
        bench.connect()
        bench.send(0)
        bench.until(lambda: bench.said("estimates", f"floor_frame is '{FRAME_ID}', which is the camera's own frame"))
        assert not bench.labels_of(0)
        assert bench.node.set_parameters([Parameter("floor_frame", value="floor")])[0].successful
        bench.expect(1)


def test_the_robots_frame_is_no_floor_frame_at_the_start_and_while_it_runs() -> None:
    with pytest.raises(ValueError, match="which is robot_frame too"), running(floor_frame="base_footprint"):
        pass
    with (
        pytest.raises(ValueError, match="must be below robot_height_m"),
        running(robot_height_m=0.1, obstacle_min_height_m=0.1),
    ):
        pass
    with running() as bench:
        for values, words in (
            ({"floor_frame": "base_footprint"}, "floor_frame is 'base_footprint', which is robot_frame too"),
            ({"robot_height_m": 0.1, "obstacle_min_height_m": 0.1}, "must be below robot_height_m, which is 0.1 m"),
        ):
            result = bench.node.set_parameters_atomically([Parameter(n, value=v) for n, v in values.items()])
            assert not result.successful
            assert words in result.reason
        assert bench.node.get_parameter("floor_frame").value == ""
        assert bench.node.set_parameters([Parameter("robot_frame", value=f"{FRAME_ID}_floor")])[0].successful
        bench.connect()
        bench.send(0)
        bench.until(lambda: bench.said("estimates", f"the floor's frame is '{FRAME_ID}_floor', which is robot_frame"))
        assert not bench.labels_of(0)


def test_images_without_a_frame_id_are_named() -> None:
    with running() as bench:
        bench.connect()
        rgb, mm = room_images(0)
        bench.send(0, encode_image(rgb, stamp_ns(0), ""), encode_image(mm, stamp_ns(0), ""))
        bench.until(lambda: bench.said("estimates", "images have an empty frame_id"))
        bench.expect(1)
        bench.until(lambda: bench.well("estimates"))


def test_two_nodes_in_namespaces_of_their_own_do_not_mix(tf: FakeBuffer) -> None:
    with (
        running(floor_frame="left_floor", **FLOOR_GIVEN) as left,
        running(floor_frame="right_floor", **FLOOR_GIVEN) as right,
    ):
        for bench in (left, right):
            bench.connect()
        assert {m.header.frame_id for m in scan(left, 1)} == {"left_floor"}
        assert {m.header.frame_id for m in scan(right, 1001)} == {"right_floor"}
        left.spin(0.2)
        assert {t.child_frame_id for t in tf.sent} == {"left_floor", "right_floor"}
        assert not left.labels_of(1001)
        assert not right.labels_of(1)


def test_without_tf_the_floor_decides() -> None:
    with running() as bench:
        bench.connect()
        bench.expect(0)
        assert bench.estimators[0].priors[-1] is None
        words = f"estimate (no transform between 'base_footprint' and '{FRAME_ID}' is known"
        bench.until(lambda: said(bench, "expected").startswith(words))
        bench.until(lambda: bench.well("floor"))


def test_tf_that_was_asked_for_and_does_not_know_the_robot_is_a_warning_with_both_frames() -> None:
    with running(pose_source="tf", robot_frame="base") as bench:
        bench.connect()
        bench.expect(0)
        words = f"pose_source is tf, but no transform between 'base' and '{FRAME_ID}' is known"
        bench.until(lambda: bench.said("floor", words))
        assert bench.node.set_parameters([Parameter("pose_source", value="estimate")])[0].successful
        bench.until_subscribed()
        bench.expect(1)
        bench.until(lambda: bench.well("floor"))


def frames_of_floor(bench: Bench, depth: Any, first: int) -> list[Any]:
    """Send frames until the node has counted two of which somebody wants the floor; return the scans."""
    before = bench.health().floors
    for i in range(first, first + 100):
        bench.send(i, depth=depth(i))
        bench.spin(0.1)
        if bench.health().floors >= before + 2:
            break
    return bench.heard["estimator/scan"]


def test_f06_frames_without_a_floor_are_counted_and_said_while_somebody_listens() -> None:
    def thin(i: int) -> Any:  # 1 of 100 pixels has depth: a room, to the made-up estimator, but no floor
        mm = room_images(i)[1]
        mm[np.arange(mm.size).reshape(mm.shape) % 100 > 0] = 0
        return encode_image(mm, stamp_ns(i), FRAME_ID)

    with running(**FLOOR_GIVEN) as bench:
        bench.connect()
        bench.send(0, depth=thin(0))
        bench.until(lambda: bench.labels_of(0))
        bench.spin(0.3)
        assert bench.well("floor"), "nobody wants the floor"
        bench.listen("estimator/scan", messages.LaserScan)
        assert not frames_of_floor(bench, thin, 1)
        bench.until(lambda: bench.said("floor", "no floor (too little depth) for", "send nothing"))
        health = bench.health()
        assert health.no_floor == {"too little depth": health.floors}
        assert frames_of_floor(bench, lambda i: None, 200)
        bench.until(lambda: said(bench, "source").startswith("parameters"))
        bench.until(lambda: bench.well("floor"))


def test_f06_without_depth_the_outputs_of_the_floor_say_why_they_are_silent() -> None:
    with running(use_depth=False, **FLOOR_GIVEN) as bench:
        bench.listen("estimator/scan", messages.LaserScan)
        bench.until(lambda: bench.cameras["color"].get_subscription_count())
        bench.until(lambda: bench.cameras["camera_info"].get_subscription_count())
        bench.spin(0.2)
        assert not frames_of_floor(bench, lambda i: False, 0)
        bench.until(lambda: bench.said("floor", "no floor (use_depth is false) for"))


@pytest.mark.parametrize("height", (0.0, 1.3))
def test_a_camera_height_that_is_not_given_is_said_to_be_of_the_depth(height: float) -> None:
    estimator: Any = LayoutEstimator
    with running(estimator=estimator, pose_source="parameters", camera_pitch_deg=6.0, camera_height=height) as bench:
        bench.listen("estimator/free_space", messages.OccupancyGrid)
        bench.until(lambda: bench.cameras["color"].get_subscription_count(), 60.0)
        bench.until_subscribed()
        bench.send(0)
        taken = "" if height else "; its height is taken from the depth: camera_height is 0 (not known)"
        bench.until(lambda: bench.diagnosis()["floor"] == (0, f"floor from parameters+depth{taken}"))


def test_d03_a_wrong_tilt_without_a_height_is_asked_for_and_loses_no_frame() -> None:
    """The floor that is seen lies above a camera that is said to hang upside down: no plane, no exception."""
    with running(pose_source="parameters", camera_pitch_deg=6.0, camera_roll_deg=180.0) as bench:
        bench.connect()
        bench.listen("estimator/scan", messages.LaserScan)
        assert not frames_of_floor(bench, lambda i: None, 0)
        tilt = "is the tilt that parameters gives right (camera_pitch_deg, camera_roll_deg)?"
        bench.until(lambda: bench.said("floor", "no floor (nothing level below the camera) for", tilt))
        assert said(bench, "height") == "taken from the depth: camera_height is 0 (not known)"
        assert bench.health().dropped.keys() <= {"newer frame"}
        assert bench.node.set_parameters([Parameter("camera_roll_deg", value=0.0)])[0].successful
        frames_of_floor(bench, lambda i: None, 200)
        sure = "no floor (none in view for sure, none given) for"  # to the made-up estimator the crate is no thing
        bench.until(lambda: bench.said("floor", sure))


def test_depth_of_another_unit_is_a_question_on_diagnostics_and_in_the_log(capfd: pytest.CaptureFixture[str]) -> None:
    with running(max_depth_m=100.0) as bench:
        bench.connect()
        _, mm = room_images(0)
        far = np.minimum(mm.astype(np.uint32) * 10, 65000).astype(np.uint16)
        bench.send(0, depth=encode_image(far, stamp_ns(0), FRAME_ID))
        bench.until(lambda: bench.said("estimates", "is the depth unit right for a camera 1.30 m above the floor"))
    assert capfd.readouterr().err.count("is the depth unit right") == 1


@pytest.mark.parametrize(("height", "confirmed"), ((1.3, True), (1.7, False)))
def test_d03_a_floor_that_depth_does_not_confirm_is_a_warning(height: float, confirmed: bool) -> None:
    with running(pose_source="parameters", camera_height=height, camera_pitch_deg=6.0) as bench:
        bench.connect()
        bench.listen("estimator/scan", messages.LaserScan)
        frames_of_floor(bench, lambda i: None, 0)
        if confirmed:
            bench.until(lambda: said(bench, "source") == "parameters+depth")
            assert bench.health().floors_not_confirmed == 0
        else:
            bench.until(lambda: said(bench, "source") == "parameters")
            words = "depth does not confirm the floor where parameters expects it for"
            bench.until(lambda: bench.said("floor", words, "check height and tilt"))


@pytest.mark.parametrize("imu_to_camera", ("", "0 0 0 1 0 0 1"))
def test_gravity_comes_from_an_imu(imu_to_camera: str) -> None:
    with running(pose_source="imu", imu_to_camera=imu_to_camera) as bench:
        bench.connect()
        imu = bench.other.create_publisher(messages.Imu, "imu", 10)
        bench.until(imu.get_subscription_count)
        message = messages.Imu(header=encode_header(stamp_ns(0), FRAME_ID))
        message.linear_acceleration.y, message.linear_acceleration.z = -9.8, 0.5
        for _ in range(20):
            imu.publish(message)
            bench.spin(0.02)
            if bench.node.shell._floor_pose._acceleration is not None:
                break
        bench.expect(1)
        # a quarter turn about x takes y to z and z to -y
        expected = np.array([0.0, 9.8, -0.5] if not imu_to_camera else [0.0, 0.5, 9.8])
        np.testing.assert_allclose(
            bench.estimators[0].priors[-1].gravity, expected / np.linalg.norm(expected), atol=1e-6
        )
        bench.until(lambda: said(bench, "expected") == "imu")


def readings(bench: Bench, up: tuple[float, float, float], frame_id: str = FRAME_ID, number: int = 5) -> None:
    """Publish readings of an accelerometer at the time of frame 0."""
    message = messages.Imu(header=encode_header(stamp_ns(0), frame_id))
    message.linear_acceleration.x, message.linear_acceleration.y, message.linear_acceleration.z = up
    for _ in range(number):
        bench.imu.publish(message)
        bench.spin(0.02)


@pytest.fixture
def imu_bench() -> Iterator[Bench]:
    """A node that takes the floor from an IMU, which is published under `bench.imu`."""
    with running(pose_source="imu") as bench:
        bench.connect()
        bench.imu = bench.other.create_publisher(messages.Imu, "imu", 10)
        bench.until(bench.imu.get_subscription_count)
        bench.spin(0.2)
        yield bench


@pytest.mark.parametrize(
    ("up", "reason", "words"),
    (
        ((0.0, 0.0, 0.0), "not gravity", "acceleration is 0.0 m/s^2; at rest it has to be 9.8 m/s^2"),
        ((0.0, -1.0, 0.0), "not gravity", "acceleration is 1.0 m/s^2"),
        ((0.0, np.nan, 0.0), "not finite", "not finite"),
    ),
    ids=("zeros", "in g", "nan"),
)
def test_f07_readings_that_are_not_gravity_are_counted_and_named(
    imu_bench: Bench, up: tuple[float, float, float], reason: str, words: str
) -> None:
    readings(imu_bench, up)
    imu_bench.until(lambda: imu_bench.said("input imu", "no imu reading can be used", words))
    stream = imu_bench.health().streams["imu"]
    assert (stream.refused, stream.paired) == ({reason: stream.received}, 0)
    imu_bench.expect(0)
    imu_bench.until(lambda: imu_bench.said("floor", "pose_source is imu, but no usable reading has come on imu"))
    readings(imu_bench, (0.0, -9.8, 0.0))
    imu_bench.until(lambda: imu_bench.well("input imu"))
    imu_bench.expect(1)
    imu_bench.until(lambda: imu_bench.well("floor"))


def test_f07_a_reading_without_a_stamp_is_counted(imu_bench: Bench) -> None:
    imu_bench.imu.publish(messages.Imu())
    imu_bench.until(lambda: imu_bench.health().streams["imu"].refused == {"bad stamp": 1})


def test_f07_an_imu_whose_pose_is_not_known_is_named_with_both_frames(imu_bench: Bench) -> None:
    readings(imu_bench, (0.0, -9.8, 0.0), "imu_link")
    imu_bench.expect(0)
    words = (
        f"no transform between 'imu_link' and '{FRAME_ID}' is known (tf2 must be installed), and imu_to_camera is empty"
    )
    imu_bench.until(lambda: imu_bench.said("floor", "pose_source is imu, but", words))
    imu_bench.expect(100)
    imu_bench.until(lambda: imu_bench.said("floor", "the last usable reading of imu is over 2 s before or after"))


def test_f07_an_imu_that_nobody_publishes_is_named_with_its_topic() -> None:
    with running(pose_source="imu") as bench:
        bench.connect()
        words = f"on {bench.namespace}/imu; nobody publishes it"
        bench.until(lambda: bench.said("input imu", "no imu for", words))
        assert bench.node.set_parameters([Parameter("pose_source", value="auto")])[0].successful
        bench.until(lambda: "input imu" not in bench.diagnosis())
