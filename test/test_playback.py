"""Playback over real DDS: what the bag holds arrives, bit by bit, at its own pace."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frames_on_disk import SMALL, make_samples, write_folder

from room_layout_ros.datasets import CameraCalibration, DataError, Sample
from room_layout_ros.datasets import bag_messages as messages
from room_layout_ros.datasets.bag_topics import COLOR_INFO_TOPIC, COLOR_TOPIC, DEPTH_TOPIC
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import BagWriter
from room_layout_ros.playback import PROFILE_VARIABLE, PlayOptions, bag_stream, parse_remappings, set_transport_profile

pytestmark = pytest.mark.dds

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def walk() -> list[Sample]:
    return [s for s in SyntheticSource(12, 2, options={"furniture": 0.3}) if isinstance(s, Sample)]


@pytest.fixture(scope="module")
def bag(walk: list[Sample], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("play") / "bag"
    with BagWriter(path) as writer:
        for sample in walk:
            writer.write(sample)
    return path


class Listener:
    """Collects colour, depth, calibration and clock in a thread of its own."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import qos_profile_sensor_data
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, Image

        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("listener", context=self.context)
        self.got: dict[str, list[Any]] = {t: [] for t in (COLOR_TOPIC, DEPTH_TOPIC, COLOR_INFO_TOPIC, "/clock")}
        kinds = {COLOR_TOPIC: Image, DEPTH_TOPIC: Image, COLOR_INFO_TOPIC: CameraInfo, "/clock": Clock}
        for topic, kind in kinds.items():
            self.node.create_subscription(kind, topic, partial(self._keep, topic), qos_profile_sensor_data)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def _keep(self, topic: str, message: Any) -> None:
        self.got[topic].append((time.monotonic(), message))

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join(timeout=5)
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def listener() -> Iterator[Listener]:
    listener = Listener()
    yield listener
    listener.close()


def start(*words: object, **variables: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "room_layout_ros.cli", "play", *map(str, words)]
    environment = {**os.environ, **variables}
    return subprocess.Popen(command, cwd=REPOSITORY, env=environment, stderr=subprocess.PIPE, text=True)


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def test_a_bag_arrives_bit_by_bit_and_at_its_own_pace(bag: Path, walk: list[Sample], listener: Listener) -> None:
    process = start(
        bag, "--wait-for-subscribers", 1, "--rate", 0.5, "--clock",
        "--topics", COLOR_TOPIC, DEPTH_TOPIC, COLOR_INFO_TOPIC,
    )  # fmt: skip
    _, told = process.communicate(timeout=60)
    assert process.returncode == 0, told
    assert f"{DEPTH_TOPIC} 12" in told
    colors, depths = listener.got[COLOR_TOPIC], listener.got[DEPTH_TOPIC]
    stamps = [s.frame.stamp_ns for s in walk]
    assert [stamp_of(m) for _, m in colors] == stamps
    assert [stamp_of(m) for _, m in depths] == stamps
    for sample, (_, message) in zip(walk, colors, strict=True):
        np.testing.assert_array_equal(np.frombuffer(message.data, np.uint8).reshape(480, 640, 3), sample.frame.color)
    span = depths[-1][0] - depths[0][0]
    assert span == pytest.approx((stamps[-1] - stamps[0]) / 1e9 / 0.5, rel=0.25)
    ticks = [m.clock.sec * 10**9 + m.clock.nanosec for _, m in listener.got["/clock"]]
    assert len(ticks) >= 12
    assert ticks == sorted(ticks)
    assert stamps[0] <= ticks[0]
    assert ticks[-1] <= stamps[-1]


def ticks_ns(listener: Listener) -> list[int]:
    return [m.clock.sec * 10**9 + m.clock.nanosec for _, m in listener.got["/clock"]]


def test_the_clock_goes_on_where_the_player_is_behind_its_schedule(
    bag: Path, walk: list[Sample], listener: Listener
) -> None:
    process = start(bag, "--wait-for-subscribers", 1, "--rate", 100, "--clock", "--topics", COLOR_TOPIC, DEPTH_TOPIC)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 0, told
    deadline = time.monotonic() + 3
    while len(ticks_ns(listener)) < 6 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert max(ticks_ns(listener)) >= walk[-2].frame.stamp_ns
    assert len(ticks_ns(listener)) >= 6


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    """A bag of a simulator: /clock and stamps of the simulation, recorded 100 s later by the machine's clock."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types, store = get_typestore(Stores.ROS2_JAZZY), messages.typestore()
    clock, time_of = types.types["rosgraph_msgs/msg/Clock"], types.types["builtin_interfaces/msg/Time"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        tick = writer.add_connection("/clock", clock.__msgtype__, typestore=types)
        image = writer.add_connection(COLOR_TOPIC, messages.IMAGE, typestore=store)
        for stamp_ns in range(10**9, 2 * 10**9, 10**8):
            now = clock(clock=time_of(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9))
            writer.write(tick, stamp_ns + 100 * 10**9, types.serialize_cdr(now, clock.__msgtype__))
            pixels = np.zeros((48, 64, 3), np.uint8)
            message = messages.encode_image_message(pixels, "rgb8", stamp_ns, "optical")
            writer.write(image, stamp_ns + 100 * 10**9, message)
    return tmp_path / "bag"


@pytest.mark.parametrize("words", [("--clock",), ()])
def test_there_is_one_clock(simulated: Path, listener: Listener, words: tuple[str, ...]) -> None:
    process = start(simulated, "--wait-for-subscribers", 1, *words)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 0, told
    assert ("the /clock of" in told) == bool(words)
    seconds = {ns // 10**9 for ns in ticks_ns(listener)}
    assert seconds <= ({101} if words else {1})
    assert seconds


def test_a_folder_plays_under_the_names_the_node_listens_to(
    tmp_path: Path, listener: Listener, rng: np.random.Generator
) -> None:
    samples = make_samples(6, rng)
    folder = write_folder(tmp_path / "frames", samples)
    process = start(folder, "--wait-for-subscribers", 1)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 0, told
    deadline = time.monotonic() + 3
    while len(listener.got[DEPTH_TOPIC]) < 6 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert [stamp_of(m) for _, m in listener.got[DEPTH_TOPIC]] == [s.frame.stamp_ns for s in samples]
    assert listener.got[COLOR_INFO_TOPIC][0][1].k[0] == samples[0].frame.camera.fx


@pytest.fixture
def latched(tmp_path: Path) -> Path:
    """A bag whose camera_info was sent once, for readers that come later too; a second of images."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
    from rosbags.rosbag2 import StoragePlugin, Writer

    ever = QosTime(9223372036, 854775807)
    kept = Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
        ever, ever, QosLiveliness.AUTOMATIC, ever, False,
    )  # fmt: skip
    store, calibration = messages.typestore(), CameraCalibration.from_intrinsics(SMALL)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        info = writer.add_connection(
            COLOR_INFO_TOPIC, messages.CAMERA_INFO, typestore=store, offered_qos_profiles=[kept]
        )
        image = writer.add_connection(COLOR_TOPIC, messages.IMAGE, typestore=store)
        writer.write(info, 10**9, messages.encode_camera_info(calibration, 10**9, "optical"))
        for stamp_ns in range(10**9, 3 * 10**9, 10**8):
            pixels = np.zeros((48, 64, 3), np.uint8)
            writer.write(image, stamp_ns, messages.encode_image_message(pixels, "rgb8", stamp_ns, "optical"))
    return tmp_path / "bag"


def test_what_was_sent_once_for_late_readers_is_marked_and_only_that(latched: Path) -> None:
    kept = {message.topic: message.latched for message in bag_stream(latched)()}
    assert kept == {COLOR_INFO_TOPIC: True, COLOR_TOPIC: False}


def test_a_reader_that_comes_later_gets_what_was_sent_once(latched: Path, listener: Listener) -> None:
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile
    from sensor_msgs.msg import CameraInfo

    got: list[Any] = []
    process = start(latched, "--rate", 0.5)
    deadline = time.monotonic() + 30
    while not listener.got[COLOR_TOPIC] and time.monotonic() < deadline:
        time.sleep(0.02)
    profile = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    listener.node.create_subscription(CameraInfo, COLOR_INFO_TOPIC, got.append, profile)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 0, told
    assert len(got) == 1, "the first image came after it"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_loop_cleanly(bag: Path, listener: Listener, number: signal.Signals) -> None:
    process = start(bag, "--loop", "--wait-for-subscribers", 1, "--topics", COLOR_TOPIC, COLOR_INFO_TOPIC, DEPTH_TOPIC)
    deadline = time.monotonic() + 30
    while len(listener.got[DEPTH_TOPIC]) < 15 and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(listener.got[DEPTH_TOPIC]) >= 15, "it went round more than once"
    sent = time.monotonic()
    process.send_signal(number)
    _, told = process.communicate(timeout=10)
    assert time.monotonic() - sent < 3
    assert process.returncode == 0
    assert "stopped after" in told
    assert "Traceback" not in told


def test_nobody_listening_is_said(bag: Path) -> None:
    process = start(bag, "--wait-for-subscribers", 1, "--wait-timeout", 0.3)
    _, told = process.communicate(timeout=30)
    assert process.returncode == 2
    assert "has not 1 subscribers" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "domain", "sentence"),
    (
        (("--remap", f"{COLOR_TOPIC}:=/bad topic"), "7", "topic name must not contain characters"),
        ((), "9999", "ROS_DOMAIN_ID is '9999'; it must be a whole number of 0 to 232"),
    ),
    ids=("topic", "domain"),
)
def test_what_ros_refuses_is_a_sentence(bag: Path, words: tuple[str, ...], domain: str, sentence: str) -> None:
    process = start(bag, *words, ROS_DOMAIN_ID=domain)
    _, told = process.communicate(timeout=30)
    assert process.returncode == 2, told
    assert sentence in told
    assert told.count("\n") == 1, told


def test_the_shipped_transport_profile_is_used_unless_the_user_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PROFILE_VARIABLE, raising=False)
    profile = set_transport_profile()
    assert profile is not None
    assert profile.name == "fastdds.xml"
    assert os.environ[PROFILE_VARIABLE] == str(profile)
    monkeypatch.setenv(PROFILE_VARIABLE, "/my/own.xml")
    assert set_transport_profile() == Path("/my/own.xml")
    assert os.environ[PROFILE_VARIABLE] == "/my/own.xml"


def test_options_are_checked() -> None:
    with pytest.raises(DataError, match="rate is 1000"):
        PlayOptions(rate=1000.0)
    with pytest.raises(DataError, match="0 or more"):
        PlayOptions(loops=-1)
    with pytest.raises(DataError, match="FROM:=TO"):
        parse_remappings(["/a:/b"])
    assert parse_remappings(["/a:=/b"]) == (("/a", "/b"),)
