"""The outputs of the node as publishers. They belong to one session: made with it, gone with it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from rclpy.exceptions import InvalidHandle
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from msg_adapters import messages
from msg_adapters.encode_room import encode_label_names

from .core.stage_clock import StageClock
from .outputs import OUTPUTS, Output
from .scene import Scene

LABEL_NAMES_TOPIC = "~/label_names"
DIAGNOSTICS_TOPIC = "/diagnostics"


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
            overridable = QoSOverridingOptions.with_default_policies()
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
        """Encode and publish what has a listener; pictures are encoded while free space is computed."""
        wanted = [(output, publisher) for output, publisher in self._outputs if self._is_wanted(publisher)]
        pictures, of_floor = ([w for w in wanted if w[0].needs_floor == needs] for needs in (False, True))
        with StageClock().beside("pictures", self._send, pictures, scene) as sent:
            on_floor = self._send(of_floor, scene)
            on_floor |= sent()
        return Sent(on_floor, bool(of_floor))

    def _send(self, outputs: Iterable[tuple[Output, Any]], scene: Scene) -> bool:
        """Encode and publish some of them; return whether any message lies in the floor frame."""
        on_floor = False
        for output, publisher in outputs:
            for message in output.encode(scene):
                on_floor |= self._publish(publisher, message) and output.on_floor
        return on_floor

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
