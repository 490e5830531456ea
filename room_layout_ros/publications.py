"""The outputs of the node as publishers. They belong to one session: made with it, gone with it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from rclpy.exceptions import InvalidHandle
from rclpy.qos import QoSDurabilityPolicy, QoSPolicyKind, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from msg_adapters import messages
from msg_adapters.encode_room import encode_label_names

from .outputs import OUTPUTS
from .scene import Scene

LABEL_NAMES_TOPIC = "~/label_names"
DIAGNOSTICS_TOPIC = "/diagnostics"

_POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
"""What may be overridden of an output. Durability, because a reader that asks for the last grid, as of a map, gets
nothing of a publisher that does not keep it."""


def overrides(node: Any) -> list[str]:
    """Return the names of the parameters that override the QoS of the outputs, which are declared with these."""
    policies = [policy.name.lower() for policy in _POLICIES]
    topics = [node.resolve_topic_name(output.topic) for output in OUTPUTS]
    return [f"qos_overrides.{topic}.publisher.{policy}" for topic in topics for policy in policies]


class Sent(NamedTuple):
    """Whether anything that was sent lies in the floor frame; whether anybody listens to what needs a floor."""

    on_floor: bool
    floor_wanted: bool


class Publications:
    """Publishes until it is closed; what a thread that is late sends after that goes nowhere.

    Parameters
    ----------
    node : rclpy node
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._closed = False
        self._made: list[Any] = []
        try:
            overridable = QoSOverridingOptions(_POLICIES)
            self._outputs = [
                (o, self._make(o.message, o.topic, o.depth, qos_overriding_options=overridable)) for o in OUTPUTS
            ]
            latched = QoSProfile(
                depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
            )
            self._make(messages.String, LABEL_NAMES_TOPIC, latched).publish(encode_label_names())
            self._diagnostics = self._make(messages.DiagnosticArray, DIAGNOSTICS_TOPIC, 10)
        except BaseException:
            self.close()
            raise

    def has_listeners(self) -> bool:
        """Return whether anybody listens to an output."""
        return any(self._is_wanted(publisher) for _, publisher in self._outputs)

    def send(self, scene: Scene) -> Sent:
        """Encode and publish what has a listener, one after the other.

        Beside the kernels of free space it would take as long: encoding and publishing hold the interpreter's lock.
        """
        wanted = [(output, publisher) for output, publisher in self._outputs if self._is_wanted(publisher)]
        on_floor = False
        for output, publisher in wanted:
            for message in output.encode(scene):
                on_floor |= self._publish(publisher, message) and output.on_floor
        return Sent(on_floor, any(output.needs_floor for output, _ in wanted))

    def report(self, diagnostics: Any) -> None:
        """Publish a diagnostic_msgs/DiagnosticArray."""
        self._publish(self._diagnostics, diagnostics)

    def close(self) -> None:
        """Destroy all publishers."""
        self._closed = True
        for publisher in self._made:
            self._node.destroy_publisher(publisher)
        self._made = []

    def _make(self, *arguments: Any, **options: Any) -> Any:
        publisher = self._node.create_publisher(*arguments, **options)
        self._made.append(publisher)
        return publisher

    def _is_wanted(self, publisher: Any) -> bool:
        with self._until_closed():
            return bool(publisher.get_subscription_count())
        return False

    def _publish(self, publisher: Any, message: Any) -> bool:
        with self._until_closed():
            publisher.publish(message)
            return True
        return False

    @contextmanager
    def _until_closed(self) -> Iterator[None]:
        """Pass over a publisher that is gone since the end. (A lock would let callbacks wait for a slow publish.)"""
        try:
            yield
        except InvalidHandle:
            if not self._closed:
                raise
