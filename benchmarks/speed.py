"""Milliseconds per stage, frames per second, first result, memory; every frame alone, without warm starts.

Run it on a quiet machine: the load average is printed, because numbers under load are of the load.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import psutil

from benchmarks._frames import load_frames
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.tracking import TemporalPrior, next_prior

FRAMES = 40
IN_FLIGHT = 2

_FIRST_RESULT = """
import time; start = time.perf_counter()
import numpy as np, sys
from room_layout_ros.core import CameraIntrinsics, LayoutEstimator, RgbdFrame
depth = np.full((480, 640), 3.0, np.float32); color = np.full((480, 640, 3), 128, np.uint8)
LayoutEstimator().estimate(RgbdFrame(CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5), color, depth))
print(time.perf_counter() - start)
"""


def main() -> int:
    cv2.setNumThreads(1)
    cores, load = os.cpu_count(), os.getloadavg()[0]
    print(f"{platform.machine()}, {cores} cores, load {load:.1f}, Python {platform.python_version()}")
    print(f"first result from a warm cache, import included: {_first_result():.2f} s")
    for title, frames in load_frames(FRAMES).items():
        height, width = frames[0].camera.height, frames[0].camera.width
        superpixels = LayoutEstimator().config.superpixel_count
        print(f"\n{title}: {len(frames)} frames of {width}x{height}, {superpixels} superpixels")
        _stages(frames)
        _throughput(frames)
    memory = psutil.Process().memory_info().rss / 2**20
    print(f"\nresident after all of it: {memory:.0f} MiB, the frames and results of this run included")
    return 0


def _stages(frames: list[RgbdFrame]) -> None:
    estimator = LayoutEstimator()
    for frame in frames[:2]:
        estimator.estimate(frame)
    stages: dict[str, list[float]] = {}
    whole: list[float] = []
    processor: list[float] = []
    for frame in frames:
        start, start_cpu = time.perf_counter(), time.thread_time()
        estimate = estimator.estimate(frame)
        whole.append(1e3 * (time.perf_counter() - start))
        processor.append(1e3 * (time.thread_time() - start_cpu))
        for stage, milliseconds in estimate.timings_ms.items():
            stages.setdefault(stage, []).append(milliseconds)
    print(f"{'stage, ms':<22}{'min':>8}{'p50':>8}{'p95':>8}{'max':>8}")
    for stage, taken in [*stages.items(), ("whole frame", whole), ("whole frame, CPU time", processor)]:
        low, half, high, most = np.percentile(taken, [0, 50, 95, 100])
        print(f"{stage:<22}{low:>8.2f}{half:>8.2f}{high:>8.2f}{most:>8.2f}")


def _throughput(frames: list[RgbdFrame]) -> None:
    estimator = LayoutEstimator()
    alone = _frames_per_second(frames, lambda: [estimator.estimate(frame) for frame in frames])
    with ThreadPoolExecutor(IN_FLIGHT) as pool:
        together = _frames_per_second(frames, lambda: list(pool.map(estimator.estimate, frames)))
    warm = _frames_per_second(frames, lambda: _in_sequence(estimator, frames))
    print(f"frames/s: {alone:.1f} alone, {together:.1f} with {IN_FLIGHT} in flight, {warm:.1f} with warm starts")


def _in_sequence(estimator: LayoutEstimator, frames: list[RgbdFrame]) -> list[object]:
    prior, estimates = TemporalPrior(), []
    for frame in frames:
        estimate = estimator.estimate(frame, prior)
        prior = next_prior(estimate)
        estimates.append(estimate)
    return list(estimates)


def _frames_per_second(frames: list[RgbdFrame], work: object) -> float:
    assert callable(work)
    start = time.perf_counter()
    work()
    return len(frames) / (time.perf_counter() - start)


def _first_result() -> float:
    taken = []
    for _ in range(2):  # the first may fill the cache
        done = subprocess.run([sys.executable, "-c", _FIRST_RESULT], capture_output=True, text=True, check=True)
        taken.append(float(done.stdout))
    return min(taken)


if __name__ == "__main__":
    sys.exit(main())
