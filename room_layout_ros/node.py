"""The processes `estimator` and `lifecycle_estimator`.

Imports nothing heavy at first: a signal has to end the process with exit code 0 from the first moment on, also in the
second or two that NumPy, Numba and rclpy take to load.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType


def main(args: Sequence[str] | None = None) -> int:
    """Run the plain node until SIGINT or SIGTERM; 0 at the end, 2 when the settings are wrong."""
    _leave_on_signals()
    from .estimator_node import EstimatorNode, run

    return run(EstimatorNode, args)


def lifecycle_main(args: Sequence[str] | None = None) -> int:
    """Run the lifecycle node until SIGINT or SIGTERM."""
    _leave_on_signals()
    from .estimator_node import EstimatorLifecycleNode, run

    return run(EstimatorLifecycleNode, args)


def _leave_on_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End without a word: nothing is open yet. (An exception could get lost in the import of an extension module.)"""
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
