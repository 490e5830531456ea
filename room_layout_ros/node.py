"""The ROS 2 node `estimator`: a thin shell around `EstimatorSession` and `LayoutEstimator`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import cv2
import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.utilities import ok, try_shutdown

from msg_adapters import messages
from msg_adapters.camera_info import CameraReading
from msg_adapters.encode_diagnostics import encode_diagnostics
from msg_adapters.encode_room import encode_label_names

from . import parameters
from .core.config import EstimatorConfig
from .core.estimate import RoomEstimate
from .core.estimator import LayoutEstimator
from .core.frame import RgbdFrame
from .core.tracking import TemporalPrior
from .inputs import INPUT_TOPICS, assemble, read_camera, read_image
from .node_config import NodeConfig
from .outputs import OUTPUTS, send
from .runtime.diagnosis import Finding, InputFacts, Level, NodeFacts, diagnose
from .runtime.pairing import COLOR, DEPTH, Pair, PairingRules
from .runtime.session import CAMERA, EstimatorSession, RefusedError, SessionRules
from .runtime.throttle import Throttle
from .runtime.warm_up import warm_up_frame

NODE_NAME = "estimator"
LABEL_NAMES_TOPIC = "~/label_names"
DIAGNOSTICS_TOPIC = "/diagnostics"

_SENSOR_DEPTH = 5
_LISTENER_PERIOD_S = 0.1
_REPEAT_S = 10.0
_EXIT_S = 1.0
"""The process must be out two seconds after the signal; a frame in hand gets this long."""


class Estimator(Protocol):
    """What the node needs of the algorithm."""

    config: EstimatorConfig

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None = None) -> RoomEstimate:
        """Estimate the room in one frame."""
        ...


MakeEstimator = Callable[[EstimatorConfig], Estimator]


@dataclass(frozen=True, slots=True)
class _Settings:
    """One consistent set, replaced as a whole: each frame uses one set."""

    node: NodeConfig
    estimator: Estimator

    def rules(self) -> SessionRules:
        config = self.estimator.config
        pairing = PairingRules(
            max_gap_ns=round(self.node.max_stamp_gap * 1e9),
            reset_gap_ns=round(self.node.reset_gap * 1e9),
            queue_size=self.node.queue_size,
            use_color=config.use_color,
            use_depth=config.use_depth,
        )
        return SessionRules(pairing, self.node.warm_start)


class Shell:
    """Topics, parameters and timers of an estimator inside any node, plain or lifecycle.

    The order of calls is configure, activate, deactivate, cleanup; each may be repeated. All of them, and all
    callbacks, run in the executor; `Stages` methods run in the session's worker.
    """

    def __init__(self, node: Any, make_estimator: MakeEstimator) -> None:
        self._node, self._make_estimator = node, make_estimator
        self._throttle = Throttle()
        parameters.declare(node, (EstimatorConfig, NodeConfig))
        self._settings = self._read_settings()
        node.add_on_set_parameters_callback(self._check_parameters)
        node.add_post_set_parameters_callback(self._apply_parameters)
        self._session: EstimatorSession | None = None
        self._publishers: list[tuple[Any, Any]] = []
        self._own: list[Any] = []
        self._timers: list[Any] = []
        self._inputs: dict[str, Any] = {}
        self._clashes: dict[str, str] = {}
        self._active = False
        self._subscribed_at = 0.0
        self._told: dict[str, tuple[str, float]] = {}
        self._jumps = node.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False),
            post_callback=self._on_clock_jump,
        )

    # ---- states

    def configure(self) -> None:
        """Make the publishers and start to warm up."""
        node, sensible = self._node, QoSOverridingOptions.with_default_policies()
        for output in OUTPUTS:
            publisher = node.create_publisher(
                output.message, output.topic, output.depth, qos_overriding_options=sensible
            )
            self._publishers.append((output, publisher))
        latched = QoSProfile(
            depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
        )
        label_names = node.create_publisher(messages.String, LABEL_NAMES_TOPIC, latched)
        label_names.publish(encode_label_names())
        self._diagnostics = node.create_publisher(messages.DiagnosticArray, DIAGNOSTICS_TOPIC, 10)
        self._own = [label_names, self._diagnostics]
        self._session = EstimatorSession(self, self._settings.rules())
        self._health = self._session.health()
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # sim time may stand still
        for name, period_s, work in (
            ("listeners", _LISTENER_PERIOD_S, self._follow_listeners),
            ("diagnostics", self._settings.node.diagnostics_period, self._publish_diagnostics),
        ):
            self._timers.append(node.create_timer(period_s, partial(self._guard, name, work), clock=steady))

    def activate(self) -> None:
        """Allow the inputs to be subscribed."""
        self._active = True

    def deactivate(self) -> None:
        """Drop the inputs."""
        self._active = False
        self._unsubscribe()

    def cleanup(self) -> bool:
        """Undo `configure`; return False if the worker is still inside a frame (it is left to end by itself)."""
        self.deactivate()
        ended = self._session is None or self._session.close(_EXIT_S)
        self._session = None
        for timer in self._timers:
            self._node.destroy_timer(timer)
        if ended:
            for publisher in (*self._own, *(p for _, p in self._publishers)):
                self._node.destroy_publisher(publisher)
        self._timers, self._publishers, self._own = [], [], []
        return ended

    # ---- stages, called by the session's worker

    def warm_up(self) -> None:
        """Run one made-up frame through everything."""
        self._node.get_logger().info("warming up (compiles the first time)")
        start = time.monotonic()
        cv2.setNumThreads(1)  # OpenCV's pool only steals the core of the callbacks
        frame = warm_up_frame()
        estimate = self._settings.estimator.estimate(frame)
        for output in OUTPUTS:
            output.encode(frame, estimate, self._settings.node)
        self._node.get_logger().info(f"warm after {time.monotonic() - start:.1f} s")

    def assemble(self, pair: Pair[Any], camera: CameraReading) -> RgbdFrame:
        """Decode a pair."""
        return assemble(pair, camera)

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None) -> RoomEstimate:
        """Estimate the room."""
        return self._settings.estimator.estimate(frame, prior)

    def publish(self, frame: RgbdFrame, estimate: RoomEstimate) -> None:
        """Send what somebody listens to."""
        send(frame, estimate, self._settings.node, self._publishers)

    def complain(self, cause: str, sentence: str) -> None:
        """Log, at most one line per second and cause."""
        held = self._throttle.due(cause)
        if held is not None and ok(context=self._node.context):
            self._node.get_logger().error(f"{sentence} [{held} more]" if held else sentence)

    def now_ns(self) -> int:
        """Time on the node's clock."""
        return int(self._node.get_clock().now().nanoseconds)

    # ---- inputs

    def _follow_listeners(self) -> None:
        wanted = self._state() == "running"
        if wanted and not self._inputs:
            self._subscribe()
        elif not wanted and self._inputs:
            self._unsubscribe()

    def _state(self) -> str:
        if not self._active:
            return "inactive"
        if self._session is None or not self._session.ready:
            return "warming up"
        if self._waits_for_clock():
            return "waiting for /clock (use_sim_time is true)"
        listeners = any(p.get_subscription_count() for _, p in self._publishers)
        if self._settings.node.lazy_inputs and not listeners:
            return "idle: nobody listens to an output"
        return "running"

    def _waits_for_clock(self) -> bool:
        return bool(self._node.get_parameter("use_sim_time").value) and self.now_ns() == 0

    def _subscribe(self) -> None:
        kinds = {COLOR: messages.Image, DEPTH: messages.Image, CAMERA: messages.CameraInfo}
        used = self._used()
        for stream, topic in INPUT_TOPICS.items():
            if not used[stream]:
                continue
            qos = QoSProfile(depth=_SENSOR_DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT)
            events = SubscriptionEventCallbacks(
                message_lost=partial(self._on_lost, stream), incompatible_qos=partial(self._on_clash, stream)
            )
            self._inputs[stream] = self._node.create_subscription(
                kinds[stream],
                topic,
                partial(self._guard, f"callback of {stream}", self._on_message, stream),
                qos,
                event_callbacks=events,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                raw=True,
            )
        self._subscribed_at = time.monotonic()
        self._node.get_logger().info(f"listening to {', '.join(s.topic_name for s in self._inputs.values())}")

    def _unsubscribe(self) -> None:
        for subscription in self._inputs.values():
            self._node.destroy_subscription(subscription)
        if self._inputs and self._session is not None:
            self._session.reset()
        self._inputs, self._clashes = {}, {}

    def _used(self) -> dict[str, bool]:
        config = self._settings.estimator.config
        return {COLOR: config.use_color, DEPTH: config.use_depth, CAMERA: True}

    def _on_message(self, stream: str, serialized: bytes) -> None:
        if self._session is None:
            return
        self._clashes.pop(stream, None)
        try:
            if stream == CAMERA:
                stamp_ns, camera = read_camera(serialized)
                if self._session.add_camera(stamp_ns, camera) and camera.warning:
                    self._node.get_logger().warning(camera.warning)
            else:
                self._session.add_image(stream, *read_image(stream, serialized))
        except RefusedError as refused:
            self._session.refuse(stream, refused.reason, str(refused))

    def _on_lost(self, stream: str, info: Any) -> None:
        if self._session is not None:
            self._session.count_lost(stream, info.total_count_change)

    def _on_clash(self, stream: str, info: Any) -> None:
        self._clashes[stream] = qos_policy_name_from_kind(info.last_policy_kind)

    def _on_clock_jump(self, jump: Any) -> None:
        if self._session is not None and self._inputs:
            back_s = -jump.delta.nanoseconds * 1e-9
            self.complain("jump of the clock", f"/clock jumped back by {back_s:.1f} s; starting afresh")
            self._session.reset()

    def _guard(self, what: str, work: Callable[..., None], *arguments: Any) -> None:
        """Run a callback: what it raises is logged here and does not leave `spin`."""
        try:
            work(*arguments)
        except Exception as error:  # noqa: BLE001
            self.complain(what, f"{type(error).__name__} in {what}: {error}")

    # ---- parameters

    def _read_settings(self) -> _Settings:
        config = parameters.read(self._node, EstimatorConfig)
        return _Settings(parameters.read(self._node, NodeConfig), self._make_estimator(config))

    def _changed(self, changes: Sequence[Any]) -> tuple[EstimatorConfig, NodeConfig]:
        values = {p.name: p.value for p in changes}
        estimator = parameters.changed(self._settings.estimator.config, values)
        return estimator, parameters.changed(self._settings.node, values)

    def _check_parameters(self, changes: Sequence[Any]) -> SetParametersResult:
        try:
            self._changed(changes)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changes: Sequence[Any]) -> None:
        config, node = self._changed(changes)
        before, used = self._settings.estimator, self._used()
        estimator = before if config == before.config else self._make_estimator(config)
        self._settings = _Settings(node, estimator)
        if self._session is not None:
            self._session.configure(self._settings.rules())
        if used != self._used():
            self._unsubscribe()  # the timer subscribes anew

    # ---- diagnostics

    def _publish_diagnostics(self) -> None:
        if self._session is None:
            return
        health = self._session.health()
        findings = diagnose(health, self._health, self._facts())
        self._health = health
        self._diagnostics.publish(
            encode_diagnostics(findings, self._node.get_fully_qualified_name().lstrip("/"), self.now_ns())
        )
        for finding in findings:
            self._tell(finding)

    def _facts(self) -> NodeFacts:
        node, used = self._node, self._used()
        inputs = {}
        for stream, topic in INPUT_TOPICS.items():
            resolved = node.resolve_topic_name(topic)
            inputs[stream] = InputFacts(
                resolved, used[stream], node.count_publishers(resolved), self._clashes.get(stream, "")
            )
        return NodeFacts(
            inputs=inputs,
            state=self._state(),
            listening_s=time.monotonic() - self._subscribed_at if self._inputs else 0.0,
            no_data_timeout_s=self._settings.node.no_data_timeout,
            max_stamp_gap_s=self._settings.node.max_stamp_gap,
            profile=str(dds_profile()),
        )

    def _tell(self, finding: Finding) -> None:
        """Log a finding when it turns up, every ten seconds while it lasts, and when it is over."""
        kind = finding.message.split(" for ")[0] if finding.level >= Level.WARN else ""
        before, at = self._told.get(finding.name, ("", 0.0))
        now = time.monotonic()
        if kind and not finding.logged and (kind != before or now - at >= _REPEAT_S):
            self._node.get_logger().warning(finding.message)
            self._told[finding.name] = (kind, now)
        elif not kind and before:
            self._node.get_logger().info(f"{finding.name}: {finding.message}")
            self._told.pop(finding.name)


def dds_profile() -> Path:
    """Return the shipped Fast DDS profile, in the source tree or where pip or colcon put it."""
    here = Path(__file__).resolve()
    installed = [p / "share" / "room_layout_ros" for p in here.parents]
    for folder in (here.parent.parent, *installed):
        if (folder / "config" / "fastdds.xml").is_file():
            return folder / "config" / "fastdds.xml"
    return Path("config/fastdds.xml")


class EstimatorNode(Node):
    """The plain node: works from the start."""

    def __init__(self, make_estimator: MakeEstimator = LayoutEstimator, **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self.shell = Shell(self, make_estimator)
        self.shell.configure()
        self.shell.activate()

    def close(self) -> bool:
        """End the worker; False if it is still inside a frame."""
        return self.shell.cleanup()


class EstimatorLifecycleNode(LifecycleNode):
    """The lifecycle node: configure makes the topics and warms up, activate subscribes."""

    def __init__(self, make_estimator: MakeEstimator = LayoutEstimator, **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        self.shell = Shell(self, make_estimator)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured -> inactive."""
        return self._transition(self.shell.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive -> active."""
        return self._transition(self.shell.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active -> inactive."""
        return self._transition(self.shell.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive -> unconfigured."""
        return self._transition(self.shell.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Any -> finalized."""
        return self._transition(self.shell.cleanup)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """After a failed transition: back to unconfigured."""
        return self._transition(self.shell.cleanup)

    def close(self) -> bool:
        """End the worker; False if it is still inside a frame."""
        return self.shell.cleanup()

    def _transition(self, work: Callable[[], Any]) -> TransitionCallbackReturn:
        try:
            work()
        except Exception as error:  # noqa: BLE001  rclpy swallows it without a word
            self.get_logger().error(f"{type(error).__name__} in a transition: {error}")
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS


def main(args: Sequence[str] | None = None) -> int:
    """Run the plain node until SIGINT or SIGTERM; 0 at the end, 2 when the settings are wrong."""
    return _run(EstimatorNode, args)


def lifecycle_main(args: Sequence[str] | None = None) -> int:
    """Run the lifecycle node until SIGINT or SIGTERM."""
    return _run(EstimatorLifecycleNode, args)


def _run(make_node: Callable[[], Any], args: Sequence[str] | None) -> int:
    ended = True
    try:
        try:
            rclpy.init(args=None if args is None else list(args))
            node = make_node()
        except (KeyboardInterrupt, ExternalShutdownException):
            return 0
        except (
            ValueError,
            ParameterException,
            NameValidationException,
            InvalidQosOverridesError,
            RuntimeError,
        ) as error:
            print(f"estimator: {error}", file=sys.stderr)  # RuntimeError: what rcl says of its arguments and files
            return 2
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            _spin(executor, node)
        finally:
            ended = node.close()
    except KeyboardInterrupt:  # a second Ctrl-C during the end
        ended = False
    finally:
        try_shutdown()
        if not ended:  # a worker inside a compilation cannot be stopped
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)
    return 0


def _spin(executor: SingleThreadedExecutor, node: Any) -> None:
    while ok():
        try:
            executor.spin()
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception as error:  # noqa: BLE001
            node.shell.complain("executor", f"{type(error).__name__} in the executor: {error}")
            time.sleep(0.01)


if __name__ == "__main__":
    sys.exit(main())
