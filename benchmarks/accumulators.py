"""Accumulators of the compatibility energy: naive against the paper's Alg. 2 against ours, in one run.

Each way answers the same question, the one inference asks in every iteration of Alg. 1: given a labelling, what does
each pair of rays cost under all 30 compatibility weights (5 faces x 6 labels)? The answers are checked to be equal
before they are timed.

  naive      every pixel is looked at for every pair of states of its quadrant, O(N |Y|^2), as in [S12]
  Alg. 2     one pass over the pixels per label, the bin carried on from the neighbour, O(N), then sums (paper 3.5)
  ours       counts of (superpixel, cell) once per frame; per iteration one pass over the counts with the weights
             contracted
  inference  ours as the estimator has it: atoms of superpixel and orientation, counted on one pixel in five (the
             default `layout_pixel_step`). Only this one is not exact: by the lattice's share, 0.1 % of the image.

The naive form is compiled too, and does all labels in one pass over the pixels, so the ratios are of algorithms, not
of languages. The paper reports 7 s against 0.32 s: a ratio of 22. A frame asks five times: `FIVE` and `INFERENCE` are
five naive answers over one counting and five of ours, of every pixel and as inference does it. Times are CPU time, the
least of the rounds: all is one-threaded, and a busy machine only adds.

    python -m benchmarks accumulators
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.core.accumulate import accumulate
from room_layout_ros.core.cell_counts import CellCounts, count_cells, count_samples, sample_lattice
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.integral_geometry import PairTables, pair_tables
from room_layout_ros.core.ray_grid import QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid, compute_ray_grid

CAMERA = CameraIntrinsics(640, 480, 519.0, 519.0, 319.5, 239.5)
SIDE, TOP, FRONT = (2, 4, 2, 4), (0, 0, 1, 1), 3
SUPERPIXELS = 200
PATCH_PX = 80
"""Side of the patches of one orientation: about 450 atoms, as real frames have."""
ITERATIONS = EstimatorConfig().joint_alternations
STEP = EstimatorConfig().layout_pixel_step
LATTICE_ERROR = 0.001
FIVE = "naive / ours, every pixel, five iterations with counts"
INFERENCE = "naive / ours as inference does it"
_QUICK_S, _REPEATS = 0.05, 20


@dataclass(frozen=True, slots=True)
class Scene:
    """What inference has in hand.

    `index` is the superpixel of each pixel, `atoms` superpixel x 6 + orientation; `labels` are of the superpixels,
    `weights` (5, 6) those of the compatibility.
    """

    grid: RayGrid
    index: NDArray[np.int32]
    atoms: NDArray[np.int32]
    labels: NDArray[np.int64]
    weights: NDArray[np.float64]


def make_scene(rng: np.random.Generator) -> Scene:
    """200 superpixels of random labels, orientations in patches, before a turned and nodding camera."""
    yaw, pitch = np.deg2rad(20.0), np.deg2rad(8.0)
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    nod = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    centres = rng.uniform(0, 1, (SUPERPIXELS, 2)) * (640, 480)
    y, x = np.mgrid[:480, :640]
    nearest = np.full((480, 640), np.inf)
    index = np.zeros((480, 640), np.int32)
    for k, (cx, cy) in enumerate(centres):
        distance = (x - cx) ** 2 + (y - cy) ** 2
        index[distance < nearest] = k
        nearest = np.minimum(nearest, distance)
    patches = rng.integers(0, 6, (480 // PATCH_PX, 640 // PATCH_PX))
    orientation = patches.repeat(PATCH_PX, axis=0).repeat(PATCH_PX, axis=1)
    atoms = (index * 6 + orientation).astype(np.int32)
    grid = compute_ray_grid(CAMERA, turn @ nod, 50)
    return Scene(grid, index, atoms, rng.integers(0, 6, SUPERPIXELS), rng.normal(size=(5, 6)))


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
    """One pass over the counts; labels are of the atoms."""
    return pair_tables(counts, np.ascontiguousarray(weights.T[labels]))


def inference_counts(scene: Scene) -> tuple[CellCounts, NDArray[np.int64]]:
    """Counts of the atoms that have a pixel, as `build_joint_problem` makes them, and their superpixels."""
    samples, held = sample_lattice(scene.atoms, STEP), np.zeros(6 * SUPERPIXELS, bool)
    held[samples[samples >= 0]] = True
    return count_samples(scene.grid, samples, held, STEP), np.flatnonzero(held) // 6


def least_times(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """CPU seconds per call, the ways interleaved; quick ones are repeated within a round."""
    least = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            for _ in range(_REPEATS):
                start = time.thread_time()
                call()
                least[name] = min(least[name], time.thread_time() - start)
                if least[name] > _QUICK_S:
                    break
    return least


def run(rounds: int) -> dict[str, float]:
    """Measure, print and return the figures.

    Raises
    ------
    AssertionError
        When the ways do not agree, inference's within the error of its lattice.
    """
    scene = make_scene(np.random.default_rng(7))
    grid, labels, weights = scene.grid, scene.labels, scene.weights
    of_pixels = labels[scene.index]
    counts = count_cells(grid, scene.index, SUPERPIXELS)
    fifth, superpixel = inference_counts(scene)
    of_atoms = labels[superpixel]
    reference = naive_tables(grid, of_pixels, weights)
    for other in (alg2_tables(grid, of_pixels, weights), our_tables(counts, labels, weights)):
        for a, b in zip(reference, other, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)
    for a, b in zip(reference, our_tables(fifth, of_atoms, weights), strict=True):
        np.testing.assert_allclose(a, STEP * b, rtol=0, atol=LATTICE_ERROR * of_pixels.size * np.abs(weights).max())
    least = least_times(
        {
            "naive": lambda: naive_tables(grid, of_pixels, weights),
            "Alg. 2": lambda: alg2_tables(grid, of_pixels, weights),
            "ours, per iteration": lambda: our_tables(counts, labels, weights),
            "counts, once per frame": lambda: count_cells(grid, scene.index, SUPERPIXELS),
            "inference, per iteration": lambda: our_tables(fifth, labels[superpixel], weights),
            "inference's counts, once per frame": lambda: inference_counts(scene),
        },
        rounds,
    )
    print(
        f"640x480, {SUPERPIXELS} superpixels, {len(superpixel)} atoms, {int(grid.state_counts.sum())} states on four "
        f"sides; CPU time, least of {rounds} interleaved rounds"
    )
    for name, seconds in least.items():
        print(f"  {name:36s} {1e3 * seconds:10.3f} ms   naive / this {least['naive'] / seconds:8.1f}")
    figures = {f"{name} ms": 1e3 * seconds for name, seconds in least.items()}
    figures["naive / Alg. 2"] = least["naive"] / least["Alg. 2"]
    figures["naive / ours"] = least["naive"] / least["ours, per iteration"]
    asked = ITERATIONS * least["naive"]
    figures[FIVE] = asked / (ITERATIONS * least["ours, per iteration"] + least["counts, once per frame"])
    inference = ITERATIONS * least["inference, per iteration"] + least["inference's counts, once per frame"]
    figures[INFERENCE] = asked / inference
    for name in ("naive / Alg. 2", "naive / ours", FIVE, INFERENCE):
        print(f"  {name}: {figures[name]:.0f}   (the paper's ratio is 22)")
    return figures


def main() -> int:
    """Run as one of the benchmarks."""
    run(rounds=3)
    return 0


if __name__ == "__main__":
    sys.exit(main())
