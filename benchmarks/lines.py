"""Line segments at half resolution: our detector beside OpenCV's LSD, milliseconds and agreement."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._frames import load_frames
from room_layout_ros.core.line_detection import detect_segments

FRAMES, RUNS = 40, 5
SHORTEST_PX, SAME_PX = 8.0, 0.5


def main() -> int:
    cv2.setNumThreads(1)
    for title, frames in load_frames(FRAMES).items():
        ratios, found, missed = [], [], []
        for color in (frame.color for frame in frames if frame.color is not None):
            full = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
            gray = np.asarray(cv2.resize(full, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
            theirs_ms, theirs = _timed(_opencv, gray)
            ours_ms, ours = _timed(detect_segments, gray)
            ratios.append((theirs_ms, ours_ms))
            found.append((len(theirs), len(ours)))
            missed += (np.abs(theirs[:, None] - ours[None]).max(axis=2).min(axis=1) > SAME_PX).tolist()
        opencv_ms, own_ms = np.median(ratios, axis=0)
        faster = np.median([a / b for a, b in ratios])
        print(f"{title}: OpenCV {opencv_ms:.2f} ms, ours {own_ms:.2f} ms, {faster:.1f} times as fast")
        opencv_n, own_n = np.sum(found, axis=0)
        apart = np.mean(missed)
        print(f"  segments from {SHORTEST_PX:g} px on: {opencv_n}, {own_n}; {apart:.1%} more than {SAME_PX} px apart")
    return 0


def _opencv(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE, 1.0).detect(gray)[0]
    return np.empty((0, 4), np.float32) if found is None else np.asarray(found.reshape(-1, 4), np.float32)


def _timed(
    detect: Callable[[NDArray[np.uint8]], NDArray[np.float32]], gray: NDArray[np.uint8]
) -> tuple[float, NDArray[np.float32]]:
    """Return the least time of some runs, ms, and the segments that are long enough."""
    taken = []
    for _ in range(RUNS):
        start = time.perf_counter()
        found = detect(gray)
        taken.append(1e3 * (time.perf_counter() - start))
    return min(taken), found[np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1]) >= SHORTEST_PX]


if __name__ == "__main__":
    sys.exit(main())
