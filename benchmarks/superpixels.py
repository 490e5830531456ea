"""Superpixels on NYU v2: the paper's Table 3 over the weights of colour and depth, beside scikit-image and OpenCV.

Three measures (natural logarithms) of what an oracle gets who labels each of 200 superpixels with its majority class;
unlabelled pixels are ignored. Once with the 40 classes on frames that are not among the ones with hand-made layouts nor
their neighbours (index +-5): the settings were chosen on these. Once with the six labels of the paper's task
(five faces, clutter) on the 37 frames with layouts, which took no part in it; there the covering and the variation of
information count unlabelled pixels as clutter, which is what brings plain SLIC near the paper's figures.

    python -m benchmarks superpixels          every 20th frame; ROOM_LAYOUT_EVERY=10 for every 10th
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._frames import DATA
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.superpixels import compute_superpixels
from room_layout_ros.datasets import good_samples, open_folder
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.evaluation.segmentation import segmentation_scores

Segment = Callable[[NDArray[np.uint8], NDArray[np.float32]], NDArray[np.integer]]
MARGIN = 5
COUNT = 200
PAPER = ((1, 0, 2.51, 88.76, 0.63), (1, 1, 2.15, 89.36, 0.58), (0, 1, 2.81, 88.18, 0.66))


def ours(color: float, depth: float, gradient: float = 0.0, oversegmentation: float | None = None) -> Segment:
    default = EstimatorConfig()
    config = EstimatorConfig(
        superpixel_count=COUNT,
        superpixel_lambda_color=color,
        superpixel_lambda_depth=depth,
        superpixel_lambda_gradient=gradient,
        superpixel_oversegmentation=default.superpixel_oversegmentation
        if oversegmentation is None
        else oversegmentation,
    )
    return lambda image, w: compute_superpixels(image, w, config).index


def peers() -> Iterator[tuple[str, Segment]]:
    """Yield other programs' SLIC where they are installed."""
    try:
        from skimage.segmentation import slic
    except ImportError:
        print("scikit-image is not installed (extra: bench); its SLIC is left out")
    else:
        # asked for 200 it makes 150; 280 gives about 200
        yield "scikit-image slic", lambda image, w: slic(image, n_segments=280, compactness=10, start_label=0)
    ximgproc: Any = getattr(cv2, "ximgproc", None)
    if ximgproc is None:
        print("this OpenCV has no ximgproc (only opencv-contrib has); its SLIC is left out")
        return

    def opencv(image: NDArray[np.uint8], w: NDArray[np.float32]) -> NDArray[np.integer]:
        lab = cv2.cvtColor(image, cv2.COLOR_RGB2LAB)
        found = ximgproc.createSuperpixelSLIC(lab, ximgproc.SLIC, round((image.size / 3 / COUNT) ** 0.5), 10.0)
        found.iterate(10)
        found.enforceLabelConnectivity(25)
        return np.asarray(found.getLabels())

    yield "OpenCV SLIC", opencv


def contenders() -> Iterator[tuple[str, Segment]]:
    """Yield the rows of the table: title and function."""
    a, d = EstimatorConfig().superpixel_lambda_color, EstimatorConfig().superpixel_lambda_depth
    yield from peers()
    yield "ours, unmerged, D=0", ours(a, 0, 0, 1.0)
    yield "ours, unmerged, plane", ours(a, d, 0, 1.0)
    yield "ours, unmerged, gradient (paper)", ours(a, 0, d, 1.0)
    yield "merged, D=0", ours(a, 0)
    yield "merged, gradient (paper)", ours(a, 0, d)
    yield f"merged, default (I={a:g} D={d:g})", ours(a, d)
    for color, depth in ((0.0, d), (a / 5, d), (a / 2, d), (2 * a, d), (a, d / 4), (a, d * 4)):
        yield f"merged, I={color:g} D={depth:g}", ours(color, depth)


def compare(samples: list[Sample], six_labels: bool) -> None:
    print(f"\n{'six labels' if six_labels else '40 classes'}, {len(samples)} frames, CPU time of one thread")
    print(f"{'':32s} {'count':>6s} {'ME %':>6s} {'cover %':>8s} {'VI':>6s} {'ms':>7s}")
    for title, segment in contenders():
        rows: list[tuple[float, ...]] = []
        for sample in samples:
            assert sample.frame.color is not None
            assert sample.frame.depth_m is not None
            assert sample.truth is not None
            depth_m = sample.frame.depth_m
            w = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
            truth = sample.truth.labels if six_labels else sample.truth.labels40
            assert truth is not None
            if not rows:
                segment(sample.frame.color, w)  # compile
            start = time.thread_time()
            index = segment(sample.frame.color, w)
            spent = time.thread_time() - start
            scores = segmentation_scores(index, truth)
            regions = segmentation_scores(index, np.where(truth == 0, CLUTTER, truth)) if six_labels else scores
            figures = (scores.mean_error * 100, regions.covering * 100, regions.variation_of_information)
            rows.append((len(np.unique(index)), *figures, spent * 1e3))
        count, error, cover, vi, _ = np.mean(rows, axis=0)
        print(
            f"{title:32s} {count:6.0f} {error:6.2f} {cover:8.2f} {vi:6.3f} {np.median(rows, axis=0)[-1]:7.1f}",
            flush=True,
        )


def main() -> int:
    folder = DATA / "nyuv2"
    if not folder.is_dir():
        print(f"passed over: {folder} is not here (set ROOM_LAYOUT_DATA)")
        return 0
    cv2.setNumThreads(1)
    splits = json.loads((folder / "splits.json").read_text())
    dev = np.array([int(i) for i in splits["layout_dev"]])
    every = int(os.environ.get("ROOM_LAYOUT_EVERY", "20"))
    outside = [int(i) for i in splits["frames"] if np.abs(dev - int(i)).min() > MARGIN][::every]
    source = open_folder(folder)
    compare(list(good_samples(source.subset(tuple(f"{i:04d}" for i in outside)))), six_labels=False)
    compare(list(good_samples(source.subset(tuple(f"{i:04d}" for i in dev)))), six_labels=True)
    print("\nthe paper (202 + 101 other frames)")
    for color, depth, error, cover, vi in PAPER:
        print(f"{f'I={color} D={depth}':32s} {COUNT:6d} {error:6.2f} {cover:8.2f} {vi:6.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
