"""Where a camera may be and how it walks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics

from .floor import is_free
from .raster import camera_rectangles, cast
from .room import SyntheticRoom
from .truth import cast_shell

Pose = NDArray[np.float64]

_BODY_M = 0.35
_TRIES = 60
_PEEK = CameraIntrinsics(64, 48, 52.5, 52.5, 31.5, 23.5)


def camera_pose(x: float, y: float, z: float, yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    """Return T_world_camera of an optical frame; yaw about z from +x, pitch up, roll clockwise; radians."""
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    down = np.cross(forward, right)
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    pose[:3, 1] = np.cos(roll) * down - np.sin(roll) * right
    pose[:3, 2] = forward
    pose[:3, 3] = x, y, z
    return pose


def random_pose(
    room: SyntheticRoom,
    rng: np.random.Generator,
    height_m: tuple[float, float] = (1.1, 1.65),
    pitch_deg: tuple[float, float] = (-18.0, -3.0),
    roll_deg: float = 2.0,
) -> Pose:
    """Return a pose in free space that looks at something: several faces, nothing right before the lens.

    Raises
    ------
    ValueError
        When the room is so full that no such place is found.
    """
    low, high = room.corners.min(axis=0), room.corners.max(axis=0)
    best: tuple[float, Pose] | None = None
    found = 0
    for _ in range(_TRIES * 8):
        x, y = rng.uniform(low, high)
        if not is_free(room, float(x), float(y), _BODY_M):
            continue
        centre = (low + high) / 2
        yaw = np.arctan2(*(centre - [x, y])[::-1]) + rng.normal(0, 0.7)
        pitch, roll = np.deg2rad(rng.uniform(*pitch_deg)), np.deg2rad(rng.normal(0, roll_deg / 2))
        pose = camera_pose(float(x), float(y), float(rng.uniform(*height_m)), float(yaw), float(pitch), float(roll))
        value = _view_value(room, pose)
        if best is None or value > best[0]:
            best = (value, pose)
        found += 1
        if found >= 4:
            break
    if best is None:
        raise ValueError("the room is too full: no free place for a camera was found; use less furniture")
    return best[1]


def _view_value(room: SyntheticRoom, pose: Pose) -> float:
    """Score a view by what is far and how many faces show."""
    _, depth_m = cast(camera_rectangles(room.surfaces, pose), _PEEK)
    layout, _, _ = cast_shell(room, _PEEK, pose)
    shares = np.bincount(layout.ravel(), minlength=6)[1:] / layout.size
    near = float((depth_m < 0.9).mean())
    return float(min(np.median(depth_m), 4.0) + 0.8 * (shares > 0.03).sum() - 6.0 * near)


def walk(
    room: SyntheticRoom,
    rng: np.random.Generator,
    frames: int,
    rate_hz: float = 30.0,
    speed_m_s: float = 0.35,
    turn_deg: float = 25.0,
) -> list[Pose]:
    """Return the poses of a smooth hand-held walk: forth and back through free space, looking around.

    Parameters
    ----------
    frames : int
        Number of poses at `rate_hz`.
    speed_m_s, turn_deg : float
        Largest speed; how far the gaze swings to either side.
    """
    start = random_pose(room, rng)
    yaw = float(np.arctan2(start[1, 2], start[0, 2]))
    pitch = float(np.arcsin(start[2, 2]))
    heading = yaw + float(rng.uniform(-0.6, 0.6))
    reach = _free_reach(room, start, heading)
    period_s = max(2.0, 2 * np.pi * reach / speed_m_s) if reach > 0 else 6.0
    phases = rng.uniform(0, 2 * np.pi, 4)
    poses = []
    for i in range(frames):
        t = i / rate_hz
        s = reach * 0.5 * (1 - np.cos(2 * np.pi * t / period_s))
        x, y = start[0, 3] + s * np.cos(heading), start[1, 3] + s * np.sin(heading)
        bob = 0.012 * np.sin(2 * np.pi * 1.4 * t + phases[0])
        swing = np.deg2rad(turn_deg) * np.sin(2 * np.pi * t / 7.0)
        nod = np.deg2rad(2.0) * np.sin(2 * np.pi * t / 3.1 + phases[1])
        tilt = np.deg2rad(0.8) * np.sin(2 * np.pi * t / 2.3 + phases[2])
        poses.append(camera_pose(x, y, start[2, 3] + bob, yaw + swing, pitch + nod, tilt))
    return poses


def _free_reach(room: SyntheticRoom, start: Pose, heading: float, longest: float = 1.6) -> float:
    """Return how far one can walk straight on."""
    step, reach = 0.05, 0.0
    while reach + step <= longest:
        x = start[0, 3] + (reach + step) * np.cos(heading)
        y = start[1, 3] + (reach + step) * np.sin(heading)
        if not is_free(room, float(x), float(y), _BODY_M - 0.05):
            break
        reach += step
    return reach
