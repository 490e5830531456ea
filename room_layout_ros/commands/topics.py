"""How an input is opened: the options of a bag, and a word on what is not read and on a camera that may be another."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from room_layout_ros.commands.counts import real
from room_layout_ros.datasets import DataError, FramesFolder, FrameSource, open_source
from room_layout_ros.datasets.bag import BagSource
from room_layout_ros.datasets.folder import unread
from room_layout_ros.datasets.source import opens_as_bag

_TOPICS = ("color_topic", "depth_topic", "color_info_topic", "depth_info_topic")
_OPTIONS = (*_TOPICS, "max_stamp_gap", "camera", "assume_registered", "recover")


def add_topic_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the topic options."""
    group = parser.add_argument_group("topics of a bag (found by name and type if not given)")
    for name in _TOPICS:
        group.add_argument(f"--{name.replace('_', '-')}", metavar="TOPIC")
    group.add_argument(
        "--max-stamp-gap",
        type=real(0, 60),
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
        See `open_source`; also where an option is given that is for a bag, and the input is none.
    """
    if path.exists() and not opens_as_bag(path):
        if arguments.camera is not None:
            raise DataError(f"--camera is for a bag, and {path} is none; a frames folder or .mat has its own camera")
        refuse_bag_options(arguments, f"and {path} is none")
    options: dict[str, object] = {n: getattr(arguments, n) for n in _TOPICS if getattr(arguments, n) is not None}
    if arguments.max_stamp_gap is not None:
        options["max_stamp_gap_ns"] = round(arguments.max_stamp_gap * 1e9)
    if arguments.assume_registered:
        options["assume_registered"] = True
    if arguments.camera is not None:
        options["camera"] = arguments.camera
    if recover:
        options["recover"] = True
    return open_and_tell(path, **options)


def refuse_bag_options(arguments: argparse.Namespace, why: str) -> None:
    """Refuse the options of a bag where none is read: they would change nothing.

    Raises
    ------
    DataError
        With the first that was given.
    """
    values = ((name, getattr(arguments, name, None)) for name in _OPTIONS)
    given = [name for name, value in values if not (value is None or value is False)]  # a gap of 0 was given
    for name in given[:1]:
        raise DataError(f"--{name.replace('_', '-')} is for a bag, {why}")


def open_and_tell(path: Path, **options: object) -> FrameSource:
    """Open an input; say on stderr what of a folder is not read though the like is, and what is odd about the camera.

    Raises
    ------
    DataError
        See `open_source`; also where no camera_info of a bag can be used.
    """
    source, told = open_source(path, **options), list[str]()
    if isinstance(source, FramesFolder):
        told = [unread(source.path), source.calibration.warning]
    elif isinstance(source, BagSource):
        warning = source.first_calibration().warning
        told = [f"{path}: {warning}" if warning and source.camera is None else warning, source.passed_over]
    for sentence in filter(None, told):
        print(sentence, file=sys.stderr)
    return source
