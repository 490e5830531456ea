"""The estimator on spoilt input: real frames with worse depth, and rendered rooms by sensor.

Chance is seeded per frame; every condition sees the same frames. A frame without an answer is wrong in every pixel.
The rendered rooms were in no training: `SyntheticSource` draws from [seed, 1, i], and training from `random_frames`,
which draws from [seed, 2, i] with the seeds 5 and 6.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._frames import DATA
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.datasets import Sample, good_samples, open_folder
from room_layout_ros.datasets.synthetic import NOISES, SyntheticSource
from room_layout_ros.evaluation.measures import mean_iou, score_pixels

Depth = NDArray[np.float32]
Spoil = Callable[[Depth, np.random.Generator], Depth]

DISPARITY_STEP_PER_M = 1 / (8 * 525.0 * 0.075)
"""Inverse depth of an eighth of a pixel of disparity: a Kinect (26 mm at 3 m)."""
COARSE_STEP_M = 0.10
NOISE_M, NOISE_PER_M = 0.002, 0.0014
"""Standard deviation of a Kinect: NOISE_M + NOISE_PER_M z^2 (the one of `learning/degradation.py`)."""
LOST = 0.30
BLOCK_PX = 40
RENDERED, SEED = 24, 2013
SCENE = "random"
"""Every kind of room, those that are no cuboid too."""

WALL_CLUTTER = 0.25
"""This share of every wall is hidden."""


def quantise_disparity(depth_m: Depth, rng: np.random.Generator) -> Depth:
    """Round inverse depth to the steps of a Kinect."""
    steps = np.maximum(np.round(1.0 / (depth_m * DISPARITY_STEP_PER_M)), 1.0)
    return np.asarray(1.0 / (steps * DISPARITY_STEP_PER_M), np.float32)


def quantise_coarsely(depth_m: Depth, rng: np.random.Generator) -> Depth:
    """Round depth to steps of 10 cm."""
    return np.asarray(np.round(depth_m / COARSE_STEP_M) * COARSE_STEP_M, np.float32)


def add_noise(factor: float) -> Spoil:
    """Return white noise of the sensor model times `factor`."""

    def spoil(depth_m: Depth, rng: np.random.Generator) -> Depth:
        sigma = factor * (NOISE_M + NOISE_PER_M * depth_m**2)
        return np.asarray(depth_m + sigma * rng.standard_normal(depth_m.shape), np.float32)

    return spoil


def lose_blocks(depth_m: Depth, rng: np.random.Generator) -> Depth:
    """Lose 30 % of the blocks of 40 x 40 pixels."""
    height, width = depth_m.shape
    lost = rng.random((-(-height // BLOCK_PX), -(-width // BLOCK_PX))) < LOST
    whole = np.kron(lost, np.ones((BLOCK_PX, BLOCK_PX), bool))[:height, :width]
    return np.where(whole, np.float32(np.nan), depth_m)


def lose_pixels(depth_m: Depth, rng: np.random.Generator) -> Depth:
    """Lose 30 % of the pixels, each by itself."""
    return np.where(rng.random(depth_m.shape) < LOST, np.float32(np.nan), depth_m)


SPOILT: dict[str, Spoil] = {
    "as it is (8-bit depth, steps of 39 mm)": lambda depth_m, rng: depth_m,
    "steps of 1/8 px of disparity besides": quantise_disparity,
    "steps of 10 cm": quantise_coarsely,
    "noise of a Kinect besides": add_noise(1.0),
    "three times that noise": add_noise(3.0),
    "30 % of depth lost in blocks of 40 px": lose_blocks,
    "30 % of depth lost pixel by pixel": lose_pixels,
}


def main() -> int:
    cv2.setNumThreads(1)
    estimator = LayoutEstimator()
    if (DATA / "nyuv2" / "splits.json").exists():
        names = tuple(path.stem for path in sorted((DATA / "nyuv2" / "layout").glob("*.png")))
        samples = list(good_samples(open_folder(DATA / "nyuv2").subset(names)))
        _real(estimator, samples)
    else:
        print(f"{DATA / 'nyuv2'} is not here: rendered rooms only")
    print(f"\n{RENDERED} rendered rooms per sensor, the same rooms and views (seed {SEED})")
    _head()
    for noise in NOISES:
        source = SyntheticSource(RENDERED, SEED, SCENE, noise, walk=False, options={"wall_clutter": WALL_CLUTTER})
        rendered = list(good_samples(source))
        _row(f"rendered, {noise}", estimator, ((s, s.frame) for s in rendered))
        _row(f"rendered, {noise}, colour only", estimator, ((s, s.frame.without_depth()) for s in rendered))
    return 0


def _real(estimator: LayoutEstimator, samples: list[Sample]) -> None:
    print(f"{len(samples)} frames with hand-made layouts")
    _head()
    for title, spoil in SPOILT.items():
        _row(title, estimator, ((s, _spoilt(s.frame, spoil, i)) for i, s in enumerate(samples)))
    halved = LayoutEstimator(EstimatorConfig(working_size_px=320))
    _row("half the resolution", halved, ((s, s.frame) for s in samples))
    depth_only = LayoutEstimator(EstimatorConfig(use_color=False))
    _row("depth only", depth_only, ((s, s.frame) for s in samples))
    _row("colour only", estimator, ((s, s.frame.without_depth()) for s in samples))


def _spoilt(frame: RgbdFrame, spoil: Spoil, index: int) -> RgbdFrame:
    assert frame.depth_m is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        return replace(frame, depth_m=spoil(frame.depth_m, np.random.default_rng([SEED, index])))


def _head() -> None:
    print("| | layout | median | labelling | median | mean IoU | no answer |")
    print("|---|---|---|---|---|---|---|")


def _row(title: str, estimator: LayoutEstimator, pairs: Iterable[tuple[Sample, RgbdFrame]]) -> None:
    layouts, labellings, silent, counts = [], [], 0, np.zeros((7, 7), np.int64)
    for sample, frame in pairs:
        truth = sample.truth
        assert truth is not None
        assert truth.layout is not None
        estimate = estimator.estimate(frame)
        silent += estimate.status is not Status.OK
        score = score_pixels(truth.layout, estimate.layout, truth.labels, estimate.labels)
        layouts.append(100 * score.layout_error)
        labellings.append(100 * score.labelling_error)
        counts += score.labels_confusion
    print(
        f"| {title} | {np.mean(layouts):.1f} | {np.median(layouts):.1f} | {np.nanmean(labellings):.1f} "
        f"| {np.nanmedian(labellings):.1f} | {100 * mean_iou(counts):.1f} | {silent} |",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
