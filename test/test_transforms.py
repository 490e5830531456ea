"""TF when time starts over: a bag that loops, a simulation that is reset."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from fake_tf import CACHE_NS, FakeBuffer, install
from node_bench import Bench, running
from numpy.typing import NDArray
from room_frames import FRAME_ID, stamp_ns
from rosgraph_msgs.msg import Clock

from msg_adapters import messages
from room_layout_ros.transforms import Transforms

S = 1_000_000_000
START = 100 * S
BAG_S = 40
"""Four times as long as tf2 keeps a transform."""
NO_TURN = "0 0 0 1"


@pytest.fixture
def tf(monkeypatch: pytest.MonkeyPatch) -> FakeBuffer:
    return install(monkeypatch)


@pytest.fixture
def transforms(tf: FakeBuffer) -> Transforms:
    transforms = Transforms(node=None)
    assert transforms.listen()
    return transforms


def drive(tf: FakeBuffer, seconds: int = BAG_S, frame: str = "base") -> Iterator[int]:
    """Publish a robot that drives a metre a second, once a second; yield the stamps."""
    for s in range(seconds):
        tf.add("odom", frame, f"{s} 0 0 {NO_TURN}", START + s * S)
        yield START + s * S


def x_of(T: NDArray[np.float64] | None) -> float | None:
    return None if T is None else float(T[0, 3])


def test_each_loop_of_a_bag_has_the_poses_of_its_own_time(tf: FakeBuffer, transforms: Transforms) -> None:
    assert BAG_S * S > CACHE_NS
    for _ in range(3):
        for stamp in drive(tf):
            assert x_of(transforms.find("odom", "base", stamp)) == (stamp - START) / S
    assert transforms.said() == ""
    assert tf.cleared == 2, "once a loop"


def test_a_frame_that_is_before_its_transforms_does_not_get_those_of_the_end(
    tf: FakeBuffer, transforms: Transforms
) -> None:
    for stamp in drive(tf):
        transforms.find("odom", "base", stamp)
    assert transforms.find("odom", "base", START) is None, "of this loop nothing has come yet"
    for stamp in drive(tf, 3):
        assert x_of(transforms.find("odom", "base", stamp)) == (stamp - START) / S
    assert tf.cleared == 1


def test_a_transform_of_the_end_that_comes_late_does_not_spoil_the_new_loop(
    tf: FakeBuffer, transforms: Transforms
) -> None:
    list(drive(tf))
    list(drive(tf, 2))
    tf.add("odom", "base", f"{BAG_S} 0 0 {NO_TURN}", START + BAG_S * S)
    for stamp in drive(tf, 3):
        assert x_of(transforms.find("odom", "base", stamp)) == (stamp - START) / S


def test_static_transforms_outlive_a_loop(tf: FakeBuffer, transforms: Transforms) -> None:
    tf.add("base", "camera", f"7 0 0 {NO_TURN}")
    for _ in range(2):
        list(drive(tf))
    assert x_of(transforms.find("base", "camera", START)) == 7.0
    transforms.clear()
    assert x_of(transforms.find("base", "camera", START)) == 7.0


def test_frames_that_lag_behind_one_another_are_no_loop(tf: FakeBuffer, transforms: Transforms) -> None:
    """map to odom is stamped ahead, a wheel's encoder comes late, two frames come out of turn."""
    for s in range(60):
        tf.add("map", "odom", f"0 0 0 {NO_TURN}", START + s * S + S)
        tf.add("odom", "base", f"{s} 0 0 {NO_TURN}", START + s * S)
        tf.add("base", "wheel", f"0 0 0 {NO_TURN}", START + s * S - 8 * S)
        for late in (0, -S // 2, 0):
            transforms.find("odom", "base", START + s * S + late)
    assert tf.cleared == 0


def test_without_a_listener_there_is_nothing_to_clear() -> None:
    transforms = Transforms(node=None)
    transforms.clear()
    assert transforms.find("odom", "base", START) is None


LEVEL, NODDING = "0 0.3 0.1 0.5 -0.5 0.5 0.5", "0 0.3 0.1 0.547419 -0.547419 0.447585 0.447585"


def gravity(bench: Bench, i: int) -> float:
    """Send frame `i`, which may have been there in the loop before; return how far ahead down points."""
    priors = bench.estimators[0].priors
    before = len(priors)
    bench.send(i)
    bench.until(lambda: len(priors) > before)
    return float(priors[-1].gravity[2])


@pytest.mark.dds
def test_in_the_node_a_bag_that_loops_keeps_the_camera_where_it_was(tf: FakeBuffer) -> None:
    last = 600  # 20 s
    with running() as bench:
        bench.connect()
        for _ in range(2):
            for i, pose, down in ((1, LEVEL, 0.0), (last, NODDING, np.sin(0.2))):
                tf.add(FRAME_ID, "base_footprint", pose, stamp_ns(i))
                assert gravity(bench, i) == pytest.approx(down, abs=1e-5)


@pytest.mark.dds
def test_a_clock_that_jumps_back_clears_what_tf_knew(tf: FakeBuffer) -> None:
    with running(use_sim_time=True) as bench:
        bench.listen("estimator/labels", messages.Image)
        clock = bench.other.create_publisher(Clock, "/clock", 10)

        def tick(i: int) -> None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp_ns(i), S)
            clock.publish(message)
            bench.spin(0.05)

        for _ in range(100):
            tick(30)
            if all(c.get_subscription_count() for c in bench.cameras.values()):
                break
        tf.add(FRAME_ID, "base_footprint", NODDING, stamp_ns(30))
        before = tf.cleared
        tick(0)
        bench.until(lambda: tf.cleared == before + 1)
