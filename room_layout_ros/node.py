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

_USAGE = """usage: {program} [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] [--params-file FILE] ...]

Layout and clutter of a room from colour and depth, as a ROS 2 node; Ctrl-C ends it.

  --ros-args -p NAME:=VALUE       a parameter; docs/parameters.md has all
  --ros-args -r FROM:=TO          another topic name: -r rgb/image_rect_color:=/camera/color/image_raw
  --ros-args -r __ns:=/NAME       a namespace; __node:=NAME another name of the node
  --ros-args --params-file FILE   parameters of a file, such as config/estimator.yaml

Exit code: 0 at the end, 2 where the settings are wrong."""


def main(args: Sequence[str] | None = None) -> int:
    """Run the plain node until SIGINT or SIGTERM; 0 at the end, 2 when the settings are wrong."""
    return _main("estimator", "EstimatorNode", args)


def lifecycle_main(args: Sequence[str] | None = None) -> int:
    """Run the lifecycle node until SIGINT or SIGTERM; its exit codes are those of `main`."""
    return _main("lifecycle_estimator", "EstimatorLifecycleNode", args)


def _main(program: str, node: str, args: Sequence[str] | None) -> int:
    _leave_on_signals()
    given = sys.argv[1:] if args is None else args
    from . import ros_arguments

    if any(word in ("-h", "--help") for word in ros_arguments.words_of_ours(given)):
        print(_USAGE.format(program=program))
        return 0
    fault = ros_arguments.fault(program, given)
    if fault:
        print(f"{program}: {fault}", file=sys.stderr)
        return 2
    from . import estimator_node

    return estimator_node.run(getattr(estimator_node, node), args)


def _leave_on_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End without a word: nothing is open yet. (An exception could get lost in the import of an extension module.)"""
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
