"""Synthetic rooms as a source of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.datasets.errors import DataError
from room_layout_ros.datasets.folder import default_stamp_ns
from room_layout_ros.datasets.sample import BadFrame, Sample

from .noise import NOISES
from .paths import random_pose, walk
from .render import KINECT, render
from .room import KINDS
from .scene import random_scene


@dataclass(frozen=True, slots=True)
class SyntheticSource:
    """Frames of synthetic rooms: one walk through one room, or a new room for each frame.

    Parameters
    ----------
    frames : number of frames. seed : the same seed gives the same bytes.
    kind : of `room.KINDS`, or "random". noise : name in `noise.NOISES`.
    walk : False makes a new room and a new view for each frame.
    options : further arguments of `random_scene`.

    Raises
    ------
    DataError
        When a number or a name is not allowed.
    """

    frames: int = 60
    seed: int = 0
    kind: str = "cuboid"
    noise: str = "kinect"
    walk: bool = True
    camera: CameraIntrinsics = KINECT
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise DataError(f"frames is {self.frames}; it must be 1 or more")
        if self.kind not in (*KINDS, "random"):
            raise DataError(f"room kind is {self.kind!r}; allowed are random, {', '.join(KINDS)}")
        if self.noise not in NOISES:
            raise DataError(f"noise is {self.noise!r}; allowed are {', '.join(NOISES)}")

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"synthetic {self.kind} room, seed {self.seed}"

    @property
    def length(self) -> int:
        """Number of frames."""
        return self.frames

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Render the frames one after the other."""
        # One stream of chance for the scene and one for each frame: frame 7 is the same however many there are.
        scene_rng = np.random.default_rng([self.seed, 0])
        room = random_scene(scene_rng, self.kind, **self.options)
        poses = walk(room, scene_rng, self.frames) if self.walk else None
        for i in range(self.frames):
            rng = np.random.default_rng([self.seed, 1, i])
            if poses is None:
                room = random_scene(rng, self.kind, **self.options)
            pose = random_pose(room, rng) if poses is None else poses[i]
            name, stamp_ns = f"{i:06d}", default_stamp_ns(i)
            yield render(room, self.camera, pose, NOISES[self.noise], rng, stamp_ns, name)
