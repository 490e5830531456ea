"""A bench for the node in the test's own process: a camera to play with, ears on the outputs, a made-up estimator."""

from __future__ import annotations

import itertools
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from dds_player import camera_info
from processes import slack
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from room_frames import FRAME_ID, room_images, stamp_ns

from msg_adapters import messages
from msg_adapters.encode_image import encode_image
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.estimator_node import EstimatorNode
from room_layout_ros.inputs import INPUT_TOPICS, TRANSPORTS
from room_layout_ros.runtime.pairing import COLOR, DEPTH
from room_layout_ros.runtime.session import CAMERA, CAMERAS

_numbers = itertools.count()


class QuickEstimator:
    """The same room for every frame, clutter where depth is under 2.5 m: an answer that can be checked at once."""

    ROOM = RoomCuboid(np.eye(3), np.array([1.2, 1.3, 1.8, 3.5, 2.2]))

    def __init__(self, config: EstimatorConfig) -> None:
        self.config = config
        self.frames: list[RgbdFrame] = []
        self.priors: list[TemporalPrior | None] = []

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None = None) -> RoomEstimate:
        self.frames.append(frame)
        self.priors.append(prior)
        layout = self.ROOM.raster(frame.camera)
        found = frame.depth_m is None or bool(np.isfinite(frame.depth_m).any())
        labels = layout.copy()
        if frame.depth_m is not None:
            labels[frame.depth_m < 2.5] = CLUTTER
        return RoomEstimate(
            status=Status.OK if found else Status.NO_DEPTH, layout=layout, labels=labels,
            furniture=np.zeros_like(layout), superpixels=np.zeros(layout.shape, np.int32), R_room_camera=np.eye(3),
            axes_confidence=1.0, confidence=1.0, face_confidence=np.ones(5), cuboid=self.ROOM if found else None,
            polygons=self.ROOM.polygons(frame.camera), stamp_ns=frame.stamp_ns, frame_id=frame.frame_id,
            metric=frame.depth_m is not None,
        )  # fmt: skip


class GatedEstimator(QuickEstimator):
    """Answers only while the gate is open: a frame that takes long, as on a machine that compiles or swaps."""

    def __init__(self, config: EstimatorConfig) -> None:
        super().__init__(config)
        self.gate = threading.Event()
        self.gate.set()
        self.busy = threading.Event()

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None = None) -> RoomEstimate:
        self.busy.set()
        assert self.gate.wait(20.0)
        return super().estimate(frame, prior)


class Bench:
    """One estimator node, one camera, one listener, in a namespace of their own."""

    def __init__(
        self,
        context: Context,
        namespace: str,
        make_node: Callable[..., Any],
        estimator: type[QuickEstimator],
        values: Mapping[str, Any],
    ) -> None:
        self.namespace, self._estimator = namespace, estimator
        self.estimators: list[Any] = []
        # Reliable, so that a test that sends one message knows that it comes; test_node_processes uses best effort.
        topics = {
            topic if kind == "raw" else f"{topic}/{kind}"
            for stream, topic in INPUT_TOPICS.items()
            for kind in TRANSPORTS.get(stream, ("raw",))
        }
        reliable = {f"qos_overrides.{namespace}/{topic}.subscription.reliability": "reliable" for topic in topics}
        overrides = {"no_data_timeout": 1.0, "diagnostics_period": 0.1, **reliable, **values}
        self.node = make_node(
            make_estimator=self._make_estimator,
            context=context,
            namespace=namespace,
            parameter_overrides=[Parameter(name, value=value) for name, value in overrides.items()],
        )
        self.other = Node("camera", context=context, namespace=namespace)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.other)
        self.cameras = {s: self.camera(s, QoSProfile(depth=10)) for s in (COLOR, DEPTH, CAMERA)}
        self.imu: Any = None
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self.listen("/diagnostics", messages.DiagnosticArray)

    def _make_estimator(self, config: EstimatorConfig) -> Any:
        self.estimators.append(self._estimator(config))
        return self.estimators[-1]

    def camera(self, stream: str, qos: QoSProfile) -> Any:
        """Return a publisher for an input."""
        kind = messages.CameraInfo if stream in CAMERAS else messages.Image
        return self.other.create_publisher(kind, INPUT_TOPICS[stream], qos)

    def listen(self, topic: str, kind: type, qos: QoSProfile | int = 10) -> Any:
        """Subscribe and collect in `heard[topic]`."""

        def keep(message: Any) -> None:
            if kind is messages.DiagnosticArray and self.namespace.strip("/") not in message.status[0].name:
                return
            self.heard[topic].append(message)

        return self.other.create_subscription(kind, topic, keep, qos)

    def spin(self, seconds: float) -> None:
        """Let everything run."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)

    def until(self, condition: Callable[[], object], seconds: float = 10.0) -> None:
        """Let everything run until `condition` holds, at most `seconds` (of an idle machine)."""
        end = time.monotonic() + seconds * slack()
        while not condition():
            assert time.monotonic() < end, f"waited {seconds} s in vain; diagnostics: {self.diagnosis()}"
            self.executor.spin_once(timeout_sec=0.01)

    def connect(self) -> None:
        """Listen to ~/labels and wait until camera and node know each other."""
        self.listen("estimator/labels", messages.Image)
        self.until_subscribed()

    def until_subscribed(self) -> None:
        """Wait until the node listens to all cameras, and a little for it to know them too."""
        self.until(lambda: all(c.get_subscription_count() for c in self.cameras.values()))
        self.spin(0.2)

    def send(self, i: int, color: Any = None, depth: Any = None, info: Any = None) -> None:
        """Publish frame `i`; False leaves a message out, a message or bytes replace it."""
        stamp, (rgb, mm) = stamp_ns(i), room_images(i)
        for stream, given, usual in (
            (CAMERA, info, lambda: camera_info(stamp)),
            (COLOR, color, lambda: encode_image(rgb, stamp, FRAME_ID)),
            (DEPTH, depth, lambda: encode_image(mm, stamp, FRAME_ID)),
        ):
            if given is not False:
                self.cameras[stream].publish(usual() if given is None else given)

    def labels_of(self, i: int) -> list[Any]:
        """Return what ~/labels said about frame `i`."""
        sec, nanosec = divmod(stamp_ns(i), 10**9)
        heard = self.heard["estimator/labels"]
        return [m for m in heard if (m.header.stamp.sec, m.header.stamp.nanosec) == (sec, nanosec)]

    def expect(self, i: int) -> None:
        """Send frame `i` and wait for its labels."""
        self.send(i)
        self.until(lambda: self.labels_of(i))

    def diagnosis(self) -> dict[str, tuple[int, str]]:
        """Return the newest level and message of each diagnostic by its name."""
        last = self.heard["/diagnostics"][-1:]
        return {s.name.split(": ")[1]: (s.level[0], s.message) for m in last for s in m.status}

    def well(self, name: str) -> bool:
        """Return whether the newest diagnosis of `name` is OK."""
        return self.diagnosis()[name][0] == 0

    def said(self, name: str, *words: str) -> bool:
        """Return whether any diagnosis of `name` so far was an error or warning with all `words`."""
        return any(
            s.name.endswith(f": {name}") and s.level > b"\0" and all(w in s.message for w in words)
            for m in self.heard["/diagnostics"]
            for s in m.status
        )

    def health(self) -> Any:
        """Return the counters."""
        return self.node.shell._session.health()

    def check_sums(self) -> None:
        """Every message and every pair has exactly one end."""
        health = self.health()
        for stream in health.streams.values():
            ends = stream.paired + stream.superseded + sum(stream.refused.values()) + stream.waiting
            assert stream.received == ends
        ends = health.published + sum(health.no_estimate.values()) + sum(health.dropped.values()) + health.in_flight
        assert health.made == ends

    def close(self) -> None:
        """End the node and the camera."""
        assert self.node.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.other.destroy_node()


@contextmanager
def running(
    make_node: Callable[..., Any] = EstimatorNode, estimator: type[QuickEstimator] = QuickEstimator, **values: Any
) -> Iterator[Bench]:
    """Yield a bench whose node has the parameters `values`."""
    context = Context()
    context.init(args=[])
    try:
        bench = Bench(context, f"/bench{next(_numbers)}", make_node, estimator, values)
        try:
            yield bench
            if bench.node.shell._session is not None:
                bench.check_sums()
        finally:
            bench.close()
    finally:
        context.try_shutdown()
