"""Render a walk through a synthetic room, or many rooms, with exact truth, as a frames folder or a rosbag2."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from room_layout_ros.commands.convert import add_output_arguments, report, write_frames
from room_layout_ros.commands.counts import count, real, seed, whole
from room_layout_ros.core.frame import MAX_SIDE_PX, CameraIntrinsics
from room_layout_ros.datasets.synthetic import KINDS, KINECT, NOISES, SyntheticSource


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
    parser.add_argument(
        "--size", type=_size, default="640x480", metavar="WxH", help="of the images, pixels (default %(default)s)"
    )
    parser.add_argument(
        "--fov", type=real(10, 150), metavar="DEG", help="horizontal field of view; without it that of a Kinect, 62.7"
    )
    add_output_arguments(parser, "a folder")


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    try:
        return whole(1, MAX_SIDE_PX)(width), whole(1, MAX_SIDE_PX)(height)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is given; it must be WIDTHxHEIGHT, as 1280x720, each 1 to {MAX_SIDE_PX}"
        ) from None


def camera_of(size: tuple[int, int], fov_deg: float | None) -> CameraIntrinsics:
    """Return a camera that looks straight ahead; `fov_deg` None has the horizontal field of view of a Kinect."""
    width, height = size
    focal = KINECT.fx * width / KINECT.width if fov_deg is None else 0.5 * width / math.tan(math.radians(0.5 * fov_deg))
    return CameraIntrinsics(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))


def run(arguments: argparse.Namespace) -> int:
    """Render the frames."""
    options = {
        "furniture": arguments.furniture,
        "wall_clutter": arguments.wall_clutter,
        "small_objects": arguments.small_objects,
    }
    camera, walk = camera_of(arguments.size, arguments.fov), not arguments.rooms
    source = SyntheticSource(arguments.frames, arguments.seed, arguments.scene, arguments.noise, walk, camera, options)
    return report(write_frames(source, arguments, "folder", arguments.out), source, arguments.out)
