"""Refinement on the edges that the picture shows, with and without: planes of rendered rooms, faces of real ones."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks._frames import DATA
from benchmarks._free_space import random_views
from benchmarks._planes import Planes
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.datasets import Sample, good_samples, open_folder
from room_layout_ros.datasets.synthetic import NOISES
from room_layout_ros.learning.folds import MARGIN, is_near

ROOMS, FIRST, STREAM = 16, 8000, 11
EVERY = 4
"""Of the real frames; none near one of the 37 that have a hand-made layout."""

CEILING, FLOOR, WALL = 1, 2, 3
KIND_OF_CLASS = {22: CEILING, 2: FLOOR, 20: FLOOR, **dict.fromkeys((1, 8, 9, 11, 13, 16, 19, 30), WALL)}
"""Kind of face that shows where a pixel has this NYU40 class."""


def kind_errors(layout: NDArray[np.uint8], labels40: NDArray[np.uint8]) -> float:
    """Percent of the pixels of ceiling, floor and wall whose face is of another kind; NaN without any."""
    table = np.zeros(256, np.uint8)
    for number, kind in KIND_OF_CLASS.items():
        table[number] = kind
    true = table[labels40]
    known = true > 0
    return float(100 * np.mean(np.minimum(layout, WALL)[known] != true[known])) if known.any() else float("nan")


def real_samples() -> Iterator[Sample]:
    folder = open_folder(DATA / "nyuv2")
    near = is_near(folder.names, [p.stem for p in (DATA / "nyuv2" / "layout").glob("*.png")])
    names = [name for name, one in zip(folder.names, near, strict=True) if not one]
    yield from good_samples(folder.subset(tuple(names[::EVERY])))


def main(rooms: int = ROOMS, first: int = FIRST) -> int:
    """Print both tables."""
    ways = [LayoutEstimator(EstimatorConfig(refinement=way)) for way in ("depth", "edges")]
    print(f"Planes of {rooms} rendered rooms, medians; ok: within 3 cm and 0.5 deg")
    print(f"{'':<19}{'cm':>10}{'deg':>8}{'ok %':>8}")
    for noise in NOISES:
        planes = [Planes(), Planes()]
        for _, sample in random_views(range(first, first + rooms), STREAM, noise):
            for way, found in zip(ways, planes, strict=True):
                found.add(sample, way.estimate(sample.frame))
        for title, found in zip(("without", "with"), planes, strict=True):
            offset_cm, angle_deg, within = found.columns()
            print(f"{noise:<10}{title:<9}{offset_cm:>10.2f}{angle_deg:>8.2f}{within:>8.0f}", flush=True)
    if not (DATA / "nyuv2" / "splits.json").exists():
        print(f"{DATA / 'nyuv2'} is not here: no real frames")
        return 0
    errors = []
    for sample in real_samples():
        assert sample.truth is not None
        assert sample.truth.labels40 is not None
        errors.append([kind_errors(way.estimate(sample.frame).layout, sample.truth.labels40) for way in ways])
    table = np.array([row for row in errors if np.isfinite(row).all()])
    apart = table[:, 1] - table[:, 0]
    print(f"\nNYU v2, every {EVERY}th frame beyond {MARGIN} numbers of the 37 ({len(table)} frames)")
    print("pixels of ceiling, floor and wall whose face is of another kind:")
    print(f"without {table[:, 0].mean():.2f} %, with {table[:, 1].mean():.2f} %, ", end="")
    print(f"difference {apart.mean():+.3f} ± {apart.std(ddof=1) / np.sqrt(len(apart)):.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
