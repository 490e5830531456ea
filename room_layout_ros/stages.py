"""What one session asks of the node, from its own threads: decode, estimate, publish."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import cv2
from rclpy.utilities import ok

from msg_adapters.camera_info import CameraReading
from msg_adapters.encode_navigation import encode_transform

from .core.estimate import RoomEstimate
from .core.floor.floor_plane import FloorPlane
from .core.frame import RgbdFrame
from .core.tracking import TemporalPrior
from .core.working_size import resize_frame, resize_keeping
from .floor_check import FloorCheck
from .floor_pose import FloorPose
from .inputs import ImageItem, assemble, foreign_cameras
from .outputs import OUTPUTS
from .publications import Publications
from .runtime.health import NO_DEPTH, NO_FLOOR, NO_LEVEL_FLOOR, NOT_USED, FloorOutcome
from .runtime.pairing import Pair
from .runtime.session import DEPTH_CAMERA, RefusedError
from .runtime.throttle import Lasting
from .runtime.warm_up import warm_up_frame
from .scene import Scene
from .settings import Settings
from .transforms import Transforms

_PATIENCE_S = 15.0
"""A compilation that takes minutes says so this often."""


class NodeStages:
    """The stages of one session; they publish through its own publishers, whatever the node does meanwhile.

    Parameters
    ----------
    node : rclpy node
    publications : Publications
    transforms : Transforms
    floor_pose : FloorPose
    complain : callable
        `complain(cause, sentence)` logs, at most one line per second and cause.
    """

    def __init__(
        self,
        node: Any,
        publications: Publications,
        transforms: Transforms,
        floor_pose: FloorPose,
        complain: Callable[[str, str], None],
    ) -> None:
        self._node, self._publications = node, publications
        self._transforms, self._floor_pose, self._complain = transforms, floor_pose, complain
        self.foreign = Lasting()
        """By stream why a camera may not be that of its images."""

    def warm_up(self, settings: Settings) -> None:
        """Run one made-up frame through everything."""
        self._node.get_logger().info(
            "warming up; the first start after an installation compiles for one to four minutes"
        )
        if settings.depth_camera is not None and settings.depth_camera.warning:
            self._node.get_logger().warning(settings.depth_camera.warning)
        start = time.monotonic()
        cv2.setNumThreads(1)  # OpenCV's pool only steals the core of the callbacks
        frame = warm_up_frame()
        with self._telling_that_it_compiles():
            settings.estimator.estimate(replace(frame, depth_m=None))  # a camera may start with depth of nothing
            for scale in (2.0, 0.25):  # larger and smaller images are resized
                resize_frame(warm_up_frame(scale), settings.estimator.config.working_size_px)
            scene = Scene(frame, settings.estimator.estimate(frame), settings.node, settings.estimator.config)
            for output in OUTPUTS:
                output.encode(scene)
        self._node.get_logger().info(f"ready, warm after {time.monotonic() - start:.1f} s")

    @contextmanager
    def _telling_that_it_compiles(self) -> Iterator[None]:
        """Log now and then until it is over."""
        start, over = time.monotonic(), threading.Event()

        def tell() -> None:
            while not over.wait(_PATIENCE_S) and ok(context=self._node.context):
                so_far = f"{time.monotonic() - start:.0f} s so far"
                self._node.get_logger().info(f"still compiling, {so_far}; the next start is fast")

        teller = threading.Thread(target=tell, name="estimator-patience", daemon=True)
        teller.start()
        try:
            yield
        finally:
            over.set()
            teller.join()

    def assemble(
        self, pair: Pair[ImageItem], cameras: Mapping[str, CameraReading | None], settings: Settings
    ) -> RgbdFrame:
        """Decode a pair, to the working size."""
        if settings.depth_camera is not None:
            cameras = {**cameras, DEPTH_CAMERA: settings.depth_camera}
        frame = assemble(pair, cameras, settings.node, self._transforms.find)
        self.foreign.note(foreign_cameras(pair, cameras, settings.node))
        floor = settings.node.floor_below(frame.frame_id)
        if floor == frame.frame_id:
            raise RefusedError(
                "floor_frame is the camera's",
                f"floor_frame is {floor[:80]!r}, which is the camera's own frame; the floor needs another",
            )
        if frame.frame_id and floor == settings.node.robot_frame:
            raise RefusedError(
                "floor_frame is the robot's",
                f"floor_frame is empty, so the floor's frame is {floor[:80]!r}, which is robot_frame too; "
                "the floor below the camera needs a frame of its own: set floor_frame",
            )
        return resize_keeping(frame, settings.estimator.config.working_size_px)

    def expect_floor(self, frame: RgbdFrame, settings: Settings) -> FloorPlane | None:
        """Say where the floor is expected, and which way is down."""
        return self._floor_pose.expect(frame.frame_id, frame.stamp_ns, settings.node)

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None, settings: Settings) -> RoomEstimate:
        """Estimate the room, within the deadline where there is one."""
        if settings.node.deadline_ms <= 0:
            return settings.estimator.estimate(frame, prior)
        end = time.monotonic() + settings.node.deadline_ms * 1e-3
        return settings.estimator.estimate(frame, prior, lambda: time.monotonic() > end)

    def publish(
        self, frame: RgbdFrame, estimate: RoomEstimate, floor: FloorPlane | None, settings: Settings
    ) -> FloorOutcome | None:
        """Send what somebody listens to; say what became of the floor, None where nobody wanted it."""
        scene = Scene(frame, estimate, settings.node, settings.estimator.config, floor)
        sent = self._publications.send(scene)
        if sent.on_floor and scene.free_space is not None and settings.node.broadcast_floor:
            T_camera_floor = scene.free_space.T_camera_floor
            self._transforms.broadcast(
                encode_transform(T_camera_floor, frame.stamp_ns, frame.frame_id, scene.floor_frame)
            )
        return _floor_outcome(scene) if sent.floor_wanted else None

    def complain(self, cause: str, sentence: str) -> None:
        """Log."""
        self._complain(cause, sentence)

    def now_ns(self) -> int:
        """Time on the node's clock."""
        return int(self._node.get_clock().now().nanoseconds)


def _floor_outcome(scene: Scene) -> FloorOutcome:
    if not scene.estimator.use_depth:
        return FloorOutcome("", NOT_USED, frame=scene.floor_frame)
    if scene.geometry is None:
        return FloorOutcome("", NO_DEPTH, frame=scene.floor_frame)
    space = scene.free_space
    check = FloorCheck(scene.geometry, scene.working_estimate.labels, scene.floor, scene.estimator)
    if space is None:
        # A floor that is given with its height would have been kept.
        missing = NO_FLOOR if scene.floor is None or check.has_level_floor else NO_LEVEL_FLOOR
        return FloorOutcome("", missing, frame=scene.floor_frame)
    seen = space.source.endswith("+depth")
    return FloorOutcome(
        space.source,
        seen=seen,
        confirmed=seen or not check.denies_floor,
        hidden=not seen and check.hides_floor,
        frame=scene.floor_frame,
    )
