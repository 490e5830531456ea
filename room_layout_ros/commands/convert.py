"""Make a rosbag2 of a frames folder or an NYU .mat file, or a frames folder of a rosbag2.

Pixels, depth, stamps, names, calibration, poses and truth survive the way there and back. Depth finer than a
millimetre is kept in bags (32FC1) and rounded in folders; that is said.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from room_layout_ros.commands.counts import whole
from room_layout_ros.commands.output_folder import named_when_full
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import add_recover_argument, add_topic_arguments, open_with_topics
from room_layout_ros.datasets import DataError, FrameSource
from room_layout_ros.datasets.bag import BagSource
from room_layout_ros.datasets.convert import Conversion, calibration_of, copy_frames
from room_layout_ros.datasets.nyu import open_nyu
from room_layout_ros.datasets.nyu_truth import read_class_map
from room_layout_ros.datasets.source import is_mat
from room_layout_ros.datasets.writers import STORAGES, BagWriter, FolderWriter

MAX_NAMED = 5
DEFAULT_STORAGE = "mcap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `convert`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="frames folder, rosbag2 or NYU .mat")
    parser.add_argument("output", type=Path, metavar="OUTPUT", help="folder to make; must not exist")
    add_output_arguments(parser, "a folder from a bag, else a bag")
    parser.add_argument(
        "--classes40",
        type=Path,
        metavar="FILE",
        help="mapping of an NYU .mat's 894 classes to labels40: field mapClass",
    )
    add_recover_argument(parser)
    add_topic_arguments(parser)


def add_output_arguments(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the options that say what is written."""
    parser.add_argument("--to", choices=("bag", "folder"), help=f"what to write (default: {default})")
    parser.add_argument("--storage", choices=STORAGES, help=f"of a bag (default: {DEFAULT_STORAGE})")
    parser.add_argument(
        "--jpeg", type=whole(1, 100), metavar="QUALITY", help="colour of a folder as JPEG, 1 to 100 (default: PNG)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Convert the input."""
    source = _open(arguments)
    default = "folder" if isinstance(source, BagSource) else "bag"
    done = write_frames(source, arguments, default, arguments.output, arguments.recover)
    return report(done, source, arguments.output)


def _open(arguments: argparse.Namespace) -> FrameSource:
    if arguments.classes40 is None:
        return open_with_topics(arguments.input, arguments, arguments.recover)
    if not is_mat(arguments.input):
        raise DataError(f"--classes40 {arguments.classes40} is for an NYU .mat; {arguments.input} is none")
    return open_nyu(arguments.input, class_map=read_class_map(arguments.classes40))


def write_frames(
    source: FrameSource, arguments: argparse.Namespace, default: str, output: Path, recover: bool = False
) -> Conversion:
    """Write all frames of a source as the options say; `recover` writes what can be read of a damaged one.

    Raises
    ------
    DataError
        When an option is for the other kind of output, or something cannot be read or written.
    """
    to_bag = (arguments.to or default) == "bag"
    if to_bag and arguments.jpeg is not None:
        raise DataError(f"--jpeg {arguments.jpeg} is for a frames folder, and a bag is written")
    if not to_bag and arguments.storage is not None:
        raise DataError(f"--storage {arguments.storage} is for a bag, and a frames folder is written")
    calibration = calibration_of(source)
    writer: BagWriter | FolderWriter
    if to_bag:
        writer = BagWriter(output, calibration, arguments.storage or DEFAULT_STORAGE)
    else:
        writer = FolderWriter(output, calibration, arguments.jpeg)
    with named_when_full(output), progress_bar("write", source.length) as progress:
        done = copy_frames(source, writer, progress, recover)
    if isinstance(writer, FolderWriter) and writer.rounded:
        print(f"depth of {writer.rounded} frames was finer than a millimetre and is rounded", file=sys.stderr)
    return done


def report(done: Conversion, source: FrameSource, output: Path) -> int:
    """Say what was written, what was left out and what is lost."""
    if done.damage is not None:
        print(done.damage, file=sys.stderr)
    for bad in done.bad[:MAX_NAMED]:
        print(f"left out {bad.name}: {bad.error}", file=sys.stderr)
    if len(done.bad) > MAX_NAMED:
        print(f"left out {len(done.bad) - MAX_NAMED} more", file=sys.stderr)
    print(f"{source.title}: {done.written} frames written to {output}", file=sys.stderr)
    return 0
