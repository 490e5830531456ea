"""Free space against the truth of synthetic rooms: IoU, cells too near to things, small things found, planes, time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from benchmarks._free_space import (
    MOUNTS,
    FreeSpaceScore,
    found_things,
    random_views,
    scene_with_small_things,
    score_free_space,
    true_free_space,
    views_of_walk,
)
from benchmarks._planes import Planes
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.freespace import FreeSpace, free_space_of_frame
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import KINDS, KINECT, NOISES, SyntheticRoom, render

ROOMS = 16
SCENES = 8
WALKS = 4
SEED = 11
SIZES_M = (0.03, 0.05)


@dataclass
class Row:
    scores: list[FreeSpaceScore] = field(default_factory=list)
    planes: Planes = field(default_factory=Planes)
    milliseconds: list[float] = field(default_factory=list)

    def line(self, title: str) -> str:
        s = self.scores
        iou = [v.iou for v in s if np.isfinite(v.iou)]
        near, unseen = sum(v.too_near for v in s), sum(v.too_near_unseen for v in s)
        false = 100.0 * sum(v.false_free for v in s) / max(sum(v.free for v in s), 1)
        offset_cm, angle_deg, within = self.planes.columns()
        return (
            f"{title:<18}{pooled(s, 'pool'):>7.3f}{pooled(s, 'pool_measured'):>10.3f}{np.mean(iou):>7.3f}"
            f"{np.min(iou):>7.3f}{pooled(s, 'pool_plain'):>8.3f}{near:>9}{unseen:>8}{false:>12.2f}"
            f"{offset_cm:>10.2f}{angle_deg:>8.2f}{within:>8.0f}{np.median(self.milliseconds):>7.1f}"
        )


HEAD = (
    f"{'':<18}{'IoU':>7}{'measured':>10}{'mean':>7}{'worst':>7}{'plain':>8}{'too near':>9}{'unseen':>8}"
    f"{'not free %':>12}{'plane cm':>10}{'deg':>8}{'ok %':>8}{'ms':>7}"
)

LEGEND = """IoU: pooled over the row; measured: cells without depth left out; mean, worst: of single frames; plain:
without the margin of 10 cm in the truth; too near: free cells within 10 cm before a thing of 5 cm or more at 1-3 m
of which something is in the picture; unseen: the same, nothing of it is in the picture;
middle, low: rooms from a camera at 0.5-0.9 m, and from a wide one at 0.25-0.45 m;
steep: 20-40 degrees down, Kinect, with free_seen_height_m of 0 and 0.8 m;
not free %: cells called free where something stands (often what hangs over them, out of the image); plane cm, deg:
median error of the estimator's planes; ok %: planes within 3 cm and 0.5 deg"""


def pooled(scores: list[FreeSpaceScore], which: str) -> float:
    """Return the sum of intersections over the sum of unions, as PASCAL."""
    both, either = np.sum([getattr(s, which) for s in scores], axis=0)
    return float(both / either) if either else float("nan")


def run(config: EstimatorConfig, frame: RgbdFrame, estimate: RoomEstimate) -> tuple[FreeSpace | None, float]:
    start = time.perf_counter()
    free_space = free_space_of_frame(frame, estimate, config)
    return free_space, 1e3 * (time.perf_counter() - start)


def score(estimator: LayoutEstimator, views: Iterable[tuple[SyntheticRoom, Sample]]) -> Row:
    """Score every view by itself."""
    row, config = Row(), estimator.config
    for room, sample in views:
        estimate = estimator.estimate(sample.frame)
        free_space, ms = run(config, sample.frame, estimate)
        truth = true_free_space(
            room, sample, config.free_space_resolution_m, config.free_space_forward_m, config.free_space_side_m
        )
        row.scores.append(score_free_space(truth, free_space))
        row.milliseconds.append(ms)
        row.planes.add(sample, estimate)
    return row


def walks(seeds: Iterable[int], noise: str, frames: int = 8) -> Iterator[tuple[SyntheticRoom, Sample]]:
    """Yield the frames of several walks, one a second."""
    for seed in seeds:
        yield from views_of_walk(seed, noise, frames)


def small_things(
    estimator: LayoutEstimator, noise: str, size_m: float, seeds: Iterable[int], camera: CameraIntrinsics = KINECT
) -> tuple[int, int]:
    """Return how many cubes of a size were found, and how many there were."""
    found = total = 0
    for seed in seeds:
        rng = np.random.default_rng([seed, SEED])
        room, pose, places = scene_with_small_things(rng, size_m)
        frame = render(room, camera, pose, NOISES[noise], rng).frame
        free_space, _ = run(estimator.config, frame, estimator.estimate(frame))
        found += found_things(free_space, places)
        total += len(places)
    return found, total


def main(rooms: int = ROOMS, scenes: int = SCENES, first: int = 0) -> int:
    """Print the tables; `first` is the first seed, another one gives other rooms."""
    estimator = LayoutEstimator()
    print(f"{rooms} furnished rooms a row with 12 things of 3-10 cm on the floor, {WALKS} walks of 8 frames,")
    print("cells of 5 cm, up to 4 m.")
    print(LEGEND)
    print(HEAD)
    for noise in NOISES:
        views = random_views(range(first, first + rooms), SEED, noise)
        print(score(estimator, views).line(f"rooms, {noise}"), flush=True)
    for noise in NOISES:
        views = walks(range(SEED + first, SEED + first + WALKS), noise)
        print(score(estimator, views).line(f"walks, {noise}"), flush=True)
    for name in ("middle", "low"):
        for noise in NOISES:
            views = random_views(range(first, first + rooms), SEED, noise, mount=MOUNTS[name])
            print(score(estimator, views).line(f"{name}, {noise}"), flush=True)
    for height_m in (0.0, 0.8):
        asked = LayoutEstimator(EstimatorConfig(free_seen_height_m=height_m))
        views = random_views(range(first, first + rooms), SEED, "kinect", mount=MOUNTS["steep"])
        print(score(asked, views).line(f"steep, {height_m} m"), flush=True)
    for kind in KINDS[1:]:
        views = random_views(range(first, first + max(rooms // 2, 1)), SEED, "kinect", kind)
        print(score(estimator, views).line(f"{kind}, kinect"), flush=True)
    print(f"\nCubes on the floor at 1.5 m, camera at 0.4-1.4 m: found of {5 * scenes}")
    print(f"{'':<18}" + "".join(f"{100 * size:>7.0f} cm" for size in SIZES_M))
    for noise in NOISES:
        found = [small_things(estimator, noise, size, range(first, first + scenes))[0] for size in SIZES_M]
        print(f"{noise:<18}" + "".join(f"{n:>10}" for n in found), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
