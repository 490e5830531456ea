"""Render a walk through a synthetic room, or many rooms, with exact truth, as a frames folder or a rosbag2."""

from __future__ import annotations

import argparse
from pathlib import Path

from room_layout_ros.commands.convert import add_output_arguments, report, write_frames
from room_layout_ros.commands.counts import count, real, seed, whole
from room_layout_ros.datasets.synthetic import KINDS, NOISES, SyntheticSource


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `render`."""
    parser.add_argument("--out", type=Path, required=True, metavar="PATH", help="folder or bag to make; must not exist")
    parser.add_argument(
        "--frames", type=count, default=90, metavar="N", help="number of frames, 30 a second (default %(default)s)"
    )
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="the same seed gives the same bytes (default %(default)s)"
    )
    parser.add_argument(
        "--scene", choices=("random", *KINDS), default="cuboid", help="kind of room (default %(default)s)"
    )
    parser.add_argument(
        "--noise", choices=tuple(NOISES), default="kinect", help="what the sensor does (default %(default)s)"
    )
    parser.add_argument("--rooms", action="store_true", help="a new room for each frame instead of a walk")
    parser.add_argument(
        "--furniture",
        type=real(0, 3),
        default=1.0,
        metavar="X",
        help="0 empty, 1 lived in, 2 crammed (default %(default)s)",
    )
    parser.add_argument(
        "--wall-clutter",
        type=real(0, 0.6),
        default=0.0,
        metavar="SHARE",
        help="hide this share of every wall, 0 to 0.6 (default %(default)s)",
    )
    parser.add_argument(
        "--small-objects", type=whole(0), default=0, metavar="N", help="things of 3 to 10 cm on the floor"
    )
    add_output_arguments(parser, "a folder")


def run(arguments: argparse.Namespace) -> int:
    """Render the frames."""
    options = {
        "furniture": arguments.furniture,
        "wall_clutter": arguments.wall_clutter,
        "small_objects": arguments.small_objects,
    }
    source = SyntheticSource(
        arguments.frames, arguments.seed, arguments.scene, arguments.noise, not arguments.rooms, options=options
    )
    return report(write_frames(source, arguments, "folder", arguments.out), source, arguments.out)
