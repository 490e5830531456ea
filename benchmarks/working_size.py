"""What resizing to a working size saves and gains: real frames, and rooms seen by cameras of 160x120 to 1280x720."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from benchmarks._frames import DATA, HD
from benchmarks._free_space import (
    FreeSpaceScore,
    Mount,
    random_views,
    score_free_space,
    true_free_space,
)
from benchmarks.free_space import SEED, SIZES_M, pooled, small_things
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.datasets import good_samples, open_folder
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import KINECT, NOISES, SyntheticRoom
from room_layout_ros.evaluation.measures import mean_iou, score_pixels
from room_layout_ros.learning.working_sample import at_working_size

ROOMS, SCENES = 16, 8
OWN = 0
RENDERED = {
    "1280x720": (HD, (OWN, 640, 320)),
    "640x480": (KINECT, (640, 320)),
    "320x240": (CameraIntrinsics(320, 240, 262.0, 262.0, 159.5, 119.5), (OWN, 640)),
    "320x240, 120 deg": (CameraIntrinsics(320, 240, 92.0, 92.0, 159.5, 119.5), (OWN, 640)),
    "224x172": (CameraIntrinsics(224, 172, 186.0, 186.0, 111.5, 85.5), (OWN, 640)),
    "160x120": (CameraIntrinsics(160, 120, 131.0, 131.0, 79.5, 59.5), (OWN, 640)),
}
"""Cameras of the rendered rooms, and the working sizes that each is looked at with."""

HEAD = (
    f"{'':<36}{'layout %':>10}{'labels %':>10}{'mean IoU':>10}{'CPU ms':>8}"
    f"{'free IoU':>10}{'too near':>10}{'3 cm':>7}{'5 cm':>7}{'CPU ms':>8}"
)


@dataclass
class Row:
    """Errors of one working size; `seconds` are CPU time of the estimate, `floor_seconds` that of free space."""

    layout: list[float] = field(default_factory=list)
    labelling: list[float] = field(default_factory=list)
    confusion: list[np.ndarray[tuple[int, ...], np.dtype[np.int64]]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    floor: list[FreeSpaceScore] = field(default_factory=list)
    floor_seconds: list[float] = field(default_factory=list)
    found: str = ""

    def line(self, title: str) -> str:
        iou = 100 * mean_iou(np.sum(self.confusion, axis=0))
        of_room = f"{np.mean(self.layout):>10.2f}{np.nanmean(self.labelling):>10.2f}{iou:>10.1f}"
        line = f"{title:<36}{of_room}{1e3 * np.median(self.seconds):>8.1f}"
        if not self.floor:
            return line
        near = sum(s.too_near for s in self.floor)
        of_floor = f"{pooled(self.floor, 'pool_measured'):>10.3f}{near:>10}{self.found}"
        return f"{line}{of_floor}{1e3 * np.median(self.floor_seconds):>8.1f}"


def measure(config: EstimatorConfig, views: Iterable[tuple[SyntheticRoom | None, Sample]]) -> Row:
    """Estimate every view twice, for the time of the second; free space where the room is known."""
    row, estimator = Row(), LayoutEstimator(config)
    for room, sample in views:
        truth, frame = sample.truth, sample.frame
        assert truth is not None
        assert truth.layout is not None
        estimator.estimate(frame)
        start = time.process_time()
        estimate = estimator.estimate(frame)
        row.seconds.append(time.process_time() - start)
        score = score_pixels(truth.layout, estimate.layout, truth.labels, estimate.labels)
        row.layout.append(100 * score.layout_error)
        row.labelling.append(100 * score.labelling_error)
        row.confusion.append(score.labels_confusion)
        if room is None:
            continue
        start = time.process_time()
        space = free_space_of_frame(frame, estimate, config)
        row.floor_seconds.append(time.process_time() - start)
        size = config.free_space_resolution_m, config.free_space_forward_m, config.free_space_side_m
        row.floor.append(score_free_space(true_free_space(room, sample, *size), space))
    return row


def main() -> int:
    print(HEAD)
    if (DATA / "nyuv2" / "splits.json").exists():
        names = tuple(path.stem for path in sorted((DATA / "nyuv2" / "layout").glob("*.png")))
        samples = list(good_samples(open_folder(DATA / "nyuv2").subset(names)))
        for size in (640, 320):
            row = measure(EstimatorConfig(working_size_px=size), ((None, sample) for sample in samples))
            print(row.line(f"nyuv2, the {len(names)}, at {size}"), flush=True)
        for part in (3, 4):
            reduced = EstimatorConfig(working_size_px=samples[0].frame.camera.width // part)
            small = [at_working_size(sample, reduced) for sample in samples]
            for size in (OWN, 640):
                row = measure(EstimatorConfig(working_size_px=size), ((None, sample) for sample in small))
                title = f"nyuv2 of {small[0].frame.camera.width}x{small[0].frame.camera.height}"
                print(row.line(f"{title}, at {_said(size)}"), flush=True)
    for noise in NOISES:
        for title, (camera, sizes) in RENDERED.items():
            for size in sizes:
                _rendered(title, camera, size, noise)
    return 0


def _said(size: int) -> str:
    return "its own" if size == OWN else str(size)


def _rendered(title: str, camera: CameraIntrinsics, size: int, noise: str) -> None:
    config, mount = EstimatorConfig(working_size_px=size), Mount(camera, (1.1, 1.65), (-18.0, -3.0))
    row = measure(config, random_views(range(ROOMS), SEED, noise, mount=mount))
    for side_m in SIZES_M:
        found, total = small_things(LayoutEstimator(config), noise, side_m, range(SCENES), camera)
        row.found += f"{found:>4}/{total}"
    print(row.line(f"{title}, {noise}, at {_said(size)}"), flush=True)


if __name__ == "__main__":
    sys.exit(main())
