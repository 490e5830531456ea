"""How a bag is read: the options of every command that reads one."""

from __future__ import annotations

import argparse
from pathlib import Path

from room_layout_ros.datasets import DataError, FrameSource, open_source
from room_layout_ros.datasets.source import is_bag

_OPTIONS = ("color_topic", "depth_topic", "color_info_topic", "depth_info_topic")


def add_topic_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the topic options."""
    group = parser.add_argument_group("topics of a bag (found by name and type if not given)")
    for name in _OPTIONS:
        group.add_argument(f"--{name.replace('_', '-')}", metavar="TOPIC")
    group.add_argument(
        "--max-stamp-gap",
        type=float,
        metavar="SECONDS",
        help="pair colour and depth up to this far apart (default 0.02)",
    )
    group.add_argument(
        "--camera",
        type=Path,
        metavar="FILE",
        help="ROS camera calibration YAML in the place of the bag's camera_info, for a bag without",
    )
    group.add_argument(
        "--assume-registered", action="store_true", help="depth is registered to colour though their frame ids differ"
    )


def add_recover_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option of commands that can do with a part of a bag."""
    parser.add_argument(
        "--recover", action="store_true", help="read on behind damaged parts of a bag and say what is lost"
    )


def open_with_topics(path: Path, arguments: argparse.Namespace, recover: bool = False) -> FrameSource:
    """Open an input with the topic options of the command line; `recover` reads on behind damaged parts of a bag.

    Raises
    ------
    DataError
        See `open_source`; also where `--camera` is given for an input that is no bag.
    """
    options: dict[str, object] = {n: getattr(arguments, n) for n in _OPTIONS if getattr(arguments, n) is not None}
    if arguments.max_stamp_gap is not None:
        options["max_stamp_gap_ns"] = round(arguments.max_stamp_gap * 1e9)
    if arguments.assume_registered:
        options["assume_registered"] = True
    if arguments.camera is not None:
        if path.exists() and not is_bag(path):
            raise DataError(f"--camera is for a bag, and {path} is none; a frames folder or .mat has its own camera")
        options["camera"] = arguments.camera
    if recover:
        options["recover"] = True
    return open_source(path, **options)
