"""The processes `estimator` and `lifecycle_estimator`.

Imports nothing heavy at first: a signal has to end the process with exit code 0 from the first moment on, also in the
second or two that NumPy, Numba and rclpy take to load.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
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
    words = _words_of_ours(given)
    if any(word in ("-h", "--help") for word in words):
        print(_USAGE.format(program=program))
        return 0
    if words:
        print(f"{program}: {_refusal(program, words[0])}", file=sys.stderr)
        return 2
    missing = [file for option, file in pairwise(given) if option == "--params-file" and not Path(file).is_file()]
    if missing:
        print(f"{program}: --params-file {missing[0]}: there is no such file", file=sys.stderr)
        return 2
    from . import estimator_node

    return estimator_node.run(getattr(estimator_node, node), args)


def _words_of_ours(args: Sequence[str]) -> list[str]:
    """Return the words that are none of ROS: outside of `--ros-args ... --`."""
    words, of_ros = [], False
    for word in args:
        if of_ros or word == "--ros-args":
            of_ros = word != "--"
        else:
            words.append(word)
    return words


def _refusal(program: str, word: str) -> str:
    if ":=" not in word:
        return f"{word[:80]!r} is no argument; all are ROS's, behind --ros-args (see {program} --help)"
    kind = "-r" if word.startswith("__") or "/" in word.partition(":=")[0] else "-p"
    return f"{word[:80]!r} has to stand behind --ros-args: {program} --ros-args {kind} {word[:80]}"


def _leave_on_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End without a word: nothing is open yet. (An exception could get lost in the import of an extension module.)"""
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
