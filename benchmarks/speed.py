"""Milliseconds per stage, frames per second, first result, memory; every frame alone, without warm starts.

Run it on a quiet machine: the load average is printed, because numbers under load are of the load. On frames of your
own: `room-layout bench INPUT`.
"""

from __future__ import annotations

import subprocess
import sys

import cv2
import psutil

from benchmarks._frames import load_frames
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.evaluation.speed import describe_machine, describe_speed, measure_speed

FRAMES = 40

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
    print(describe_machine())
    print(f"first result from a warm cache, import included: {_first_result():.2f} s")
    estimator = LayoutEstimator()
    for title, frames in load_frames(FRAMES).items():
        camera, superpixels = frames[0].camera, estimator.config.superpixel_count
        print(f"\n{title}: {len(frames)} frames of {camera.width}x{camera.height}, {superpixels} superpixels")
        print(describe_speed(measure_speed(frames, estimator)))
    memory = psutil.Process().memory_info().rss / 2**20
    print(f"\nresident after all of it: {memory:.0f} MiB, the frames and results of this run included")
    return 0


def _first_result() -> float:
    taken = []
    for _ in range(2):  # the first may fill the cache
        done = subprocess.run([sys.executable, "-c", _FIRST_RESULT], capture_output=True, text=True, check=True)
        taken.append(float(done.stdout))
    return min(taken)


if __name__ == "__main__":
    sys.exit(main())
