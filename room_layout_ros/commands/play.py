"""Publish a rosbag2, a frames folder or an NYU .mat file on ROS 2 topics.

A bag is published as it is, every topic, without decoding. Other frames go to the topics the node listens to:
/rgb/image_rect_color, /rgb/camera_info and /depth_registered/image_rect.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.datasets import DataError, open_source
from room_layout_ros.datasets.bag import open_reader
from room_layout_ros.datasets.source import is_bag
from room_layout_ros.playback import PlayOptions, bag_stream, frame_stream, parse_remappings, play


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `play`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="rosbag2, frames folder or NYU .mat")
    parser.add_argument("--rate", type=float, default=1.0, metavar="X", help="times real time (default 1)")
    parser.add_argument("--loop", action="store_true", help="start again at the end, until interrupted")
    parser.add_argument("--loops", type=int, default=1, metavar="N", help="play N times (default 1)")
    parser.add_argument("--clock", action="store_true", help="publish /clock (for use_sim_time)")
    parser.add_argument(
        "--wait-for-subscribers",
        type=int,
        default=0,
        metavar="N",
        help="start when each topic has N subscribers (default 0)",
    )
    parser.add_argument("--wait-timeout", type=float, default=60.0, metavar="SECONDS", help="longest wait (default 60)")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these topics of a bag")
    parser.add_argument("--remap", action="append", default=[], metavar="FROM:=TO", help="rename a topic (repeatable)")


def run(arguments: argparse.Namespace) -> int:
    """Play the input."""
    options = PlayOptions(
        arguments.rate,
        0 if arguments.loop else arguments.loops,
        arguments.clock,
        arguments.wait_for_subscribers,
        arguments.wait_timeout,
        parse_remappings(arguments.remap),
    )
    if not arguments.input.exists():
        raise DataError(f"{arguments.input} does not exist; give a rosbag2, a frames folder or an NYU .mat file")
    total: int | None
    if is_bag(arguments.input):
        only = set(arguments.topics) if arguments.topics else None
        read, total = bag_stream(arguments.input, only), _message_count(arguments.input, only)
    else:
        source = open_source(arguments.input)
        read, total = frame_stream(source), None if source.length is None else 3 * source.length
    loops = options.loops
    with progress_bar("play", total * loops if total and loops else None, "message") as progress:
        result = play(read, options, progress)
    told = ", ".join(f"{topic} {count}" for topic, count in sorted(result.counts.items()))
    print(f"{'stopped after' if result.interrupted else 'played'}: {told or 'nothing'}", file=sys.stderr)
    return 0


def _message_count(path: Path, only: set[str] | None) -> int:
    with open_reader(path) as reader:
        return sum(c.msgcount for c in reader.connections if only is None or c.topic in only)
