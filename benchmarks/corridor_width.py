"""Width of the real corridor's floor (2.15 m), of all frames that show the foot of both walls; things seen on it."""

from __future__ import annotations

import sys

import numpy as np

from benchmarks._floor_width import floor_width
from benchmarks._frames import DATA
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import OCCUPIED_CELL, FreeSpace, compute_free_space
from room_layout_ros.datasets import good_samples, open_folder

WIDTH_M = 2.15
TOLERANCE_M = 0.10
IN_VIEW = ((0, 84), (118, 178))
"""Frames in which the foot of both walls is in the picture, found by looking at them."""

EMPTY = (0, 60)
EMPTY_M, HALF_M = (1.5, 4.0), 0.4
"""Frames in which nothing stands ahead at these distances, so far to either side; found by looking at them."""


def measure(estimator: LayoutEstimator, frame: RgbdFrame) -> tuple[float, int]:
    """Return the width in m, NaN where the estimate has not both walls, and how many cells ahead are occupied."""
    geometry = compute_depth_geometry(frame, estimator.config)
    if geometry is None:
        return float("nan"), 0
    space = compute_free_space(geometry, estimator.estimate(frame), estimator.config, color=frame.color)
    return floor_width(geometry, space), 0 if space is None else occupied_ahead(space)


def occupied_ahead(space: FreeSpace) -> int:
    """Return how many cells are occupied where in the frames of `EMPTY` nothing stands."""
    rows, cols = space.grid.shape
    y = space.origin_m[1] + (np.arange(rows) + 0.5) * space.resolution_m
    x = space.origin_m[0] + (np.arange(cols) + 0.5) * space.resolution_m
    ahead = space.grid[np.ix_(np.abs(y) < HALF_M, (x > EMPTY_M[0]) & (x < EMPTY_M[1]))]
    return int((ahead == OCCUPIED_CELL).sum())


def is_in_view(frame: int) -> bool:
    """Whether the frame shows the foot of both walls."""
    return any(first <= frame <= last for first, last in IN_VIEW)


def is_right(width_m: float) -> bool:
    """Whether a width is within the tolerance; a missing one (NaN) is not."""
    return bool(abs(width_m - WIDTH_M) <= TOLERANCE_M)


def report(widths: dict[int, float]) -> str:
    """Return the table; `widths` by frame number. A frame without a width counts as wrong."""
    lines = [f"{'':<36}{'frames':>7}{'with a width':>14}{'within 10 cm':>14}{'% of frames':>13}{'median m':>10}"]
    in_view = {i: w for i, w in widths.items() if is_in_view(i)}
    for title, chosen in (("both feet in the picture (by eye)", in_view), ("all frames", widths)):
        known = [w for w in chosen.values() if np.isfinite(w)]
        good = sum(is_right(w) for w in chosen.values())
        share, middle = 100.0 * good / max(len(chosen), 1), np.median(known) if known else np.nan
        lines.append(f"{title:<36}{len(chosen):>7}{len(known):>14}{good:>14}{share:>13.1f}{middle:>10.3f}")
    wrong = [f"{i}: {w:.3f}" for i, w in sorted(in_view.items()) if not is_right(w)]
    return "\n".join([*lines, f"wrong with both feet in the picture: {', '.join(wrong) or 'none'}"])


def main(step: int = 1) -> int:
    if not (DATA / "corridor" / "camera.yaml").exists():
        print(f"{DATA / 'corridor'} is not here: nothing to measure")
        return 0
    folder = open_folder(DATA / "corridor")
    estimator = LayoutEstimator(EstimatorConfig())
    chosen = folder.subset(tuple(sorted(folder.names)[::step]))
    found = {int(s.name): measure(estimator, s.frame) for s in good_samples(chosen)}
    print(report({i: width for i, (width, _) in found.items()}))
    empty = [occupied for i, (_, occupied) in found.items() if EMPTY[0] <= i <= EMPTY[1]]
    where = f"{EMPTY_M[0]}-{EMPTY_M[1]} m ahead, {HALF_M} m to either side"
    print(
        f"{where}, where nothing stands in frames {EMPTY[0]}-{EMPTY[1]}: {sum(empty)} occupied cells, in "
        f"{sum(n > 0 for n in empty)} of {len(empty)} frames"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
