"""The node over DDS within one process: topics, bad input (one test each), laziness, parameters, clocks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from dds_player import camera_info
from node_bench import Bench, GatedEstimator, QuickEstimator, running
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from room_frames import CAMERA, FRAME_ID, room_frame, room_images, stamp_ns
from rosgraph_msgs.msg import Clock

from msg_adapters import messages
from msg_adapters.encode_image import encode_image
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.labels import LABEL_NAMES
from room_layout_ros.node_config import NodeConfig
from room_layout_ros.outputs import OUTPUTS
from room_layout_ros.scene import Scene

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def shared() -> Iterator[Bench]:
    """One bench for all tests that only send frames; each takes numbers of its own."""
    with running() as bench:
        bench.connect()
        bench.expect(0)
        yield bench


@pytest.fixture
def bench(shared: Bench, request: pytest.FixtureRequest) -> Bench:
    shared.heard.clear()
    return shared


_next = iter(range(10, 100_000, 10))


@pytest.fixture
def first() -> int:
    """Number of a frame that no other test has used."""
    return next(_next)


def color_of(i: int, **changes: Any) -> Any:
    return changed(encode_image(room_images(i)[0], stamp_ns(i), FRAME_ID), changes)


def depth_of(i: int, **changes: Any) -> Any:
    return changed(encode_image(room_images(i)[1], stamp_ns(i), FRAME_ID), changes)


def changed(message: Any, changes: dict[str, Any]) -> Any:
    for name, value in changes.items():
        if name == "frame_id":
            message.header.frame_id = value
        elif name == "stamp":
            message.header.stamp.sec, message.header.stamp.nanosec = value
        else:
            setattr(message, name, value)
    return message


def test_labels_are_the_estimators_with_stamp_and_frame_of_the_depth_image(bench: Bench, first: int) -> None:
    bench.send(first, color=color_of(first))
    bench.until(lambda: bench.labels_of(first))
    (message,) = bench.labels_of(first)
    estimate = QuickEstimator(EstimatorConfig()).estimate(room_frame(first))
    assert (message.encoding, message.header.frame_id) == ("mono8", FRAME_ID)
    np.testing.assert_array_equal(np.frombuffer(message.data, np.uint8).reshape(480, 640), estimate.labels)


def test_the_estimator_gets_the_same_frame_as_offline(bench: Bench, first: int) -> None:
    bench.expect(first)
    frame, offline = bench.estimators[0].frames[-1], room_frame(first)
    assert (frame.camera, frame.stamp_ns, frame.frame_id) == (offline.camera, offline.stamp_ns, offline.frame_id)
    assert frame.color.tobytes() == offline.color.tobytes()  # type: ignore[union-attr]
    assert frame.depth_m.tobytes() == offline.depth_m.tobytes()  # type: ignore[union-attr]


BAD_COLOR: dict[str, tuple[dict[str, Any], str]] = {
    "f16_unknown_encoding": ({"encoding": "yuv422_yuy2"}, "has encoding 'yuv422_yuy2'; allowed are rgb8"),
    "f16_empty_encoding": ({"encoding": ""}, "has encoding ''"),
    "f16_huge_encoding": ({"encoding": "z" * 1_000_000}, "'" + "z" * 37 + "...'"),
    "f16_foreign_encoding": ({"encoding": "\x1b[2Jцвет"}, "'?[2J????'"),
    "f18_step_too_small": ({"step": 1919}, "step 1919; a row of 640 rgb8 pixels needs 1920"),
    "f18_step_zero": ({"step": 0}, "step 0"),
    "f19_size_is_not_step_times_height": ({"step": 1921}, "step 1921 x height 480"),
    "f19_height_zero": ({"height": 0}, "640x0"),
    "f19_width_huge": ({"width": 2**31}, f"{2**31}x480"),
    "f21_truncated": ({"data": b"short"}, "has 5 bytes"),
    "f11_stamp_zero": ({"stamp": (0, 0)}, "it must be above 0"),
    "f11_stamp_negative": ({"stamp": (-5, 0)}, "it must be above 0"),
    "f11_nanoseconds_overflow": ({"stamp": (5, 10**9)}, "nanosec 1000000000"),
}


@pytest.mark.parametrize("name", BAD_COLOR)
def test_a_bad_colour_image_is_refused_in_a_sentence_and_the_next_pair_works(
    bench: Bench, first: int, name: str
) -> None:
    changes, sentence = BAD_COLOR[name]
    published = bench.health().published
    bench.send(first, color=color_of(first, **changes))
    bench.until(lambda: bench.said("input colour", "messages refused", sentence))
    bench.expect(first + 1)
    assert not bench.labels_of(first)
    assert bench.health().published == published + 1


BAD_DEPTH: dict[str, tuple[dict[str, Any], str]] = {
    "f17_8UC1": ({"encoding": "8UC1"}, "has encoding '8UC1'; allowed are 16UC1, mono16, 32FC1"),
    "f17_colour_as_depth": ({"encoding": "rgb8"}, "has encoding 'rgb8'"),
    "f18_step_too_small": ({"step": 640}, "needs 1280"),
}


@pytest.mark.parametrize("name", BAD_DEPTH)
def test_a_bad_depth_image_is_refused_in_a_sentence_and_the_next_pair_works(
    bench: Bench, first: int, name: str
) -> None:
    changes, sentence = BAD_DEPTH[name]
    bench.send(first, depth=depth_of(first, **changes))
    bench.until(lambda: bench.said("input depth", sentence))
    bench.expect(first + 1)


@pytest.mark.parametrize("stream", ("color", "depth", "info"))
@pytest.mark.parametrize("cut", (1, 4, 30, 200))
def test_f20_messages_cut_on_the_wire_are_refused(bench: Bench, first: int, stream: str, cut: int) -> None:
    whole = {"color": color_of, "depth": depth_of, "info": lambda i: camera_info(stamp_ns(i))}[stream](first)
    bench.send(first, **{stream: serialize_message(whole)[:cut]})
    name = {"color": "input colour", "depth": "input depth", "info": "input camera_info"}[stream]
    bench.until(lambda: bench.said(name, "messages refused"))
    bench.expect(first + 1)


def test_f19_padded_rows_are_decoded_exactly(bench: Bench, first: int) -> None:
    rgb = room_images(first)[0]
    rows = np.pad(rgb.reshape(480, 1920), ((0, 0), (0, 13)), constant_values=77)
    bench.send(first, color=color_of(first, step=1933, data=rows.tobytes()))
    bench.until(lambda: bench.labels_of(first))
    np.testing.assert_array_equal(bench.estimators[0].frames[-1].color, rgb)


def test_f20_big_endian_depth_is_decoded_exactly(bench: Bench, first: int) -> None:
    swapped = room_images(first)[1].astype(">u2").tobytes()
    bench.send(first, depth=depth_of(first, is_bigendian=1, data=swapped))
    bench.until(lambda: bench.labels_of(first))
    np.testing.assert_array_equal(bench.estimators[0].frames[-1].depth_m, room_frame(first).depth_m)


@pytest.mark.parametrize("value", (0.0, np.nan, np.inf, -1.0, 1e-40))
def test_f22_depth_without_a_measurement_has_a_status(bench: Bench, first: int, value: float) -> None:
    empty = encode_image(np.full((480, 640), value, np.float32), stamp_ns(first), FRAME_ID)
    before = sum(bench.health().no_estimate.values())
    bench.send(first, depth=empty)
    if value == 1e-40:  # a denormal is a number; whether it is a distance is for the estimator to say
        bench.until(lambda: bench.labels_of(first))
    else:
        bench.until(lambda: bench.said("estimates", "without an estimate (no depth)"))
        assert sum(bench.health().no_estimate.values()) == before + 1
    bench.expect(first + 1)


@pytest.mark.parametrize(
    ("depth", "words"),
    ((np.full((480, 640), 2000.0, np.float32), "2000 m"), (np.full((480, 640), 2, np.uint16), "2 mm")),
    ids=("millimetres_as_float", "metres_as_integers"),
)
def test_f23_the_wrong_unit_of_depth_is_refused(bench: Bench, first: int, depth: Any, words: str) -> None:
    bench.send(first, depth=encode_image(depth, stamp_ns(first), FRAME_ID))
    bench.until(lambda: bench.said("estimates", "check the depth unit", words))
    bench.expect(first + 1)


def test_f25_a_change_of_resolution_works_with_the_next_pair(bench: Bench, first: int) -> None:
    rgb, mm = room_images(first)
    info = camera_info(stamp_ns(first))
    info.width, info.height = 320, 240
    small = [encode_image(np.ascontiguousarray(a[::2, ::2]), stamp_ns(first), FRAME_ID) for a in (rgb, mm)]
    bench.send(first, small[0], small[1], info)
    bench.until(lambda: bench.labels_of(first))
    assert bench.labels_of(first)[0].width == 320
    bench.expect(first + 1)
    assert bench.labels_of(first + 1)[0].width == 640


def test_f26_sizes_that_differ_are_not_registered(bench: Bench, first: int) -> None:
    half = np.ascontiguousarray(room_images(first)[1][::2, ::2])
    bench.send(first, depth=encode_image(half, stamp_ns(first), FRAME_ID))
    bench.until(lambda: bench.said("estimates", "colour image is 640x480 and depth image 320x240", "not registered"))
    bench.expect(first + 1)


def test_f26_frames_that_differ_are_not_registered(bench: Bench, first: int) -> None:
    bench.send(first, depth=depth_of(first, frame_id="depth_frame"))
    bench.until(lambda: bench.said("estimates", FRAME_ID, "depth_frame", "not registered"))
    bench.expect(first + 1)


@pytest.mark.parametrize(
    ("p", "words"), (([0.0] * 12, "uncalibrated"), ([np.nan] * 12, "not finite")), ids=("zeros", "nan")
)
def test_f27_an_uncalibrated_camera_is_an_error(bench: Bench, first: int, p: list[float], words: str) -> None:
    info = camera_info(stamp_ns(first))
    info.k, info.p = [0.0] * 9, p
    bench.send(first, info=info)
    bench.until(lambda: bench.said("input camera_info", words))
    bench.expect(first + 1)


def test_f27_a_camera_of_another_size_is_an_error(bench: Bench, first: int) -> None:
    info = camera_info(stamp_ns(first))
    info.width = 320
    bench.send(first, info=info)
    bench.until(lambda: bench.said("estimates", "camera_info says 320x480"))
    bench.expect(first + 1)


def test_f28_a_new_camera_holds_from_its_stamp_on(bench: Bench, first: int) -> None:
    info = camera_info(stamp_ns(first + 1))
    info.p[0] = 600.0
    bench.expect(first)
    bench.send(first + 1, info=info)
    bench.until(lambda: bench.labels_of(first + 1))
    assert [f.camera.fx for f in bench.estimators[0].frames[-2:]] == [CAMERA.fx, 600.0]
    bench.expect(first + 2)


def test_f06_f07_duplicates_and_late_frames_give_one_output_per_stamp(bench: Bench, first: int) -> None:
    for i in (first, first + 1, first + 1, first):
        bench.send(i)
    bench.until(lambda: bench.labels_of(first + 1))
    bench.spin(0.3)
    assert len(bench.labels_of(first + 1)) == 1
    assert len(bench.labels_of(first)) <= 1
    stamps = [(m.header.stamp.sec, m.header.stamp.nanosec) for m in bench.heard["estimator/labels"]]
    assert stamps == sorted(stamps)


def test_all_outputs_say_the_same_stamp(bench: Bench, first: int) -> None:
    """Those that a made-up estimate has; with a real one, test_node_processes listens to all."""
    config = EstimatorConfig()
    scene = Scene(room_frame(first), QuickEstimator(config).estimate(room_frame(first)), NodeConfig(), config)
    outputs = {o.topic.replace("~", "estimator"): o for o in OUTPUTS if o.encode(scene)}
    assert len(outputs) >= 6
    others = {topic: output for topic, output in outputs.items() if output.topic != "~/labels"}
    ears = [bench.listen(topic, output.message, 50) for topic, output in others.items()]
    bench.until(lambda: all(ear.get_publisher_count() for ear in ears))
    bench.spin(0.5)
    bench.expect(first)
    bench.until(lambda: all(bench.heard[topic] for topic in outputs))
    bench.spin(0.2)
    for topic, output in outputs.items():
        for message in getattr(bench.heard[topic][-1], "markers", bench.heard[topic][-1:]):
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp_ns(first), topic
            assert message.header.frame_id == (f"{FRAME_ID}_floor" if output.on_floor else FRAME_ID)
    faces = [p.face for p in QuickEstimator.ROOM.polygons(CAMERA)]
    assert [m.polygon.id for m in bench.heard["estimator/polygons"]][-len(faces) :] == faces
    for ear in ears:
        bench.other.destroy_subscription(ear)


def test_what_needs_a_floor_is_what_sends_nothing_without_one() -> None:
    config = EstimatorConfig()
    frame = room_frame(0)
    estimate = QuickEstimator(config).estimate(frame)
    without = Scene(replace(frame, depth_m=None), estimate, NodeConfig(), config)
    assert {o.topic for o in OUTPUTS if o.needs_floor} == {o.topic for o in OUTPUTS if not o.encode(without)}


def test_label_names_come_to_late_listeners_too(bench: Bench) -> None:
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    bench.listen("estimator/label_names", messages.String, latched)
    bench.until(lambda: bench.heard["estimator/label_names"])
    assert list(json.loads(bench.heard["estimator/label_names"][0].data).values()) == list(LABEL_NAMES)


def test_a_parameter_out_of_bounds_is_refused_and_the_old_set_stays(bench: Bench, first: int) -> None:
    before = bench.node.shell._settings
    for wrong in (
        [Parameter("max_stamp_gap", value=7.0)],
        [Parameter("max_depth_m", value=float("nan"))],
        [Parameter("queue_size", value="many")],
        [Parameter("max_stamp_gap", value=0.3), Parameter("reset_gap", value=0.1)],
        [Parameter("diagnostics_period", value=3.0)],
        [Parameter("queue_size", value=5), Parameter("superpixel_count", value=-1)],
        [Parameter("use_color", value=False), Parameter("use_depth", value=False)],
    ):
        result = bench.node.set_parameters_atomically(wrong)
        assert not result.successful
        assert result.reason
    assert bench.node.shell._settings is before
    bench.expect(first)


def test_a_whole_number_is_a_float_where_one_is_meant_at_the_start_and_while_it_runs() -> None:
    with running(camera_height=1, robot_height_m=2) as bench:
        assert bench.node.shell._settings.node.camera_height == 1.0
        changes = [Parameter("camera_height", value=2), Parameter("queue_size", value=7)]
        assert bench.node.set_parameters_atomically(changes).successful
        assert bench.node.shell._settings.node.camera_height == 2.0
        values = [bench.node.get_parameter(n).value for n in ("camera_height", "robot_height_m", "queue_size")]
        assert [(type(value), value) for value in values] == [(float, 2.0), (float, 2.0), (int, 7)]
        refused = bench.node.set_parameters([Parameter("camera_height", value=11)])[0]
        assert not refused.successful
        assert bench.node.get_parameter("camera_height").value == 2.0


@pytest.mark.parametrize("error", (ValueError("weights of 5 layers; 4 are needed"), RuntimeError("no memory today")))
def test_f33_a_parameter_that_no_estimator_can_be_made_of_is_refused_and_changes_nothing(
    bench: Bench, first: int, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(config: EstimatorConfig) -> Any:
        raise error

    before = bench.node.shell._settings
    with monkeypatch.context() as patch:
        patch.setattr(bench.node.shell, "_make_estimator", broken)
        result = bench.node.set_parameters([Parameter("superpixel_count", value=321)])[0]
    assert not result.successful
    assert str(error) in result.reason
    assert bench.node.get_parameter("superpixel_count").value == before.estimator.config.superpixel_count
    assert bench.node.shell._settings is before
    bench.expect(first)


def test_a_change_makes_one_estimator_and_a_refused_one_leaves_none_behind(bench: Bench) -> None:
    number = len(bench.estimators)
    for count, queue, well in ((150, 10, True), (160, -1, False), (150, 11, True)):
        changes = [Parameter("superpixel_count", value=count), Parameter("queue_size", value=queue)]
        assert bench.node.set_parameters_atomically(changes).successful == well
        settings = bench.node.shell._settings
        assert settings.estimator.config.superpixel_count == 150
        assert settings.node.queue_size == bench.node.get_parameter("queue_size").value
    assert len(bench.estimators) == number + 1
    back = [Parameter("superpixel_count", value=200), Parameter("queue_size", value=10)]
    assert bench.node.set_parameters_atomically(back).successful


def test_parameters_change_while_frames_run(bench: Bench, first: int) -> None:
    for i in range(200):
        value = 100 + i % 7
        assert bench.node.set_parameters_atomically([Parameter("superpixel_count", value=value)]).successful
        if i % 20 == 0:
            bench.expect(first + i // 20)
            assert bench.estimators[-1].config.superpixel_count == value
    assert bench.node.set_parameters_atomically([Parameter("superpixel_count", value=200)]).successful


def test_f03_a_missing_camera_info_is_named() -> None:
    with running() as bench:
        bench.connect()
        for i in range(40):
            bench.send(i, info=False)
            bench.spin(0.04)
        topic = f"{bench.namespace}/rgb/camera_info"
        bench.until(
            lambda: bench.said("input camera_info", f"no camera_info for 1 s on {topic}", "1 publisher(s) seen")
        )
        assert bench.said("estimates", "no camera_info has come yet")
        assert not bench.heard["estimator/labels"]
        bench.expect(50)


def test_f01_f02_a_stream_that_stops_is_named_within_a_second_and_resumes() -> None:
    with running(no_data_timeout=0.5) as bench:
        bench.connect()
        bench.expect(0)
        for stream, name in (("color", "colour"), ("depth", "depth")):
            for i in range(1, 25):
                bench.send(i + (100 if name == "depth" else 0), **{stream: False})
                bench.spin(0.05)
            bench.until(partial(bench.said, f"input {name}", f"no {name} for"), 1.0)
            bench.expect(50 if name == "colour" else 150)
            bench.until(partial(bench.well, f"input {name}"))


def test_nobody_publishes_is_said_with_the_topic() -> None:
    with running(no_data_timeout=0.5) as bench:
        bench.connect()
        for camera in bench.cameras.values():
            bench.other.destroy_publisher(camera)
        topic = f"{bench.namespace}/depth_registered/image_rect"
        bench.until(lambda: bench.said("input depth", f"on {topic}; nobody publishes it"))


def test_stamps_that_never_meet_are_explained() -> None:
    with running(no_data_timeout=0.5, max_stamp_gap=0.001) as bench:
        bench.connect()
        for i in range(30):
            late = encode_image(room_images(i)[1], stamp_ns(i) + 10_000_000, FRAME_ID)
            bench.send(i, depth=late)
            bench.spin(0.04)
        bench.until(lambda: bench.said("estimates", "do not pair", "max_stamp_gap = 1 ms"))


def test_f14_two_publishers_are_named_and_a_new_frame_id_starts_afresh() -> None:
    with running() as bench:
        bench.connect()
        bench.expect(0)
        second = bench.camera("depth", QoSProfile(depth=1))
        bench.until(lambda: bench.said("input depth", "2 publishers on"))
        bench.other.destroy_publisher(second)
        resets = bench.health().resets
        bench.send(1, color=color_of(1, frame_id="other"), depth=depth_of(1, frame_id="other"))
        bench.until(lambda: bench.labels_of(1))
        assert bench.health().resets == resets + 1


def test_f15_a_clash_of_qos_names_topic_and_policy() -> None:
    with running() as bench:
        bench.other.destroy_publisher(bench.cameras["depth"])
        bench.cameras["depth"] = bench.camera("depth", qos_profile_sensor_data)  # best effort; the bench wants reliable
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.said("input depth", "/depth_registered/image_rect", "RELIABILITY"))


def test_f08_a_bag_that_loops_keeps_going() -> None:
    with running() as bench:
        bench.connect()
        for _ in range(3):
            bench.heard.clear()
            for i in (0, 30, 60):
                bench.expect(i)
        assert bench.health().resets == 2


def test_f12_sim_time_waits_for_the_clock_and_starts_with_it() -> None:
    with running(use_sim_time=True) as bench:
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.diagnosis().get("estimates") == (0, "waiting for /clock (use_sim_time is true)"))
        assert all(c.get_subscription_count() == 0 for c in bench.cameras.values())
        clock = bench.other.create_publisher(Clock, "/clock", 10)

        def tick(t: int) -> None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(t, 10**9)
            clock.publish(message)
            bench.spin(0.05)

        for i in range(100):
            tick(stamp_ns(0) + i)
            if all(c.get_subscription_count() for c in bench.cameras.values()):
                break
        bench.spin(0.2)
        bench.expect(1)
        resets = bench.health().resets
        tick(stamp_ns(0) - 10**10)  # /clock steps back: a bag starts over
        bench.until(lambda: bench.health().resets == resets + 1)
        bench.expect(2)


def test_f13_messages_that_a_busy_process_gets_no_time_to_take_count_as_lost() -> None:
    with running() as bench:
        bench.connect()
        bench.expect(0)
        for i in range(1, 21):  # nothing spins meanwhile; five of a topic are kept
            bench.send(i)
        bench.expect(21)
        streams = bench.health().streams
        assert {s: streams[s].received + streams[s].lost for s in ("color", "depth")} == {"color": 22, "depth": 22}
        assert streams["depth"].lost >= 10
        bench.until(
            lambda: bench.said("input depth", "depth messages came while this process got no time to take them")
        )
        assert not bench.said("input depth", "lost on the way"), "the publisher is not to blame"


def test_f43_nobody_listens_nothing_is_subscribed() -> None:
    with running() as bench:
        bench.until(lambda: bench.diagnosis().get("estimates") == (0, "idle: nobody listens to an output"))
        assert all(c.get_subscription_count() == 0 for c in bench.cameras.values())
        ear = bench.listen("estimator/labels", messages.Image)
        bench.until_subscribed()
        bench.expect(0)
        bench.other.destroy_subscription(ear)
        bench.until(lambda: not any(c.get_subscription_count() for c in bench.cameras.values()))
        bench.listen("estimator/layout", messages.Image)
        bench.until_subscribed()
        bench.send(1, info=False)  # the camera is still known
        bench.until(lambda: bench.heard["estimator/layout"])


def test_lazy_inputs_can_be_turned_off() -> None:
    with running(lazy_inputs=False) as bench:
        bench.until_subscribed()
        bench.send(0)
        bench.until(lambda: bench.health().published == 1)


def test_depth_only_does_without_colour() -> None:
    with running(use_color=False) as bench:
        bench.listen("estimator/overlay", messages.Image)
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.cameras["depth"].get_subscription_count())
        assert bench.cameras["color"].get_subscription_count() == 0
        bench.until(lambda: bench.cameras["camera_info"].get_subscription_count())
        bench.spin(0.2)
        bench.send(0, color=False)
        bench.until(lambda: bench.labels_of(0) and bench.heard["estimator/overlay"])
        assert bench.estimators[0].frames[-1].color is None
        assert bench.node.set_parameters([Parameter("use_color", value=True)])[0].successful
        bench.until_subscribed()
        bench.expect(1)
        assert bench.estimators[-1].frames[-1].color is not None


def test_colour_only_does_without_depth() -> None:
    with running(use_depth=False) as bench:
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.cameras["color"].get_subscription_count())
        bench.until(lambda: bench.cameras["camera_info"].get_subscription_count())
        bench.spin(0.2)
        bench.send(0, depth=False)
        bench.until(lambda: bench.labels_of(0))
        assert bench.estimators[0].frames[-1].depth_m is None


def test_a_warm_up_that_takes_long_says_so_until_it_is_over(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Compiling(GatedEstimator):
        def __init__(self, config: EstimatorConfig) -> None:
            super().__init__(config)
            self.gate.clear()

    monkeypatch.setattr("room_layout_ros.stages._PATIENCE_S", 0.1)
    with running(estimator=Compiling) as bench:
        bench.spin(0.35)
        bench.estimators[0].gate.set()
        bench.connect()
        bench.spin(0.3)
    said = capfd.readouterr().err
    assert 2 <= said.count("still compiling, 0 s so far; the next start is fast") <= 6
    assert "still compiling" not in said.partition("ready, warm after")[2]


def test_f40_an_exception_in_a_callback_does_not_end_the_node(monkeypatch: pytest.MonkeyPatch) -> None:
    import room_layout_ros.shell as node_module

    with running() as bench:
        bench.connect()

        def broken(*_: object) -> None:
            raise RuntimeError("boom")

        with monkeypatch.context() as patch:
            patch.setattr(node_module, "read_image", broken)
            bench.send(0)
            bench.spin(0.3)
        assert bench.health().made == 0
        bench.expect(1)
