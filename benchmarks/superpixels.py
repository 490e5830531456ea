"""Superpixels on NYU v2: the paper's Table 3 over the weights of colour and depth, beside scikit-image and OpenCV.

Three measures (natural logarithms) of what an oracle gets who labels each of 200 superpixels with its majority class:
share of wrong pixels (ME), covering of the true regions, variation of information; means over the images. Against
  * the 40 classes, on frames that are not among the 37 with hand-made layouts nor their neighbours (index +-5): the
    settings were chosen on these;
  * the six labels of the paper's task (five faces, clutter), on the 37, which took no part in the choice;
  * the six labels with fitted layouts, on the frames of the first kind, where ROOM_LAYOUT_FITS names the output of
    room-layout fit.
Unlabelled pixels (17.5 % of every 20th frame) are ignored; for the 37 a second table counts them as clutter. We do not
know what the paper does, and plain SLIC comes out on either side of its figures: compare the gain over plain SLIC.

    python -m benchmarks superpixels          every 20th frame; ROOM_LAYOUT_EVERY=10 for every 10th
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
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
from room_layout_ros.evaluation.fitted_truth import FittedSource
from room_layout_ros.evaluation.segmentation import segmentation_scores
from room_layout_ros.learning.fit_frame import read_fits
from room_layout_ros.learning.folds import is_near

Labels = NDArray[np.uint8]
Segment = Callable[[NDArray[np.uint8], NDArray[np.float32]], NDArray[np.integer]]
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


def six_labels(sample: Sample) -> Labels:
    assert sample.truth is not None
    assert sample.truth.labels is not None
    return sample.truth.labels


def six_labels_all(sample: Sample) -> Labels:
    labels = six_labels(sample)
    return np.where(labels == 0, np.uint8(CLUTTER), labels)


def classes40(sample: Sample) -> Labels:
    assert sample.truth is not None
    assert sample.truth.labels40 is not None
    return sample.truth.labels40


def compare(title: str, samples: Sequence[Sample], truths: Mapping[str, Callable[[Sample], Labels]]) -> None:
    """Print a table for each truth; every contender segments each frame once."""
    tables: dict[str, list[str]] = {name: [] for name in truths}
    for contender, segment in contenders():
        found: list[NDArray[np.integer]] = []
        spent: list[float] = []
        for sample in samples:
            assert sample.frame.color is not None
            assert sample.frame.depth_m is not None
            depth_m = sample.frame.depth_m
            w = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
            if not found:
                segment(sample.frame.color, w)  # compile
            start = time.thread_time()
            found.append(segment(sample.frame.color, w))
            spent.append(1e3 * (time.thread_time() - start))
        count = np.mean([len(np.unique(index)) for index in found])
        for name, truth_of in truths.items():
            scores = [segmentation_scores(index, truth_of(s)) for index, s in zip(found, samples, strict=True)]
            rows = [(100 * s.mean_error, 100 * s.covering, s.variation_of_information) for s in scores]
            error, cover, vi = np.mean(rows, axis=0)
            line = f"{contender:32s} {count:6.0f} {error:6.2f} {cover:8.2f} {vi:6.3f} {np.median(spent):7.1f}"
            tables[name].append(line)
    for name, lines in tables.items():
        print(f"\n{title}: {len(samples)} frames; truth: {name}; CPU time of one thread")
        print(f"{'':32s} {'count':>6s} {'ME %':>6s} {'cover %':>8s} {'VI':>6s} {'ms':>7s}")
        print("\n".join(lines), flush=True)


def main() -> int:
    folder = DATA / "nyuv2"
    if not folder.is_dir():
        print(f"passed over: {folder} is not here (set ROOM_LAYOUT_DATA)")
        return 0
    cv2.setNumThreads(1)
    splits = json.loads((folder / "splits.json").read_text())
    dev, frames = ([f"{int(i):04d}" for i in splits[name]] for name in ("layout_dev", "frames"))
    every = int(os.environ.get("ROOM_LAYOUT_EVERY", "20"))
    outside = [name for name, near in zip(frames, is_near(frames, dev), strict=True) if not near][::every]
    source = open_folder(folder)
    others = source.subset(tuple(outside))
    compare("others", list(good_samples(others)), {"40 classes": classes40})
    if "ROOM_LAYOUT_FITS" in os.environ:
        rooms = read_fits(Path(os.environ["ROOM_LAYOUT_FITS"]))
        fitted = [s for s in good_samples(FittedSource(others, rooms)) if s.name in rooms]
        compare("others with an accepted fit", fitted, {"six labels": six_labels})
    hand_made = list(good_samples(source.subset(tuple(dev))))
    truths = {"six labels": six_labels, "six labels, unlabelled as clutter": six_labels_all}
    compare("the 37", hand_made, truths)
    print("\nthe paper (202 + 101 other frames)")
    for color, depth, error, cover, vi in PAPER:
        print(f"{f'I={color} D={depth}':32s} {COUNT:6d} {error:6.2f} {cover:8.2f} {vi:6.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
