"""Where the floor is expected in the camera frame: from TF, an IMU or parameters, else left to the estimate."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_adapters.text import clean_text

from .core.floor.floor_plane import FloorPlane
from .node_config import FindTransform, NodeConfig, down_in_camera, parse_pose
from .runtime.session import RefusedError

_STANDARD_GRAVITY = 9.80665
_TOLERANCE = 2.0
"""m/s^2; a robot that speeds up or brakes harder than this does not say where down is."""
_TIME_CONSTANT_NS = 500_000_000
_UP_TO_DATE_NS = 2_000_000_000


class Answer(NamedTuple):
    """Where the floor was expected from, and why the source that was asked for could not say ("" where it could)."""

    source: str
    missing: str
    no_height: str = ""
    """Why the source does not say how high the camera is; "" where it does."""

    def __str__(self) -> str:
        return f"{self.source} ({self.missing})" if self.missing else self.source


class FloorPose:
    """Knows gravity and the camera's height as the settings say. May be called from several threads.

    Parameters
    ----------
    find : callable
        Transform between two frames at a time, or None.
    """

    def __init__(self, find: FindTransform) -> None:
        self._find = find
        self._lock = threading.Lock()
        self._acceleration: NDArray[np.float64] | None = None
        self._imu_frame = ""
        self._imu_ns = 0
        self.answer = Answer("estimate", "")
        """Where the last answer came from, for the diagnostics."""

    def add_imu(self, stamp_ns: int, frame_id: str, acceleration: NDArray[np.float64]) -> None:
        """Take a reading: (3,) m/s^2, which points up at rest (REP-145). Low-passed over half a second.

        Raises
        ------
        RefusedError
            not finite, not gravity (a robot that brakes; another unit).
        """
        length = float(np.linalg.norm(acceleration))
        if not np.isfinite(length):
            raise RefusedError("not finite", f"acceleration has a value that is not finite ({length})")
        if abs(length - _STANDARD_GRAVITY) > _TOLERANCE:
            raise RefusedError(
                "not gravity",
                f"acceleration is {length:.1f} m/s^2; at rest it has to be {_STANDARD_GRAVITY:.1f} m/s^2 (REP-145)",
            )
        with self._lock:
            elapsed = stamp_ns - self._imu_ns
            fresh = self._acceleration is None or frame_id != self._imu_frame or not 0 <= elapsed < _UP_TO_DATE_NS
            before = acceleration if fresh or self._acceleration is None else self._acceleration
            share = 1.0 - np.exp(-max(elapsed, 0) / _TIME_CONSTANT_NS)
            self._acceleration = before + share * (acceleration - before)
            self._imu_frame, self._imu_ns = frame_id, stamp_ns

    def reset(self) -> None:
        """Forget the IMU."""
        with self._lock:
            self._acceleration = None
        self.answer = Answer("estimate", "")

    def expect(self, camera_frame: str, stamp_ns: int, node: NodeConfig) -> FloorPlane | None:
        """Return the floor as expected for a frame; None where nothing but the estimate can say."""
        found: FloorPlane | str = ""
        if node.pose_source == "imu":
            found = self._from_imu(camera_frame, stamp_ns, node)
        elif node.pose_source == "parameters":
            found = _from_parameters(node)
        elif node.pose_source in ("auto", "tf"):
            found = self._from_tf(camera_frame, stamp_ns, node)
        if isinstance(found, str):
            self.answer = Answer("estimate", found)
            return None
        self.answer = Answer(found.source, "", "" if np.isfinite(found.distance_m) else _no_height(node, found.source))
        return found

    def _from_tf(self, camera_frame: str, stamp_ns: int, node: NodeConfig) -> FloorPlane | str:
        T = self._find(camera_frame, node.robot_frame, stamp_ns)
        if T is None:
            return _no_transform(node.robot_frame, camera_frame)
        normal = -T[:3, 2]
        height = float(normal @ T[:3, 3])  # of the camera over the plane z = 0 of the robot's frame
        return FloorPlane(_unit(normal), height if height > 0 else float("nan"), "tf")

    def _from_imu(self, camera_frame: str, stamp_ns: int, node: NodeConfig) -> FloorPlane | str:
        with self._lock:
            acceleration, frame_id, imu_ns = self._acceleration, self._imu_frame, self._imu_ns
        if acceleration is None:
            return "no usable reading has come on imu"
        if abs(stamp_ns - imu_ns) > _UP_TO_DATE_NS:
            return f"the last usable reading of imu is over {_UP_TO_DATE_NS * 1e-9:.0f} s before or after the frame"
        if node.imu_to_camera:
            T_camera_imu: NDArray[np.float64] | None = parse_pose(node.imu_to_camera)
        elif frame_id == camera_frame:
            T_camera_imu = np.eye(4)
        else:
            T_camera_imu = self._find(camera_frame, frame_id, stamp_ns)
        if T_camera_imu is None:
            return f"{_no_transform(frame_id, camera_frame)}, and imu_to_camera is empty"
        return FloorPlane(_unit(-T_camera_imu[:3, :3] @ acceleration), node.camera_height or float("nan"), "imu")


def _no_transform(source: str, target: str) -> str:
    return f"no transform between {clean_text(source)} and {clean_text(target)} is known (tf2 must be installed)"


def _no_height(node: NodeConfig, source: str) -> str:
    if source == "tf":
        return f"{clean_text(node.robot_frame)} is not below the camera"
    return "camera_height is 0 (not known)"


def _from_parameters(node: NodeConfig) -> FloorPlane:
    down = down_in_camera(node.camera_pitch_deg, node.camera_roll_deg)
    return FloorPlane(down, node.camera_height or float("nan"), "parameters")


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit
