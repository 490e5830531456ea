"""Walls that the sensor does not reach: depth cut off before the end wall, whose distance the uncut frame tells.

Of the real corridor the frames in which the end wall is measured; of drawn rooms a view from one end to the other.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks._frames import DATA
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import FRONT_FACE
from room_layout_ros.datasets import open_folder
from room_layout_ros.datasets.synthetic import KINECT, NOISES, camera_pose, random_scene, render

SHARES = (1.0, 0.8, 0.6, 0.45)
"""The depth ends at these shares of the end wall's distance."""

RIGHT = 0.1
CORRIDOR = (*range(35, 76, 5), *range(135, 171, 5))
"""Frames that look along the corridor, at 4.6 to 9 m from its end; every fifth."""

ROOMS = 12
STREAM = 77


def view_along(seed: int) -> tuple[RgbdFrame, float]:
    """Return a frame taken at one end of a drawn room, and the distance of the other end, m."""
    rng = np.random.default_rng([seed, STREAM])
    room = random_scene(rng, "cuboid", furniture=0.2)
    low, high = room.corners.min(axis=0), room.corners.max(axis=0)
    x, y = 0.5 * (low + high)
    if high[0] - low[0] > high[1] - low[1]:
        pose = camera_pose(float(low[0]) + 0.4, float(y), 1.3, 0.0, -0.12)
    else:
        pose = camera_pose(float(x), float(low[1]) + 0.4, 1.3, np.pi / 2, -0.12)
    sample = render(room, KINECT, pose, NOISES["kinect"], rng)
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    return sample.frame, float(sample.truth.cuboid.distances[FRONT_FACE])


def corridor(estimator: LayoutEstimator) -> Iterator[tuple[RgbdFrame, float]]:
    """Yield frames of the real corridor and where the estimator puts the end wall with all of its depth, m."""
    folder = open_folder(DATA / "corridor")
    for number in CORRIDOR:
        frame = folder.read(f"{number:04d}").frame
        room = estimator.estimate(frame).cuboid
        assert room is not None
        yield frame, float(room.distances[FRONT_FACE])


def cut_off(frame: RgbdFrame, farthest_m: float) -> RgbdFrame:
    """Return the frame as a sensor that reaches so far measures it."""
    assert frame.depth_m is not None
    return replace(frame, depth_m=np.where(frame.depth_m > farthest_m, np.float32(np.nan), frame.depth_m))


def report(title: str, views: list[tuple[RgbdFrame, float]], estimator: LayoutEstimator) -> None:
    """Print, by share, how many end walls are where they are, and what is said of those that are and are not."""
    for share in SHARES:
        off, confidence = [], []
        for frame, true_m in views:
            estimate = estimator.estimate(cut_off(frame, share * true_m) if share < 1.0 else frame)
            found_m = float("inf") if estimate.cuboid is None else float(estimate.cuboid.distances[FRONT_FACE])
            off.append(found_m / true_m)
            confidence.append(float(estimate.face_confidence[FRONT_FACE]))
        ratio, sure = np.array(off), np.array(confidence)
        right = np.abs(ratio - 1.0) <= RIGHT
        told = [f"{sure[which].mean():.2f}" if which.any() else "-" for which in (right, ~right)]
        print(
            f"{title:<34}{share:>6.2f}{len(views):>8}{int(right.sum()):>14}{np.median(ratio):>10.2f}"
            f"{told[0]:>13}{told[1]:>8}",
            flush=True,
        )


def main() -> int:
    """Print the table, the simple depth estimator below ours."""
    ours, simple = LayoutEstimator(), LayoutEstimator(EstimatorConfig(method="depth"))
    sets = {"drawn rooms": [view_along(seed) for seed in range(ROOMS)]}
    if (DATA / "corridor" / "camera.yaml").exists():
        sets = {"real corridor": list(corridor(ours)), **sets}
    print(f"{'':<34}{'share':>6}{'frames':>8}{'within 10 %':>14}{'median':>10}{'confidence':>13}{'wrong':>8}")
    for title, views in sets.items():
        report(title, views, ours)
        report(f"{title}, simple depth estimator", views, simple)
    return 0


if __name__ == "__main__":
    sys.exit(main())
