"""Which topics the node listens to and says that it does: remapped, shared, latched, compressed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from dds_player import camera_info
from node_bench import Bench, QuickEstimator, running
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from room_frames import stamp_ns

from msg_adapters import messages
from room_layout_ros.estimator_node import EstimatorNode
from room_layout_ros.ros_process import unknown_remaps

pytestmark = pytest.mark.dds

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


def remapped(*rules: str) -> Callable[..., Any]:
    """Return what makes a node with remappings."""
    return partial(EstimatorNode, cli_args=["--ros-args", *(word for rule in rules for word in ("-r", rule))])


def topic(bench: Bench, name: str) -> str:
    """Return the topic that the newest diagnosis names for an input; "" before the first."""
    statuses = bench.heard["/diagnostics"][-1].status if bench.heard["/diagnostics"] else ()
    values = [v for s in statuses if s.name.endswith(f": input {name}") for v in s.values]
    return next((v.value for v in values if v.key == "topic"), "")


def listened(bench: Bench) -> list[str]:
    """Return the resolved topics of the node's subscriptions of images and their cameras."""
    kinds = (messages.Image, messages.CompressedImage, messages.CameraInfo)
    return sorted({s.topic_name for s in bench.node.subscriptions if s.msg_type in kinds})


BOTH = "/x1/depth/camera_info"
SHARED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "a topic of both camera_infos": ((f"rgb/camera_info:={BOTH}", f"depth/camera_info:={BOTH}"), {}),
    "the name of another input": (("rgb/camera_info:=depth/camera_info",), {}),
    "depth alone with its own camera": (
        ("depth_registered/image_rect:=depth/image_raw", "rgb/camera_info:=depth/camera_info"), {"use_color": False},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SHARED)
def test_two_inputs_may_come_on_one_topic(name: str) -> None:
    rules, values = SHARED[name]
    with running(remapped(*rules), **values) as bench:
        for stream, name in (("color", "colour"), ("depth", "depth"), ("camera_info", "camera_info")):
            kind: type = messages.CameraInfo if name == "camera_info" else messages.Image
            bench.until(partial(topic, bench, name))
            bench.cameras[stream] = bench.other.create_publisher(kind, topic(bench, name), QoSProfile(depth=10))
        bench.listen("estimator/labels", messages.Image)
        wanted = [s for s in bench.cameras if s != "color" or values.get("use_color", True)]
        bench.until(lambda: all(bench.cameras[s].get_subscription_count() for s in wanted))
        bench.spin(0.2)
        bench.send(0, color=None if "color" in wanted else False)
        bench.until(lambda: bench.labels_of(0))


def test_a_name_is_remapped_once() -> None:
    """The node resolved the name and ROS resolved it again: colour's camera came from the topic of the infrared's."""
    with running(remapped("rgb/camera_info:=depth/camera_info", "depth/camera_info:=/x2/ir/camera_info")) as bench:
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.cameras["depth"].get_subscription_count())
        assert f"{bench.namespace}/depth/camera_info" in listened(bench)
        bench.until(lambda: topic(bench, "camera_info") == f"{bench.namespace}/depth/camera_info")


COMPRESSED: dict[str, tuple[tuple[str, ...], str]] = {
    "image": (("rgb/image_rect_color:=/x3/image",), "/x3/image/compressed"),
    "transport": (("rgb/image_rect_color/compressed:=/x3/packed",), "/x3/packed"),
    "both": (("rgb/image_rect_color/compressed:=/x3/packed", "rgb/image_rect_color:=/x3/image"), "/x3/packed"),
    "transport of the remapped": (
        ("rgb/image_rect_color:=/x3/image", "/x3/image/compressed:=/x3/packed"), "/x3/packed",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", COMPRESSED)
def test_the_topic_that_is_named_is_the_one_that_is_subscribed(name: str) -> None:
    rules, expected = COMPRESSED[name]
    with running(remapped(*rules), color_transport="compressed") as bench:
        bench.listen("estimator/labels", messages.Image)
        bench.until(lambda: bench.cameras["depth"].get_subscription_count())
        assert expected in listened(bench)
        bench.until(lambda: topic(bench, "colour") == expected)


def test_f03_a_camera_info_that_was_latched_before_the_node_listened_is_used() -> None:
    with running() as bench:
        bench.other.destroy_publisher(bench.cameras["camera_info"])
        bench.cameras["camera_info"] = latched = bench.camera("camera_info", LATCHED)
        latched.publish(camera_info(0))
        bench.spin(0.5)
        bench.connect()
        bench.send(0, info=False)
        bench.until(lambda: bench.labels_of(0))
        stream = bench.health().streams["camera_info"]
        assert (stream.received, stream.paired, stream.lost) == (1, 1, 0)


def test_f03_what_a_latching_driver_sends_while_the_node_listens_counts_once() -> None:
    with running() as bench:
        bench.other.destroy_publisher(bench.cameras["camera_info"])
        bench.cameras["camera_info"] = latched = bench.camera("camera_info", LATCHED)
        bench.connect()
        for i in range(5):
            latched.publish(camera_info(stamp_ns(i)))
            bench.spin(0.05)
        same = camera_info(0)  # drivers that leave the stamp empty send the same bytes each time
        for _ in range(5):
            latched.publish(same)
            bench.spin(0.05)
        stream = bench.health().streams["camera_info"]
        assert (stream.received, stream.paired, stream.lost) == (10, 10, 0)
        bench.send(0, info=False)
        bench.until(lambda: bench.labels_of(0))


def test_f03_a_driver_that_does_not_latch_is_no_clash(capfd: pytest.CaptureFixture[str]) -> None:
    with running() as bench:
        bench.connect()
        bench.expect(0)
        bench.until(lambda: bench.well("input camera_info"))
        assert not bench.said("input camera_info", "QoS")
        assert bench.health().streams["camera_info"].received == 1
    assert "incompatible QoS" not in capfd.readouterr().err


FREE_SPACE = "estimator/free_space"


@pytest.mark.parametrize("durability", ("transient_local", "volatile"))
def test_the_grid_can_be_kept_for_readers_that_come_late(durability: str) -> None:
    """A map consumer (Nav2's StaticLayer, RViz's map) asks for a grid that was sent before it came."""

    def make(**options: Any) -> Any:
        name = f"qos_overrides.{options['namespace']}/{FREE_SPACE}.publisher.durability"
        options["parameter_overrides"].append(Parameter(name, value=durability))
        return EstimatorNode(**options)

    with running(make, pose_source="parameters", camera_height=1.3, camera_pitch_deg=6.0) as bench:
        first = bench.listen(FREE_SPACE, messages.OccupancyGrid)
        bench.until_subscribed()
        bench.send(0)
        bench.until(lambda: bench.heard[FREE_SPACE], 60.0)  # where it compiles
        bench.other.destroy_subscription(first)
        bench.heard[FREE_SPACE].clear()
        bench.listen(FREE_SPACE, messages.OccupancyGrid, LATCHED)
        if durability == "volatile":
            bench.spin(1.0)
            assert not bench.heard[FREE_SPACE]
        else:
            bench.until(lambda: bench.heard[FREE_SPACE])


def warnings(capfd: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capfd.readouterr().err.splitlines() if "changes nothing" in line]


def test_f33_an_override_of_a_topic_or_policy_that_is_none_is_a_warning_with_the_nearest_name(
    capfd: pytest.CaptureFixture[str],
) -> None:
    def make(**options: Any) -> Any:
        prefix = f"qos_overrides.{options['namespace']}"
        for name in ("/rgb/image_rect_colour.subscription.reliability", "/estimator/scan.publisher.liveliness"):
            options["parameter_overrides"].append(Parameter(prefix + name, value="reliable"))
        return EstimatorNode(**options)

    with running(make) as bench:
        own, topic = bench.namespace, "/rgb/image_rect_color.subscription.reliability"
    colour, scan = sorted(warnings(capfd), key=lambda line: "scan" in line)
    assert f"'qos_overrides.{own}/rgb/image_rect_colour.subscription.reliability' changes nothing" in colour
    assert colour.endswith(f"the nearest name is qos_overrides.{own}{topic}")
    assert f"the nearest name is qos_overrides.{own}/estimator/scan.publisher." in scan


KNOWN = (
    "rgb/camera_info:=/a",
    "/rgb/camera_info:=/a",
    "estimator:imu:=/b",
    "__ns:=/x",
    "/tf:=tf",
    "~/labels:=/c",
    "estimator/scan:=/scan",
    "/diagnostics:=/d",
    "rosservice://~/set_parameters:=/e",
    "~/label_names:=/f",
    "depth_registered/image_rect/compressedDepth:=/g",
)
NEAREST = "changes nothing: no topic or service of this node; the nearest name is"
REMAPS = {
    KNOWN: (),
    ("rviz2:rgb/camera_nfo:=/a",): (),
    ("rgb/image_rect_colour:=/a",): (f"'rgb/image_rect_colour:=/a' {NEAREST} rgb/image_rect_color",),
    ("depth_registered/image:=/a",): (f"{NEAREST} depth_registered/image_rect",),
    ("estimator:~/label:=/b", "xyzzy:=/c"): (f"{NEAREST} ~/labels", "node; docs/topics.md has all of them"),
}
"""Rules of a command line, and how the sentences about them end."""


@pytest.mark.parametrize("rules", REMAPS)
def test_f33_a_remapping_of_a_name_that_is_none_is_a_sentence_with_the_nearest(rules: tuple[str, ...]) -> None:
    expected, quick = REMAPS[rules], cast("Any", QuickEstimator)
    args = ["estimator", "--ros-args", *(word for rule in rules for word in ("-r", rule)), "--", "-r", "zzz:=/a"]
    context = Context()
    context.init(args=[])
    try:
        node = EstimatorNode(quick, context=context)
        said = list(unknown_remaps(node, args, node.shell.topics()))
        node.close()
        node.destroy_node()
    finally:
        context.try_shutdown()
    assert len(said) == len(expected)
    for sentence, words in zip(said, expected, strict=True):
        assert sentence.endswith(words), sentence
