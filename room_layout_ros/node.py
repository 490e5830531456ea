"""The ROS 2 node `estimator`: a thin shell around `EstimatorSession` and `LayoutEstimator`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import rclpy
from numpy.typing import NDArray
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
from msg_adapters.encode_navigation import encode_transform
from msg_adapters.encode_room import encode_label_names
from msg_adapters.stamp import decode_stamp

from . import parameters
from .core.config import EstimatorConfig
from .core.estimate import RoomEstimate
from .core.estimator import LayoutEstimator
from .core.frame import RgbdFrame
from .core.tracking import TemporalPrior
from .datasets.calibration import read_calibration
from .floor_pose import FloorPose
from .inputs import INPUT_TOPICS, ImageItem, assemble, read_camera, read_image, transport_of, used_inputs
from .node_config import NodeConfig
from .outputs import OUTPUTS, send
from .runtime.diagnosis import Finding, InputFacts, Level, NodeFacts, diagnose
from .runtime.pairing import COLOR, DEPTH, Pair, PairingRules
from .runtime.session import CAMERA, CAMERAS, EstimatorSession, RefusedError, SessionRules
from .runtime.throttle import Throttle
from .runtime.warm_up import warm_up_frame
from .scene import Scene
from .transforms import Transforms

NODE_NAME = "estimator"
LABEL_NAMES_TOPIC = "~/label_names"
DIAGNOSTICS_TOPIC = "/diagnostics"

IMU_TOPIC = "imu"

_SUBSCRIPTION = attrgetter("color_transport", "depth_transport", "depth_registered", "pose_source")
"""Settings that need the inputs to be subscribed anew."""
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
    camera: CameraReading | None = None
    """From a file, in the place of camera_info."""

    def used(self) -> dict[str, bool]:
        """Return which streams are needed."""
        return used_inputs(self.node, self.estimator.config)

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
        self._transforms = Transforms(node)
        self._floor_pose = FloorPose(self._transforms.find)
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
        if self._settings.camera is not None:
            self._session.add_camera(CAMERA, 0, self._settings.camera)
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
        settings = self._settings
        scene = Scene(frame, settings.estimator.estimate(frame), settings.node, settings.estimator.config)
        for output in OUTPUTS:
            output.encode(scene)
        self._node.get_logger().info(f"warm after {time.monotonic() - start:.1f} s")

    def assemble(self, pair: Pair[ImageItem], cameras: Mapping[str, CameraReading | None]) -> RgbdFrame:
        """Decode a pair."""
        return assemble(pair, cameras, self._settings.node, self._transforms.find)

    def gravity(self, frame: RgbdFrame) -> NDArray[np.float64] | None:
        """Say which way is down."""
        floor = self._floor_pose.expect(frame.frame_id, frame.stamp_ns, self._settings.node)
        return None if floor is None else floor.normal

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None) -> RoomEstimate:
        """Estimate the room."""
        return self._settings.estimator.estimate(frame, prior)

    def publish(self, frame: RgbdFrame, estimate: RoomEstimate) -> None:
        """Send what somebody listens to."""
        settings = self._settings
        floor = self._floor_pose.expect(frame.frame_id, frame.stamp_ns, settings.node)
        scene = Scene(frame, estimate, settings.node, settings.estimator.config, floor)
        on_floor = send(scene, self._publishers)
        if on_floor and scene.free_space is not None and settings.node.broadcast_floor:
            T_camera_floor = scene.free_space.T_camera_floor
            self._transforms.broadcast(
                encode_transform(T_camera_floor, frame.stamp_ns, frame.frame_id, scene.floor_frame)
            )

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
        settings = self._settings
        if settings.node.pose_source in ("auto", "tf", "imu") or not settings.node.depth_registered:
            self._transforms.listen()
        for stream, wanted in settings.used().items():
            if not wanted:
                continue
            topic = self._topic(stream)
            qos = QoSProfile(depth=_SENSOR_DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT)
            events = SubscriptionEventCallbacks(
                message_lost=partial(self._on_lost, stream), incompatible_qos=partial(self._on_clash, stream)
            )
            self._inputs[stream] = self._node.create_subscription(
                self._message_kind(stream),
                topic,
                partial(self._guard, f"callback of {stream}", self._on_message, stream),
                qos,
                event_callbacks=events,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                raw=True,
            )
        if settings.node.pose_source == "imu":
            qos = QoSProfile(depth=_SENSOR_DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT)
            self._inputs[IMU_TOPIC] = self._node.create_subscription(
                messages.Imu,
                IMU_TOPIC,
                partial(self._guard, "callback of imu", self._on_imu),
                qos,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
        self._subscribed_at = time.monotonic()
        self._node.get_logger().info(f"listening to {', '.join(s.topic_name for s in self._inputs.values())}")

    def _unsubscribe(self) -> None:
        for subscription in self._inputs.values():
            self._node.destroy_subscription(subscription)
        if self._inputs and self._session is not None:
            self._session.reset()
        self._inputs, self._clashes = {}, {}
        self._floor_pose.reset()

    def _topic(self, stream: str) -> str:
        """Return the resolved topic of a stream; image_transport puts the transport behind the remapped name."""
        base: str = self._node.resolve_topic_name(INPUT_TOPICS[stream])
        transport = transport_of(stream, self._settings.node)
        return base if transport == "raw" else f"{base}/{transport}"

    def _message_kind(self, stream: str) -> type:
        if stream in CAMERAS:
            return messages.CameraInfo
        raw = transport_of(stream, self._settings.node) == "raw"
        return messages.Image if raw else messages.CompressedImage

    def _on_message(self, stream: str, serialized: bytes) -> None:
        if self._session is None:
            return
        self._clashes.pop(stream, None)
        try:
            if stream in CAMERAS:
                stamp_ns, camera = read_camera(serialized)
                if self._session.add_camera(stream, stamp_ns, camera) and camera.warning:
                    self._node.get_logger().warning(camera.warning)
            else:
                compressed = transport_of(stream, self._settings.node) != "raw"
                self._session.add_image(stream, *read_image(stream, serialized, compressed))
        except RefusedError as refused:
            self._session.refuse(stream, refused.reason, str(refused))

    def _on_imu(self, message: Any) -> None:
        a = message.linear_acceleration
        stamp_ns = decode_stamp(message.header.stamp)
        self._floor_pose.add_imu(stamp_ns, message.header.frame_id, np.array([a.x, a.y, a.z]))

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
        config, node = parameters.read(self._node, EstimatorConfig), parameters.read(self._node, NodeConfig)
        camera = read_calibration(Path(node.camera_file)).intrinsics if node.camera_file else None
        reading = None if camera is None else CameraReading(camera, "", "")
        return _Settings(node, self._make_estimator(config), reading)

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
        old = self._settings
        same = config == old.estimator.config
        self._settings = _Settings(node, old.estimator if same else self._make_estimator(config), old.camera)
        if self._session is not None:
            self._session.configure(self._settings.rules())
        if old.used() != self._settings.used() or _SUBSCRIPTION(old.node) != _SUBSCRIPTION(node):
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
        inputs = {}
        for stream, wanted in self._settings.used().items():
            if wanted or stream in (COLOR, DEPTH, CAMERA):
                topic = self._topic(stream)
                publishers = self._node.count_publishers(topic)
                inputs[stream] = InputFacts(topic, wanted, publishers, self._clashes.get(stream, ""))
        return NodeFacts(
            inputs=inputs,
            state=self._state(),
            listening_s=time.monotonic() - self._subscribed_at if self._inputs else 0.0,
            no_data_timeout_s=self._settings.node.no_data_timeout,
            max_stamp_gap_s=self._settings.node.max_stamp_gap,
            profile=str(dds_profile()),
            floor=self._floor_pose.source,
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
