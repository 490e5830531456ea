"""Settings of the node (streams, outputs, diagnostics) beside those of the estimator; one table, no ROS."""

from __future__ import annotations

import argparse
import json
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .core.config import EstimatorConfig, Parameter, Value, parameters
from .core.config import _p as setting


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """Settings of the ROS 2 node; a change makes a new value (`dataclasses.replace`).

    Raises
    ------
    ValueError
        When a value is of the wrong type, out of its bounds or at odds with another.
    """

    # streams
    max_stamp_gap: float = setting(
        0.02, "largest difference of the stamps of colour and depth of one frame", "s", 0.0, 1.0
    )
    reset_gap: float = setting(
        0.5,
        "a frame older than the last one by more than this is a jump of the clock (bag loop): start afresh",
        "s",
        0.05,
        60.0,
    )
    queue_size: int = setting(10, "messages of a stream that may wait for their partner", "", 1, 100)
    no_data_timeout: float = setting(
        5.0, "silence after which missing input is an error on /diagnostics", "s", 0.5, 3600.0
    )
    color_transport: str = setting("raw", "transport of the colour image", choices=("raw", "compressed"))
    depth_transport: str = setting(
        "raw", "transport of the depth image", choices=("raw", "compressedDepth", "compressed")
    )
    camera_file: str = setting(
        "", "ROS camera calibration YAML used instead of rgb/camera_info (empty: the topic)", runtime=False
    )
    depth_registered: bool = setting(
        True, "depth comes in the view of the colour camera; false: register it here, with depth/camera_info"
    )
    depth_camera_file: str = setting(
        "",
        "ROS camera calibration YAML used instead of depth/camera_info, with depth_registered false (empty: the topic)",
        runtime=False,
    )
    depth_to_color: str = setting(
        "", "pose of the depth camera in the colour camera's frame, 'x y z qx qy qz qw' (empty: from TF)"
    )
    lazy_inputs: bool = setting(True, "subscribe to the inputs only while an output has a listener")
    # estimation
    warm_start: bool = setting(
        True, "hand the axes of one frame to the next (false: each frame alone, bit-equal to the offline result)"
    )
    deadline_ms: float = setting(
        0.0,
        "after this time the search of the joint model ends with the best so far (0: no deadline); of a usual frame it "
        "can save a tenth, for a weak CPU see working_size_px",
        "ms",
        0.0,
        10000.0,
    )
    # pose of the camera over the floor
    pose_source: str = setting(
        "auto",
        "where the floor is expected: tf (plane z = 0 of robot_frame), imu (topic imu), parameters (camera_height, "
        "camera_pitch_deg, camera_roll_deg), estimate (the floor that is seen), auto (tf where known, else estimate)",
        choices=("auto", "tf", "imu", "parameters", "estimate"),
    )
    robot_frame: str = setting("base_footprint", "frame of the robot on the floor, z up (REP-120)")
    camera_height: float = setting(
        0.0, "height of the camera over the floor (0: not known, the depth tells)", "m", 0.0, 10.0
    )
    camera_pitch_deg: float = setting(0.0, "the camera looks down by this angle", "deg", -90.0, 90.0)
    camera_roll_deg: float = setting(0.0, "the camera leans to its right by this angle", "deg", -180.0, 180.0)
    imu_to_camera: str = setting(
        "", "pose of the IMU in the camera's optical frame, 'x y z qx qy qz qw' (empty: from TF, or the same frame)"
    )
    floor_frame: str = setting("", "frame of grid and scan, on the floor below the camera (empty: CAMERA_FRAME_floor)")
    broadcast_floor: bool = setting(
        True, "send the floor frame as a child of the camera's on /tf (where tf2 is installed)"
    )
    # outputs
    marker_lifetime: float = setting(0.5, "markers vanish from RViz after this (0: never)", "s", 0.0, 3600.0)
    diagnostics_period: float = setting(1.0, "time between messages on /diagnostics", "s", 0.1, 60.0, runtime=False)

    def __post_init__(self) -> None:
        for parameter in parameters(type(self)):
            object.__setattr__(self, parameter.name, parameter.check(getattr(self, parameter.name)))
        for pose in (self.depth_to_color, self.imu_to_camera):
            if pose:
                parse_pose(pose)
        for name in ("floor_frame", "robot_frame"):
            _check_frame(name, getattr(self, name))
        if self.floor_frame and self.floor_frame == self.robot_frame:
            raise ValueError(
                f"floor_frame is {self.floor_frame[:80]!r}, which is robot_frame too; the floor below the camera needs "
                "a frame of its own"
            )
        if self.max_stamp_gap >= self.reset_gap:
            raise ValueError(
                f"max_stamp_gap is {self.max_stamp_gap} s; it must be below reset_gap, which is {self.reset_gap} s"
            )

    def floor_below(self, camera_frame: str) -> str:
        """Return the name of the frame on the floor below a camera."""
        return self.floor_frame or f"{camera_frame}_floor"


def _check_frame(name: str, frame: str) -> None:
    """Raise ValueError where TF would not take a frame's name ("" means: not given)."""
    if frame and not re.fullmatch(r"[A-Za-z0-9_.\-][A-Za-z0-9_.\-/]*", frame):
        raise ValueError(
            f"{name} is {frame[:80]!r}; a frame is named by letters, digits and _ . - /, and does not begin with /"
        )


FindTransform = Callable[[str, str, int], NDArray[np.float64] | None]
"""(target frame, source frame, time in ns) -> (4, 4) that takes points of the source to the target, or None."""


def parse_pose(text: str) -> NDArray[np.float64]:
    """Return "x y z qx qy qz qw" (metres, quaternion of any length but 0) as a (4, 4) transform.

    Raises
    ------
    ValueError
        When these are not seven finite numbers or the quaternion is zero.
    """
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if values.size != 7 or not np.isfinite(values).all() or not values[3:].any():
        raise ValueError(f"pose is {text[:80]!r}; it must be seven numbers 'x y z qx qy qz qw'")
    x, y, z, w = values[3:] / np.linalg.norm(values[3:])
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = values[:3]
    return pose


def down_in_camera(pitch_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """Return (3,) the unit vector down in the frame of a camera that looks down and leans to its right by angles."""
    pitch, roll = np.deg2rad(pitch_deg), np.deg2rad(roll_deg)
    down = np.array([np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll), np.sin(pitch)])
    unit: NDArray[np.float64] = down / np.linalg.norm(down)
    return unit


TABLES = (("estimator", EstimatorConfig), ("node", NodeConfig))
_WIDTH = 116


def render_yaml() -> str:
    """Return config/estimator.yaml: every parameter at its default, with its meaning."""
    lines = ["# Every parameter of the node at its default. Written by: python -m room_layout_ros.node_config", ""]
    lines += ["/**:", "  ros__parameters:"]
    for title, table in TABLES:
        lines.append(f"    # ---- {title}")
        for row in parameters(table):
            lines += textwrap.wrap(_meaning(row), _WIDTH, initial_indent="    # ", subsequent_indent="    # ")
            lines.append(f"    {row.name}: {_scalar(row.default)}")
    return "\n".join(lines) + "\n"


def render_markdown() -> str:
    """Return the tables of docs/parameters.md."""
    lines = []
    for title, table in TABLES:
        lines += [f"## Parameters of the {title}", ""]
        lines += ["| name | default | unit | allowed | meaning |", "|---|---|---|---|---|"]
        for row in parameters(table):
            fixed = "" if row.runtime else "; fixed after the start"
            cells = (f"`{row.name}`", f"`{_scalar(row.default)}`", row.unit, _allowed(row), row.meaning + fixed)
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def _meaning(row: Parameter) -> str:
    notes = [n for n in (row.unit, _allowed(row), "" if row.runtime else "fixed after the start") if n]
    return f"{row.meaning} ({', '.join(notes)})"


def _allowed(row: Parameter) -> str:
    if row.choices:
        return ", ".join(row.choices)
    if isinstance(row.default, bool):
        return "true, false"
    if isinstance(row.default, str):
        return "text"
    low = "-inf" if row.low is None else f"{row.low:g}"
    return f"{low} to {'inf' if row.high is None else f'{row.high:g}'}"


def _scalar(value: Value) -> str:
    """Return YAML that ROS reads with the same type: a float keeps its point."""
    if isinstance(value, float):
        return f"{value:.12f}".rstrip("0") + ("0" if value == int(value) else "")
    return json.dumps(value)


def main(words: Sequence[str] | None = None) -> None:
    """Write config/estimator.yaml and the tables of docs/parameters.md anew."""
    parser = argparse.ArgumentParser(prog="python -m room_layout_ros.node_config", description=main.__doc__)
    parser.add_argument(
        "--root",
        type=Path,
        default=Path(__file__).resolve().parent.parent,
        metavar="DIR",
        help="clone with config/ and docs/parameters.md (default %(default)s)",
    )
    root = parser.parse_args(words).root
    if not ((root / "config").is_dir() and (root / "docs" / "parameters.md").is_file()):
        parser.error(f"{root} has no config/ or no docs/parameters.md; give a clone by --root")
    (root / "config" / "estimator.yaml").write_text(render_yaml(), "utf-8")
    page = root / "docs" / "parameters.md"
    head = page.read_text("utf-8").partition(MARK)[0]
    page.write_text(head + MARK + "\n\n" + render_markdown(), "utf-8")


MARK = "<!-- generated from here on: python -m room_layout_ros.node_config -->"

if __name__ == "__main__":
    main()
