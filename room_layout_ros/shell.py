"""An estimator inside a ROS node, plain or lifecycle: topics, parameters and timers around `EstimatorSession`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.utilities import ok

from msg_adapters.stamp import decode_stamp

from . import parameters
from .core.config import EstimatorConfig
from .floor_pose import FloorPose
from .inputs import read_camera, read_image, transport_of
from .node_config import NodeConfig
from .outputs import OUTPUTS
from .publications import LABEL_NAMES_TOPIC, Publications, overrides
from .reporter import Reporter, dds_profile
from .runtime.diagnosis import InputFacts, NodeFacts
from .runtime.session import CAMERA, CAMERAS, DEPTH_CAMERA, IMU, JUMP, EstimatorSession, RefusedError
from .runtime.throttle import Throttle
from .settings import MakeEstimator, Settings, check_streams
from .stages import NodeStages
from .subscriptions import Subscriptions
from .transforms import Transforms

_LISTENER_PERIOD_S = 0.1
_EXIT_S = 1.0
"""The process must be out two seconds after the signal; a frame in hand gets this long."""

_JUMP_PERIOD_S = 600.0
"""A short bag that loops jumps every few seconds, and nothing is wrong with it."""


class Shell:
    """What the plain and the lifecycle node have in common.

    The order of calls is configure, activate, deactivate, cleanup; each may be repeated. All of them, and all
    callbacks, run in the executor; the stages run in the session's threads.
    """

    def __init__(self, node: Any, make_estimator: MakeEstimator) -> None:
        self._node, self._make_estimator = node, make_estimator
        self._throttle, self._jump_throttle = Throttle(), Throttle(_JUMP_PERIOD_S)
        parameters.declare(node, (EstimatorConfig, NodeConfig))
        parameters.refuse_unknown(node)
        config, own = parameters.read(node, EstimatorConfig), parameters.read(node, NodeConfig)
        self._settings = Settings.make(config, own, make_estimator)
        self._transforms = Transforms(node)
        self._floor_pose = FloorPose(self._transforms.find)
        self._inputs = Subscriptions(node, self._guard, self._on_message, self._on_imu, self._on_lost)
        for sentence in parameters.unknown_overrides(node, [*self._inputs.overrides(), *overrides(node)]):
            node.get_logger().warning(sentence)
        node.add_pre_set_parameters_callback(parameters.widened)
        node.add_on_set_parameters_callback(self._check_parameters)
        node.add_post_set_parameters_callback(self._apply_parameters)
        self._checked: tuple[dict[str, Any], Settings] | None = None
        self._session: EstimatorSession | None = None
        self._stages: NodeStages | None = None
        self._late: list[EstimatorSession] = []
        self._publications: Publications | None = None
        self._timers: list[Any] = []
        self._active = False
        self._jumps = node.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False),
            post_callback=self._on_clock_jump,
        )

    def topics(self) -> list[str]:
        """Return the node's own topics, as they are given to ROS."""
        return [*self._inputs.names(), *(output.topic for output in OUTPUTS), LABEL_NAMES_TOPIC]

    # ---- states

    def configure(self) -> None:
        """Make the publishers and start to warm up."""
        node = self._node
        self._publications = publications = Publications(node)
        self._stages = stages = NodeStages(node, publications, self._transforms, self._floor_pose, self.complain)
        self._session = session = EstimatorSession(stages, self._settings.rules())
        camera = self._settings.camera
        if camera is not None:
            session.set_camera(CAMERA, camera)
            if camera.warning:
                node.get_logger().warning(camera.warning)
        name = node.get_fully_qualified_name().lstrip("/")
        reporter = Reporter(publications.report, node.get_logger(), name, session.health())
        self._every(_LISTENER_PERIOD_S, "listeners", self._follow_listeners)
        self._every(
            self._settings.node.diagnostics_period,
            "diagnostics",
            lambda: reporter.report(session.health(), self._facts(), stages.now_ns()),
        )

    def activate(self) -> None:
        """Allow the inputs to be subscribed."""
        self._active = True

    def deactivate(self) -> None:
        """Drop the inputs."""
        self._active = False
        self._unsubscribe()

    def cleanup(self) -> bool:
        """Undo `configure`; False if a thread is still inside a frame: it ends by itself and publishes nothing."""
        self.deactivate()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self._timers = []
        if self._session is not None and not self._session.close(_EXIT_S):
            self._late.append(self._session)
        self._session = self._stages = None
        if self._publications is not None:
            self._publications.close()
        self._publications = None
        self._late = [session for session in self._late if not session.close(0.0)]
        return not self._late

    def complain(self, cause: str, sentence: str) -> None:
        """Log, at most one line per second and cause; a jump of the clock is a warning every ten minutes."""
        held = (self._jump_throttle if cause == JUMP else self._throttle).due(cause)
        if held is None or not ok(context=self._node.context):
            return
        line = f"{sentence} [{held} more]" if held else sentence
        if cause == JUMP:
            self._node.get_logger().warning(f"{line} (resets on /diagnostics counts every jump)")
        else:
            self._node.get_logger().error(line)

    # ---- callbacks

    def _every(self, period_s: float, what: str, work: Callable[[], None]) -> None:
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # sim time may stand still
        self._timers.append(self._node.create_timer(period_s, partial(self._guard, what, work), clock=steady))

    def _guard(self, what: str, work: Callable[..., None], *arguments: Any) -> None:
        """Run a callback: what it raises is logged here and does not leave `spin`."""
        try:
            work(*arguments)
        except Exception as error:  # noqa: BLE001
            self.complain(what, f"{type(error).__name__} in {what}: {error}")

    def _follow_listeners(self) -> None:
        wanted = self._state() == "running"
        if wanted and not self._inputs:
            node = self._settings.node
            if node.pose_source in ("auto", "tf", "imu") or not node.depth_registered:
                self._transforms.listen()
            self._inputs.open(self._settings)
        elif not wanted:
            self._unsubscribe()
        self._inputs.follow()

    def _unsubscribe(self) -> None:
        if self._inputs:
            self._inputs.close()
            self._floor_pose.reset()
            self._transforms.reset()
            if self._session is not None:
                self._session.reset()

    def _on_message(self, stream: str, serialized: bytes) -> None:
        session = self._session
        if session is None:
            return
        try:
            if stream in CAMERAS:
                stamp_ns, camera = read_camera(serialized)
                if session.add_camera(stream, stamp_ns, camera) and camera.warning:
                    self._node.get_logger().warning(camera.warning)
            else:
                compressed = transport_of(stream, self._settings.node) != "raw"
                session.add_image(stream, *read_image(stream, serialized, compressed))
        except RefusedError as refused:
            session.refuse(stream, refused.reason, str(refused))

    def _on_imu(self, message: Any) -> None:
        session, a = self._session, message.linear_acceleration
        if session is None:
            return
        try:
            stamp_ns = decode_stamp(message.header.stamp)
            self._floor_pose.add_imu(stamp_ns, message.header.frame_id, np.array([a.x, a.y, a.z]))
        except RefusedError as refused:
            session.count_refused(IMU, refused.reason, str(refused))
        except ValueError as error:
            session.count_refused(IMU, "bad stamp", str(error))
        else:
            session.count_used(IMU)

    def _on_lost(self, stream: str, number: int) -> None:
        if self._session is not None:
            self._session.count_lost(stream, number)

    def _on_clock_jump(self, jump: Any) -> None:
        self._transforms.clear()
        if self._session is not None and self._inputs:
            back_s = -jump.delta.nanoseconds * 1e-9
            self.complain(JUMP, f"/clock jumped back by {back_s:.1f} s; starting afresh")
            self._session.reset()

    # ---- what is going on

    def _state(self) -> str:
        if not self._active:
            return "inactive"
        if self._session is None or self._publications is None or not self._session.ready:
            return "warming up"
        if self._node.get_parameter("use_sim_time").value and self._node.get_clock().now().nanoseconds == 0:
            return "waiting for /clock (use_sim_time is true)"
        if self._settings.node.lazy_inputs and not self._publications.has_listeners():
            return "idle: nobody listens to an output"
        return "running"

    def _facts(self) -> NodeFacts:
        answer = self._floor_pose.answer
        return NodeFacts(
            inputs=self._input_facts(),
            state=self._state(),
            listening_s=self._inputs.listening_s,
            no_data_timeout_s=self._settings.node.no_data_timeout,
            max_stamp_gap_s=self._settings.node.max_stamp_gap,
            profile=str(dds_profile()),
            pose_source=self._settings.node.pose_source,
            floor=str(answer),
            floor_missing=answer.missing,
            no_height=answer.no_height,
            tf_publishers=self._inputs.tf_publishers() if self._settings.node.pose_source == "auto" else 0,
            transforms=self._transforms.said(),
        )

    def _input_facts(self) -> dict[str, InputFacts]:
        facts = self._inputs.facts(self._settings)
        foreign = self._stages.foreign.after(self._settings.node.no_data_timeout) if self._stages else {}
        given = {CAMERA: self._settings.camera, DEPTH_CAMERA: self._settings.depth_camera}
        for stream in facts.keys() & given.keys():
            camera = given[stream] or (self._session.newest_camera(stream) if self._session else None)
            bent = camera.warning if camera is not None else ""
            facts[stream] = replace(facts[stream], bent=bent, foreign=foreign.get(stream, ""))
        return facts

    # ---- parameters

    def _changed(self, changes: Sequence[Any]) -> Settings:
        """Return the settings with changes; makes the estimator that they need."""
        values = {p.name: p.value for p in changes}
        config = parameters.changed(self._settings.estimator.config, values)
        check_streams(config)
        node = parameters.changed(self._settings.node, values)
        return self._settings.changed(config, node, self._make_estimator)

    def _check_parameters(self, changes: Sequence[Any]) -> SetParametersResult:
        """Refuse what is wrong, and what no estimator can be made of; what is made is kept for `_apply_parameters`."""
        try:
            self._checked = {p.name: p.value for p in changes}, self._changed(changes)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:  # noqa: BLE001  it would end the service, and the parameter would stay as it is
            return SetParametersResult(successful=False, reason=f"{type(error).__name__}: {error}")
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changes: Sequence[Any]) -> None:
        old, checked, self._checked = self._settings, self._checked, None
        if checked is not None and checked[0] == {p.name: p.value for p in changes}:
            self._settings = checked[1]
        else:
            self._settings = self._changed(changes)
        if self._session is not None:
            self._session.configure(self._settings.rules())
        if not self._settings.subscribes_like(old):
            self._unsubscribe()  # the timer subscribes anew
