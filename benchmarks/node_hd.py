"""The node over DDS with an HD camera, 1280x720 at 30 Hz; beside it 640x480, both rendered."""

from __future__ import annotations

import importlib.util
import sys

from benchmarks.node import SECONDS, measure, show


def main(seconds: float = SECONDS) -> int:
    if importlib.util.find_spec("rclpy") is None:
        print("rclpy is not installed (extra: ros): nothing to measure")
        return 0
    faults = [show(measure(seconds, None, hd), seconds, "1280x720" if hd else "640x480") for hd in (True, False)]
    return max(faults)


if __name__ == "__main__":
    sys.exit(main())
