"""Accumulators of the compatibility energy: naive against the paper's Alg. 2 against ours, in one run.

Each way answers the same question, the one inference asks in every iteration of Alg. 1: given a labelling, what does
each pair of rays cost under all 30 compatibility weights (5 faces x 6 labels)? The answers are checked to be equal
before they are timed.

  naive     every pixel is looked at for every pair of states of its quadrant, O(N |Y|^2), as in [S12]
  Alg. 2    one pass over the pixels per label, the bin carried on from the neighbour, O(N), then sums (paper 3.5)
  ours      counts of (superpixel, cell) once per frame; per iteration one pass over the counts with the weights
  contracted

The naive form is compiled too, and does all labels in one pass over the pixels, so the ratios are of algorithms, not
of languages. The paper reports 7 s against 0.32 s: a ratio of 22.

    python -m benchmarks accumulators
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.core.accumulate import accumulate
from room_layout_ros.core.cell_counts import CellCounts, count_cells
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.integral_geometry import PairTables, pair_tables
from room_layout_ros.core.ray_grid import QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid, compute_ray_grid

CAMERA = CameraIntrinsics(640, 480, 519.0, 519.0, 319.5, 239.5)
SIDE, TOP, FRONT = (2, 4, 2, 4), (0, 0, 1, 1), 3


def make_scene(rng: np.random.Generator) -> tuple[RayGrid, NDArray[np.int32], NDArray[np.int64], NDArray[np.float64]]:
    """A ray grid, 200 superpixels, their labels, and compatibility weights (5, 6)."""
    yaw, pitch = np.deg2rad(20.0), np.deg2rad(8.0)
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    nod = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    centres = rng.uniform(0, 1, (200, 2)) * (640, 480)
    y, x = np.mgrid[:480, :640]
    nearest = np.full((480, 640), np.inf)
    index = np.zeros((480, 640), np.int32)
    for k, (cx, cy) in enumerate(centres):
        distance = (x - cx) ** 2 + (y - cy) ** 2
        index[distance < nearest] = k
        nearest = np.minimum(nearest, distance)
    return compute_ray_grid(CAMERA, turn @ nod, 50), index, rng.integers(0, 6, 200), rng.normal(size=(5, 6))


def naive_tables(grid: RayGrid, labels: NDArray[np.int64], weights: NDArray[np.float64]) -> PairTables:
    """For every pair of states, look at every pixel."""
    tables = []
    for q in range(4):
        vertical, horizontal = grid.side_states(QUADRANT_VERTICAL[q]), grid.side_states(QUADRANT_HORIZONTAL[q])
        counted = _naive(
            grid.ray_matrix, labels, q, vertical, horizontal, grid.slopes[q], int(grid.bin_counts[q]),
            grid.corner_bin[q], grid.corner_share[q],
        )  # fmt: skip
        of_faces = weights[[FRONT, SIDE[q], TOP[q]]]
        tables.append(np.einsum("fl,flij->ij", of_faces, counted))
    return tables[0], tables[1], tables[2], tables[3]


@njit(cache=True, nogil=True)
def _naive(m, labels, quadrant, vertical, horizontal, slopes, bins, corner_bin, corner_share):  # type: ignore[no-untyped-def]
    counted = np.zeros((3, 6, len(vertical), len(horizontal)))
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            dx = m[0, 0] * x + (m[0, 1] * y + m[0, 2])
            dy = m[1, 0] * x + (m[1, 1] * y + m[1, 2])
            dz = m[2, 0] * x + (m[2, 1] * y + m[2, 2])
            if 2 * int(dy >= 0) + int(dx >= 0) != quadrant:
                continue
            label = labels[y, x]
            t = 0
            while t < bins - 1 and abs(dx) >= slopes[t + 1] * abs(dy):
                t += 1
            for i in range(len(vertical)):
                low = i < len(vertical) - 1 and abs(dy) > vertical[i] * dz
                for j in range(len(horizontal)):
                    wide = j < len(horizontal) - 1 and abs(dx) > horizontal[j] * dz
                    if not low and not wide:
                        counted[0, label, i, j] += 1.0
                        continue
                    share = 0.0
                    if wide and t >= corner_bin[i, j]:
                        share = corner_share[i, j] if t == corner_bin[i, j] else 1.0
                    counted[1, label, i, j] += share
                    counted[2, label, i, j] += 1.0 - share
    return counted


def alg2_tables(grid: RayGrid, labels: NDArray[np.int64], weights: NDArray[np.float64]) -> PairTables:
    """One pass over the pixels per label (paper, Alg. 2)."""
    tables = [
        np.zeros((len(grid.side_states(v)), len(grid.side_states(h))))
        for v, h in zip(QUADRANT_VERTICAL, QUADRANT_HORIZONTAL, strict=True)
    ]
    for label in range(6):
        front, side, top = accumulate(grid, (labels == label).astype(np.float64))
        for q in range(4):
            tables[q] += (
                weights[FRONT, label] * front[q] + weights[SIDE[q], label] * side[q] + weights[TOP[q], label] * top[q]
            )
    return tables[0], tables[1], tables[2], tables[3]


def our_tables(counts: CellCounts, labels: NDArray[np.int64], weights: NDArray[np.float64]) -> PairTables:
    """One pass over the counts; labels are of the superpixels."""
    return pair_tables(counts, np.ascontiguousarray(weights.T[labels]))


def paired_times(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Seconds per call, the ways interleaved; quick ones are repeated within a round."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            once = time.perf_counter() - start
            repeats = max(1, min(50, int(0.02 / max(once, 1e-6))))
            start = time.perf_counter()
            for _ in range(repeats):
                call()
            times[name].append((time.perf_counter() - start) / repeats if repeats > 1 else once)
    return times


def run(rounds: int) -> dict[str, float]:
    """Measure, print and return the figures.

    Raises
    ------
    AssertionError
        When the three ways do not agree.
    """
    grid, index, labels, weights = make_scene(np.random.default_rng(7))
    of_pixels = labels[index]
    counts = count_cells(grid, index, 200)
    reference = naive_tables(grid, of_pixels, weights)
    for other in (alg2_tables(grid, of_pixels, weights), our_tables(counts, labels, weights)):
        for a, b in zip(reference, other, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)
    times = paired_times(
        {
            "naive": lambda: naive_tables(grid, of_pixels, weights),
            "Alg. 2": lambda: alg2_tables(grid, of_pixels, weights),
            "ours, per iteration": lambda: our_tables(counts, labels, weights),
            "counts, once per frame": lambda: count_cells(grid, index, 200),
            "counts of one pixel in five": lambda: count_cells(grid, index, 200, 5),
        },
        rounds,
    )
    median = {name: statistics.median(values) for name, values in times.items()}
    print(
        f"640x480, 200 superpixels, {int(grid.state_counts.sum())} states on four sides; "
        f"median of {rounds} interleaved rounds"
    )
    for name, seconds in median.items():
        ratio = statistics.median(a / b for a, b in zip(times["naive"], times[name], strict=True))
        print(f"  {name:30s} {1e3 * seconds:10.3f} ms   naive / this {ratio:8.1f}")
    figures = {f"{name} ms": 1e3 * seconds for name, seconds in median.items()}
    figures["naive / Alg. 2"] = median["naive"] / median["Alg. 2"]
    figures["naive / ours"] = median["naive"] / median["ours, per iteration"]
    five = 5 * median["ours, per iteration"] + median["counts, once per frame"]
    figures["naive / ours, five iterations with counts"] = 5 * median["naive"] / five
    for name in ("naive / Alg. 2", "naive / ours", "naive / ours, five iterations with counts"):
        print(f"  {name}: {figures[name]:.0f}   (the paper's ratio is 22)")
    return figures


def main() -> int:
    """Run as one of the benchmarks."""
    run(rounds=3)
    return 0


if __name__ == "__main__":
    sys.exit(main())
