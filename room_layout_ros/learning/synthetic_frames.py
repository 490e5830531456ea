"""Synthetic rooms to learn from, each frame another room, camera and sensor: what one data set cannot show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..core.frame import CameraIntrinsics
from ..datasets.sample import Sample
from ..datasets.synthetic import KINDS, KINECT, NOISES, random_pose, random_scene, render

CAMERAS = (
    KINECT,
    CameraIntrinsics(640, 480, 385.0, 385.0, 322.0, 241.0),
    CameraIntrinsics(640, 480, 610.0, 610.0, 318.0, 244.0),
    CameraIntrinsics(848, 480, 425.0, 425.0, 424.0, 240.0),
)
"""Fields of view between 55 and 90 degrees."""

_WALL_CLUTTER = (0.0, 0.0, 0.25, 0.4, 0.5)
_FURNITURE = (0.2, 0.7, 1.0, 1.5)
_TRIES = 5


def random_frames(count: int, seed: int = 0) -> Iterator[Sample]:
    """Render frames of random rooms; frame i has noise model i mod 4 of `NOISES` and is the same for every count.

    Parameters
    ----------
    count : frames. seed : the same seed gives the same bytes.
    """
    noises = tuple(NOISES.values())
    for i in range(count):
        rng = np.random.default_rng([seed, 2, i])
        for _ in range(_TRIES):
            room = random_scene(
                rng,
                str(rng.choice(KINDS, p=(0.5, 0.15, 0.1, 0.1, 0.15))),
                furniture=float(rng.choice(_FURNITURE)),
                wall_clutter=float(rng.choice(_WALL_CLUTTER)),
                same_color_walls=True if rng.random() < 0.15 else None,
                small_objects=int(rng.integers(5)),
                decorate=bool(rng.random() < 0.85),
            )
            try:
                pose = random_pose(room, rng, (0.5, 1.7), (-25.0, 5.0), 4.0)
            except ValueError:  # too full to stand in it: another room
                continue
            camera = CAMERAS[int(rng.integers(len(CAMERAS)))]
            yield render(room, camera, pose, noises[i % len(noises)], rng, name=f"{i:06d}")
            break
