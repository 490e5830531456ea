"""Publish a rosbag2, a frames folder or an NYU .mat file on ROS 2 topics.

A bag is published as it is, every topic, without decoding. Other frames go to the topics the node listens to:
/rgb/image_rect_color, /rgb/camera_info and /depth_registered/image_rect.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from room_layout_ros.commands.counts import real, whole
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.bag import open_reader
from room_layout_ros.datasets.source import is_bag
from room_layout_ros.playback import (
    CLOCK_TOPIC,
    FRAME_TOPICS,
    PlayOptions,
    RawMessage,
    bag_stream,
    frame_stream,
    parse_remappings,
    play,
    require_topics,
    resolve,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `play`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="rosbag2, frames folder or NYU .mat")
    parser.add_argument(
        "--rate", type=real(0.01, 100), default=1.0, metavar="X", help="times real time (default %(default)s)"
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end, until interrupted")
    parser.add_argument(
        "--loops", type=whole(0), default=1, metavar="N", help="play N times, 0: for ever (default %(default)s)"
    )
    parser.add_argument("--clock", action="store_true", help="publish /clock (for use_sim_time)")
    parser.add_argument(
        "--wait-for-subscribers",
        type=whole(0),
        default=0,
        metavar="N",
        help="start when each topic has N subscribers (default %(default)s)",
    )
    parser.add_argument(
        "--wait-timeout", type=real(0), default=60.0, metavar="SECONDS", help="longest wait (default %(default)s)"
    )
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
    if is_bag(arguments.input):
        read, total = _of_bag(arguments.input, [resolve(topic) for topic in arguments.topics or ()], options)
    elif arguments.topics:
        raise DataError(f"--topics chooses from a bag, and {arguments.input} is none")
    else:
        source = open_and_tell(arguments.input)
        require_topics("--remap", _sources(options), FRAME_TOPICS, f"in {arguments.input}")
        read, total = frame_stream(source), 3 * (source.length or 0)
    loops = options.loops
    with progress_bar("play", total * loops or None, "message") as progress:
        result = play(read, options, progress)
    told = ", ".join(f"{topic} {count}" for topic, count in sorted(result.counts.items()))
    print(f"{'stopped after' if result.interrupted else 'played'}: {told or 'nothing'}", file=sys.stderr)
    return 0


def _of_bag(path: Path, only: list[str], options: PlayOptions) -> tuple[Callable[[], Iterator[RawMessage]], int]:
    """Return the stream of a bag, of the topics in `only` if there are any, and its number of messages."""
    with open_reader(path) as reader:
        counts = Counter({c.topic: 0 for c in reader.connections})
        for connection in reader.connections:
            counts[connection.topic] += connection.msgcount
    require_topics("--topics", only, counts, f"in {path}")
    played = set(only) or set(counts)
    if options.clock and CLOCK_TOPIC in played:
        played.discard(CLOCK_TOPIC)
        print(
            f"the {CLOCK_TOPIC} of {path} is left out: --clock sends the times at which the messages were recorded; "
            "without --clock the bag's own clock is played",
            file=sys.stderr,
        )
    require_topics("--remap", _sources(options), played, "among the --topics" if only else f"in {path}")
    return bag_stream(path, played), sum(counts[topic] for topic in played)


def _sources(options: PlayOptions) -> list[str]:
    return [source for source, _ in options.remappings]
