"""The frames that benchmarks run on: real ones where the data lies beside the repository, else rendered ones."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.datasets import good_samples, open_folder
from room_layout_ros.datasets.synthetic import SyntheticSource

DATA = Path(os.environ.get("ROOM_LAYOUT_DATA", Path(__file__).parents[2] / "shared" / "data"))

HD = CameraIntrinsics(1280, 720, 910.0, 910.0, 639.5, 359.5)
"""What RealSense, OAK-D and Orbbec send by default, more or less."""


def load_frames(count: int) -> dict[str, list[RgbdFrame]]:
    """Return lists of at most `count` frames by title: sharp depth, 8-bit depth, rendered."""
    found: dict[str, list[RgbdFrame]] = {}
    for name in ("corridor", "nyuv2"):
        if (DATA / name / "camera.yaml").exists():
            folder = open_folder(DATA / name)
            chosen = {folder.names[int(i)] for i in np.linspace(0, len(folder.names) - 1, count)}
            found[name] = [s.frame for s in good_samples(folder.subset(tuple(sorted(chosen))))]
    if not found:
        print(f"{DATA} is not here; rendered frames are used")
        found["rendered"] = [s.frame for s in good_samples(SyntheticSource(frames=min(count, 20), seed=4))]
    return found
