"""Width of the floor of the real corridor (2.15 m): the distance between left and right wall at floor level."""

from __future__ import annotations

import sys

import numpy as np

from benchmarks._frames import DATA
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import compute_free_space
from room_layout_ros.datasets import good_samples, open_folder
from room_layout_ros.evaluation.free_space import floor_width

WIDTH_M = 2.15
TOLERANCE_M = 0.10
IN_VIEW = ((0, 84), (118, 178))
"""Frames in which the foot of both walls is in the picture, found by looking at them."""


def width_of(estimator: LayoutEstimator, frame: RgbdFrame) -> float:
    """Return the width in m, NaN where the estimate has not both walls."""
    geometry = compute_depth_geometry(frame, estimator.config)
    if geometry is None:
        return float("nan")
    estimate = estimator.estimate(frame)
    return floor_width(estimate, compute_free_space(geometry, estimate, estimator.config))


def report(widths: dict[int, float]) -> str:
    """Return the table; `widths` by frame number."""
    in_view = np.array([w for i, w in widths.items() if any(a <= i <= b for a, b in IN_VIEW)])
    every = np.array(list(widths.values()))
    lines = [f"{'':<44}{'frames':>7}{'with both walls':>17}{'within 10 cm':>14}{'% of them':>11}{'median m':>10}"]
    for title, w in (("both feet in the picture (by eye)", in_view), ("all frames", every)):
        both = np.isfinite(w)
        good = int((np.abs(w[both] - WIDTH_M) <= TOLERANCE_M).sum())
        share, middle = (100.0 * good / both.sum(), np.median(w[both])) if both.any() else (np.nan, np.nan)
        lines.append(f"{title:<44}{len(w):>7}{int(both.sum()):>17}{good:>14}{share:>11.1f}{middle:>10.3f}")
    wrong = [f"{i}: {w:.2f}" for i, w in sorted(widths.items()) if abs(w - WIDTH_M) > TOLERANCE_M]
    missing = [str(i) for i, w in sorted(widths.items()) if not np.isfinite(w) and any(a <= i <= b for a, b in IN_VIEW)]
    return "\n".join([*lines, f"off: {', '.join(wrong) or 'none'}", f"a wall missing: {', '.join(missing) or 'none'}"])


def main(step: int = 1) -> int:
    if not (DATA / "corridor" / "camera.yaml").exists():
        print(f"{DATA / 'corridor'} is not here: nothing to measure")
        return 0
    folder = open_folder(DATA / "corridor")
    estimator = LayoutEstimator(EstimatorConfig())
    chosen = folder.subset(tuple(sorted(folder.names)[::step]))
    print(report({int(s.name): width_of(estimator, s.frame) for s in good_samples(chosen)}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
