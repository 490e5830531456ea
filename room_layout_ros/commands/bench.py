"""Measure the speed of the estimator on this machine: milliseconds per stage, frames per second.

On your own frames (INPUT), or without it on rendered ones. What takes part is the estimator alone: no decoding, no
messages. The other benchmarks (accumulators, accuracy, robustness...) are in the source tree: `make bench` there.
"""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path

import cv2

from room_layout_ros.commands.counts import count
from room_layout_ros.commands.estimator_options import add_estimator_options, parse_settings, prepared
from room_layout_ros.commands.frame_words import count_of_frames
from room_layout_ros.commands.topics import add_topic_arguments, open_with_topics, refuse_bag_options
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.datasets import FrameSource
from room_layout_ros.datasets.usable import usable_samples
from room_layout_ros.evaluation.speed import describe_machine, describe_speed, measure_speed

RENDERED_SEED = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench`."""
    parser.add_argument(
        "input", type=Path, nargs="?", metavar="INPUT", help="frames folder, rosbag2 or NYU .mat (default: rendered)"
    )
    parser.add_argument(
        "--frames", type=count, default=20, metavar="N", help="the first N frames (default %(default)s)"
    )
    add_estimator_options(parser)
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Measure and print."""
    estimator = LayoutEstimator(parse_settings(arguments.set, arguments.rgb_only))
    source = _source(arguments)
    samples = islice(usable_samples(source.title, source), arguments.frames)
    frames = [prepared(sample.frame, arguments.rgb_only) for sample in samples]
    cv2.setNumThreads(1)  # as the node and `estimate` work
    camera = frames[0].camera
    print(describe_machine())
    print(f"{source.title}: {count_of_frames(len(frames))} of {camera.width}x{camera.height}")
    print(describe_speed(measure_speed(frames, estimator)))
    return 0


def _source(arguments: argparse.Namespace) -> FrameSource:
    if arguments.input is not None:
        return open_with_topics(arguments.input, arguments)
    refuse_bag_options(arguments, "and without INPUT a room is rendered")
    from room_layout_ros.datasets.synthetic import SyntheticSource

    return SyntheticSource(frames=arguments.frames, seed=RENDERED_SEED)
