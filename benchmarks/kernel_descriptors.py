"""Furniture by kernel descriptors (the paper's way) against the forest: IoU per class on the 37, and time a frame.

All rows are whole estimates on the same frames, with the estimator's own clutter. The paper's row is of its own 101
images, of which the 37 are a part.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import cv2
import numpy as np

from benchmarks._frames import DATA
from room_layout_ros.commands.frame_choice import subset_names
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.labels import FURNITURE_NYU40
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.datasets import Sample, good_samples, open_folder
from room_layout_ros.evaluation.prediction import Prediction
from room_layout_ros.evaluation.published import TABLE_5
from room_layout_ros.evaluation.scores import SetScore, score_frame

ROWS = {
    "forest (default)": EstimatorConfig(),
    "forest, no scene network": EstimatorConfig(scene_network=False),
    "kernel descriptors": EstimatorConfig(furniture_features="kernel"),
    "kernel descriptors, no scene network": EstimatorConfig(scene_network=False, furniture_features="kernel"),
    "forest, RGB": EstimatorConfig(use_depth=False),
    "forest, no scene network, RGB": EstimatorConfig(use_depth=False, scene_network=False),
    "kernel descriptors, RGB": EstimatorConfig(use_depth=False, furniture_features="kernel"),
}


def judge(title: str, config: EstimatorConfig, samples: Sequence[Sample]) -> tuple[SetScore, float, float]:
    """Scores, and medians in milliseconds: wall time of the furniture stage, processor time of the whole estimate."""
    estimator = LayoutEstimator(config)
    estimator.estimate(samples[0].frame)  # compiles
    scores, furniture_ms, whole_ms = [], [], []
    for sample in samples:
        start = time.process_time_ns()
        estimate = estimator.estimate(sample.frame)
        whole_ms.append(1e-6 * (time.process_time_ns() - start))
        furniture_ms.append(estimate.timings_ms.get("furniture", 0.0))
        scores.append(score_frame(sample, Prediction.of_estimate(estimate)))
    return SetScore(title, tuple(scores)), float(np.median(furniture_ms)), float(np.median(whole_ms))


def main() -> int:
    cv2.setNumThreads(1)
    if not (DATA / "nyuv2" / "splits.json").exists():
        print(f"{DATA / 'nyuv2'} is not here: nothing to measure")
        return 0
    folder = open_folder(DATA / "nyuv2")
    samples = list(good_samples(folder.subset(subset_names(folder, "layout_dev", "--frames"))))
    print(f"{len(samples)} frames; IoU in percent, of the mean its 95 % interval; median ms of furniture, of all")
    print(f"| | {' | '.join(FURNITURE_NYU40.values())} | mean | furniture, wall | whole, processor |")
    print("|" + "---|" * (len(FURNITURE_NYU40) + 4))
    for title, config in ROWS.items():
        try:
            score, furniture_ms, whole_ms = judge(title, config, samples)
        except WeightsError as error:
            print(f"| {title} | {error} |")
            continue
        ious = [score.figures[f"furniture_iou.{k}"].value for k in FURNITURE_NYU40]
        mean = score.figures["mean_furniture_iou"]
        cells = " | ".join(f"{100 * value:.1f}" for value in (*ious, mean.value))
        spread = f"({100 * mean.low:.0f} to {100 * mean.high:.0f})"
        print(f"| {title} | {cells} {spread} | {furniture_ms:.1f} | {whole_ms:.0f} |", flush=True)
    paper = [TABLE_5[name] for name in FURNITURE_NYU40.values()]
    print(f"| *paper, its own 101 images* | {' | '.join(f'{v:.1f}' for v in (*paper, np.mean(paper)))} | | |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
