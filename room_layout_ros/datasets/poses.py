"""Camera poses and stamps beside the frames of a folder."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .errors import DataError

Pose = NDArray[np.float64]
_POSE_NUMBERS = 7
_MAX_QUATERNION_ERROR = 1e-3
MAX_STAMP_NS = 2**31 * 1_000_000_000 - 1
"""Stamps of ROS have int32 seconds."""


def read_poses(path: Path, names: Sequence[str]) -> dict[str, Pose]:
    """Read poses of the optical frame in the world as (4, 4) arrays by frame name.

    Lines are `NAME tx ty tz qx qy qz qw` or, as TUM files have it, `SECONDS tx ty tz qx qy qz qw` with one
    line for each frame in order. A name may hold spaces. Lines that start with # are comments.

    Raises
    ------
    DataError
        When a line is no pose, or lines cannot be told to frames.
    """
    rows: list[tuple[str, Pose]] = []
    for number, line in enumerate(_lines(path), 1):
        words = line.strip().rsplit(maxsplit=_POSE_NUMBERS)
        if words and not words[0].startswith("#"):
            rows.append((words[0], _pose(words[1:], f"{path} line {number}")))
    known = set(names)
    if rows and all(key in known for key, _ in rows):
        return dict(rows)
    if strange := [key for key, _ in rows if key not in known and not _is_number(key)]:
        raise DataError(f"{path} has a pose of {strange[0]!r}; it is neither the name of a frame nor seconds")
    if len(rows) != len(names):
        raise DataError(f"{path} has {len(rows)} poses for {len(names)} frames; name them or give one for each frame")
    return {name: pose for name, (_, pose) in zip(names, rows, strict=True)}


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path} cannot be read: {error}") from None


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _pose(words: Sequence[str], where: str) -> Pose:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != _POSE_NUMBERS or not all(map(math.isfinite, values)):
        raise DataError(f"{where} is no pose; tx ty tz qx qy qz qw are needed after the name")
    norm = math.hypot(*values[3:])
    if abs(norm - 1.0) > _MAX_QUATERNION_ERROR:
        raise DataError(f"{where}: the quaternion has length {norm:.4f}; it must be 1")
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = Rotation.from_quat(values[3:]).as_matrix()
    T_world_camera[:3, 3] = values[:3]
    return T_world_camera


def write_poses(path: Path, poses: Mapping[str, Pose]) -> None:
    """Write `NAME tx ty tz qx qy qz qw` lines with twelve digits."""
    lines = ["# name tx ty tz qx qy qz qw (optical frame in the world, metres)"]
    for name, pose in poses.items():
        values = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lines.append(" ".join([name, *(f"{v:.12g}" for v in values)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_stamps(path: Path) -> dict[str, int]:
    """Read `NAME NANOSECONDS` lines; a name may hold spaces.

    Raises
    ------
    DataError
        When a line is something else, or a stamp is more than ROS can say.
    """
    stamps = {}
    for number, line in enumerate(_lines(path), 1):
        words = line.strip().rsplit(maxsplit=1)
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 2 or not words[1].isdecimal():
            raise DataError(f"{path} line {number} is {line[:40]!r}; a name and whole nanoseconds are needed")
        if len(words[1]) > 19 or int(words[1]) > MAX_STAMP_NS:
            raise DataError(f"{path} line {number}: {words[1][:40]} ns; allowed is 0 to {MAX_STAMP_NS} (int32 seconds)")
        stamps[words[0]] = int(words[1])
    return stamps


def write_stamps(path: Path, stamps: Mapping[str, int]) -> None:
    """Write `NAME NANOSECONDS` lines."""
    lines = ["# name nanoseconds", *(f"{name} {stamp}" for name, stamp in stamps.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
