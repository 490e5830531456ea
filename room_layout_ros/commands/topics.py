"""Which topics of a bag hold the frames: the options of every command that reads one."""

from __future__ import annotations

import argparse
from pathlib import Path

from room_layout_ros.datasets import FrameSource, open_source

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
        "--assume-registered", action="store_true", help="depth is registered to colour though their frame ids differ"
    )


def open_with_topics(path: Path, arguments: argparse.Namespace) -> FrameSource:
    """Open an input with the topic options of the command line."""
    options: dict[str, object] = {n: getattr(arguments, n) for n in _OPTIONS if getattr(arguments, n) is not None}
    if arguments.max_stamp_gap is not None:
        options["max_stamp_gap_ns"] = round(arguments.max_stamp_gap * 1e9)
    if arguments.assume_registered:
        options["assume_registered"] = True
    return open_source(path, **options)
