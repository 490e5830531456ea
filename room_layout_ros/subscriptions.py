"""The inputs of the node as subscriptions: raw, guarded, with what the middleware says of losses and clashes."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from msg_adapters import messages

from .inputs import IMU_TOPIC, INPUT_TOPICS, TRANSPORTS, transport_of
from .runtime.diagnosis import InputFacts
from .runtime.pairing import COLOR, DEPTH
from .runtime.session import CAMERA, CAMERAS, DEPTH_CAMERA, IMU
from .settings import Settings

_DEPTH = 5
_REMEMBERED = 32
"""Messages of camera_info that may come a second time: as many as can wait in both subscriptions, and more."""
_TF_TOPICS = ("/tf", "/tf_static")

_OVERRIDES: tuple[tuple[str, str | int, tuple[str, ...]], ...] = (
    ("history", "keep_last", tuple(p.name.lower() for p in QoSHistoryPolicy if p.name != "UNKNOWN")),
    ("depth", _DEPTH, ()),
    ("reliability", "best_effort", tuple(p.name.lower() for p in QoSReliabilityPolicy if p.name != "UNKNOWN")),
)
"""Policy, default and what is allowed (a number of messages where nothing is named)."""


class Subscriptions:
    """Subscribes to what the settings need and drops it again.

    camera_info of a driver that latches it (sends it once, perhaps before we listen) is subscribed a second time: only
    a reader that asks for durability gets what was sent before, and it gets nothing of a driver that does not latch,
    which would warn of it. What comes both ways counts once.

    Parameters
    ----------
    node : rclpy node
    guard : callable
        `guard(what, work, *arguments)` runs a callback and lets no exception out.
    on_message : callable
        `on_message(stream, serialized)`.
    on_imu : callable
        `on_imu(message)`.
    on_lost : callable
        `on_lost(stream, number)` of messages that were sent while we listened and never came here.
    """

    def __init__(
        self,
        node: Any,
        guard: Callable[..., None],
        on_message: Callable[[str, bytes], None],
        on_imu: Callable[[Any], None],
        on_lost: Callable[[str, int], None],
    ) -> None:
        self._node, self._guard = node, guard
        self._on_message, self._on_imu, self._on_lost = on_message, on_imu, on_lost
        self._open: dict[str, Any] = {}
        self._latched: dict[str, Any] = {}
        self._seen: dict[str, deque[tuple[int, bytes]]] = {}
        self._clashes: dict[str, str] = {}
        self._numbers: dict[str, int] = {}
        self._told: dict[str, float] = {}  # when the middleware last told of lost messages
        self._since = 0.0
        self._declare_qos()

    def __bool__(self) -> bool:
        return bool(self._open)

    @property
    def listening_s(self) -> float:
        """Time since the inputs were subscribed, 0 without."""
        return time.monotonic() - self._since if self._open else 0.0

    def open(self, settings: Settings) -> None:
        """Subscribe to each stream that the settings need."""
        for stream, wanted in settings.used().items():
            if wanted:
                self._subscribe(stream, settings)
        if settings.node.pose_source == "imu":
            callback = partial(self._guard, "callback of imu", self._take_imu)
            events = SubscriptionEventCallbacks(incompatible_qos=partial(self._clash, IMU))
            self._open[IMU] = self._node.create_subscription(
                messages.Imu, IMU_TOPIC, callback, event_callbacks=events, **_qos()
            )
        self._since = time.monotonic()
        self._node.get_logger().info(f"listening to {', '.join(s.topic_name for s in self._open.values())}")

    def close(self) -> None:
        """Drop all subscriptions."""
        for subscription in (*self._open.values(), *self._latched.values()):
            self._node.destroy_subscription(subscription)
        self._open, self._latched, self._seen, self._clashes, self._numbers, self._told = {}, {}, {}, {}, {}, {}

    def follow(self) -> None:
        """Subscribe camera_info for a second time where somebody latches it; to be called now and then."""
        for stream in CAMERAS:
            if stream in self._open and stream not in self._latched and self._is_latched(stream):
                self._subscribe_latched(stream)

    def facts(self, settings: Settings) -> dict[str, InputFacts]:
        """Return what graph and middleware say about each input, for the diagnosis."""
        facts = {}
        recent_s = time.monotonic() - settings.node.no_data_timeout
        for stream, wanted in settings.used().items():
            file = settings.depth_camera if stream == DEPTH_CAMERA and not settings.node.depth_registered else None
            if wanted or file is not None or stream in (COLOR, DEPTH, CAMERA):
                topic = self._topic(stream, settings)
                publishers = self._node.count_publishers(topic)
                pose = _extrinsics(settings) if stream == DEPTH else ""
                elsewhere = "" if publishers else self._elsewhere(stream)
                clash = self._clashes.get(stream, "")
                lost = self._told.get(stream, -math.inf) > recent_s
                facts[stream] = InputFacts(
                    topic, wanted, publishers, clash, pose, elsewhere=elsewhere, lost_on_way=lost
                )
        if settings.node.pose_source == "imu":
            topic = self._node.resolve_topic_name(IMU_TOPIC)
            facts[IMU] = InputFacts(topic, True, self._node.count_publishers(topic), self._clashes.get(IMU, ""))
        return facts

    def tf_publishers(self) -> int:
        """Return how many publish TF beside this node, which sends its floor's frame there."""
        own = self._node.get_namespace(), self._node.get_name()
        ends = [end for topic in _TF_TOPICS for end in self._node.get_publishers_info_by_topic(topic)]  # it remaps them
        return sum((end.node_namespace, end.node_name) != own for end in ends)

    def names(self) -> list[str]:
        """Return the name, as it is given to ROS, of every topic that the settings may ask for."""
        kinds = [(stream, kind) for stream in INPUT_TOPICS for kind in TRANSPORTS.get(stream, ("raw",))]
        return [*(self._name(stream, kind) for stream, kind in kinds), IMU_TOPIC]

    def topics(self) -> list[str]:
        """Return these names resolved, each once."""
        return list(dict.fromkeys(self._node.resolve_topic_name(name) for name in self.names()))

    def overrides(self) -> list[str]:
        """Return the names of the parameters that override the QoS of the inputs."""
        policies = [policy for policy, _, _ in _OVERRIDES]
        return [f"qos_overrides.{topic}.subscription.{policy}" for topic in self.topics() for policy in policies]

    def _topic(self, stream: str, settings: Settings) -> str:
        """Return the resolved name of the topic that is subscribed."""
        topic: str = self._node.resolve_topic_name(self._name(stream, transport_of(stream, settings.node)))
        return topic

    def _elsewhere(self, stream: str) -> str:
        """Say which other transport of a stream somebody publishes, and what takes it; "" where nobody does."""
        for kind in TRANSPORTS.get(stream, ()):
            topic = self._node.resolve_topic_name(self._name(stream, kind))
            if self._node.count_publishers(topic):
                return f"{topic} is there; set {stream}_transport to {kind}"
        return ""

    def _name(self, stream: str, transport: str) -> str:
        """Return the name by which a topic is subscribed; ROS resolves it then, so that it must not be resolved before.

        image_transport puts the transport behind the remapped name. A rule for the topic of the transport goes before.
        """
        resolve, name = self._node.resolve_topic_name, INPUT_TOPICS[stream]
        if transport == "raw":
            return name
        own = f"{name}/{transport}"
        return own if resolve(own) != resolve(own, only_expand=True) else f"{resolve(name)}/{transport}"

    def _declare_qos(self) -> None:
        """Declare the QoS overrides of every topic that the settings may ask for; two inputs may come on one.

        rclpy would look at them only when a topic is subscribed, which is when somebody listens to the results.

        Raises
        ------
        ValueError
            When a value is no policy.
        """
        for topic in self.topics():
            for policy, default, allowed in _OVERRIDES:
                name = f"qos_overrides.{topic}.subscription.{policy}"
                about = ParameterDescriptor(description=f"{policy} of the subscription", read_only=True)
                value = self._node.declare_parameter(name, default, about).value
                if allowed and value not in allowed:
                    raise ValueError(f"{name} is {str(value)[:40]!r}; allowed are {', '.join(allowed)}")
                if not allowed and value < 1:
                    raise ValueError(f"{name} is {value}; it must be at least 1")

    def _subscribe(self, stream: str, settings: Settings) -> None:
        kind: type = messages.CameraInfo if stream in CAMERAS else messages.Image
        if transport_of(stream, settings.node) != "raw":
            kind = messages.CompressedImage
        events = SubscriptionEventCallbacks(
            message_lost=partial(self._lost, stream), incompatible_qos=partial(self._clash, stream)
        )

        def callback(serialized: bytes, info: Any) -> None:  # rclpy tells info only to functions of two arguments
            self._guard(f"callback of {stream}", self._take, stream, serialized, info)

        self._open[stream] = self._node.create_subscription(
            kind,
            self._name(stream, transport_of(stream, settings.node)),
            callback,
            event_callbacks=events,
            raw=True,
            **_qos(),
        )

    def _is_latched(self, stream: str) -> bool:
        publishers = self._node.get_publishers_info_by_topic(INPUT_TOPICS[stream])
        return any(p.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for p in publishers)

    def _subscribe_latched(self, stream: str) -> None:
        def callback(serialized: bytes, info: Any) -> None:
            self._guard(f"callback of {stream}", self._pass_on, stream, serialized, info)

        self._latched[stream] = self._node.create_subscription(
            messages.CameraInfo,
            INPUT_TOPICS[stream],
            callback,
            QoSProfile(
                depth=_DEPTH,
                reliability=QoSReliabilityPolicy.RELIABLE,
                durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
            ),
            raw=True,
        )

    def _take(self, stream: str, serialized: bytes, info: Any) -> None:
        self._clashes.pop(stream, None)
        number = info.get("publication_sequence_number")
        if number is not None:
            self._count_gap(stream, number)
        self._pass_on(stream, serialized, info)

    def _pass_on(self, stream: str, serialized: bytes, info: Any) -> None:
        if self._is_new(stream, serialized, info):
            self._on_message(stream, serialized)

    def _is_new(self, stream: str, serialized: bytes, info: Any) -> bool:
        """Return False for a message that has come by the other subscription of its topic."""
        if stream not in CAMERAS:
            return True
        seen = self._seen.setdefault(stream, deque(maxlen=_REMEMBERED))
        message = info["source_timestamp"], serialized
        if message in seen:
            return False
        seen.append(message)
        return True

    def _take_imu(self, message: Any) -> None:
        self._clashes.pop(IMU, None)
        self._on_imu(message)

    def _count_gap(self, stream: str, number: int) -> None:
        """Count messages that the publisher numbered and that did not come.

        The middleware tells of those that it lost on the way, not of those that newer ones replaced in its queue
        because this process got no time to take them. With two publishers the numbers say nothing.
        """
        before, self._numbers[stream] = self._numbers.get(stream), number
        subscription = self._open.get(stream)
        if before is not None and number > before + 1 and subscription and subscription.get_publisher_count() == 1:
            self._on_lost(stream, number - before - 1)

    def _lost(self, stream: str, info: Any) -> None:
        self._told[stream] = time.monotonic()
        if stream not in self._numbers:  # a middleware without numbers
            self._on_lost(stream, info.total_count_change)

    def _clash(self, stream: str, info: Any) -> None:
        self._clashes[stream] = qos_policy_name_from_kind(info.last_policy_kind)


def _extrinsics(settings: Settings) -> str:
    """Say where the depth camera's pose comes from; "" where none is needed."""
    config = settings.estimator.config
    if settings.node.depth_registered or not (config.use_color and config.use_depth):
        return ""
    return "parameter depth_to_color" if settings.node.depth_to_color else "TF"


def _qos() -> dict[str, Any]:
    return {
        "qos_profile": QoSProfile(depth=_DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT),
        "qos_overriding_options": QoSOverridingOptions.with_default_policies(),
    }
