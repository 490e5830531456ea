"""What `room-layout evaluate` measures against: frames with truth of their own, published apart, fitted or rendered."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from room_layout_ros.commands.counts import count, seed
from room_layout_ros.commands.frame_choice import choose_frames
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.core.labels import FACES, N_FACES
from room_layout_ros.datasets import DataError, FrameSource
from room_layout_ros.datasets.nyu import open_nyu
from room_layout_ros.datasets.nyu_truth import read_class_map, read_layouts
from room_layout_ros.datasets.source import is_mat
from room_layout_ros.datasets.synthetic import KINDS, NOISES, SyntheticSource
from room_layout_ros.evaluation.fitted_truth import FittedSource
from room_layout_ros.learning.fit_frame import read_fits

RENDERED: dict[str, Any] = {"scene": "cuboid", "noise": "kinect", "seed": 2013}
"""Options of --rendered and what they are when not given."""


def add_input_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose frames and their truth."""
    parser.add_argument(
        "input", type=Path, nargs="?", metavar="INPUT", help="frames folder, rosbag2 or NYU v2 .mat with truth"
    )
    parser.add_argument(
        "--frames",
        metavar="SUBSET",
        help="a list of splits.json (layout_dev, official_test, ...) or of --layouts (train, test), a text file of "
        "names, or names with commas; default: every frame with a true layout",
    )
    parser.add_argument(
        "--layouts",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="published layouts of an NYU v2 .mat: fields index and layout or layout_GT in one .mat or .npz or several",
    )
    parser.add_argument("--classes40", type=Path, metavar="FILE", help="mapping of its 894 classes: field mapClass")
    parser.add_argument(
        "--face-ids",
        metavar="IDS",
        help="ids in --layouts of ceiling, floor, left, front, right wall (default 1,2,3,4,5)",
    )
    parser.add_argument("--fits", type=Path, metavar="DIR", help="true rooms from the output of room-layout fit")
    parser.add_argument("--rendered", type=count, metavar="N", help="N rendered rooms instead of INPUT, with all truth")
    scene, noise, first = RENDERED.values()
    parser.add_argument("--scene", choices=("random", *KINDS), help=f"rendered rooms (default {scene})")
    parser.add_argument("--noise", choices=tuple(NOISES), help=f"their sensor (default {noise})")
    parser.add_argument("--seed", type=seed, metavar="N", help=f"their seed (default {first})")


def open_input(arguments: argparse.Namespace) -> FrameSource:
    """Open what the options name, restricted to the chosen frames.

    Raises
    ------
    DataError
        When it cannot be opened, or options do not go together.
    """
    rooms = {} if arguments.fits is None else read_fits(arguments.fits)
    if arguments.fits is not None and not rooms:
        raise DataError(f"--fits {arguments.fits} holds no accepted fit; at least one is needed")
    source = choose_frames(_open(arguments), arguments.frames, rooms)
    return FittedSource(source, rooms) if rooms else source


def _open(arguments: argparse.Namespace) -> FrameSource:
    if arguments.rendered is None and arguments.input is None:
        raise DataError("either INPUT or --rendered N is needed")
    if arguments.rendered is not None and arguments.input is not None:
        raise DataError(f"either INPUT or --rendered N is needed; both were given: {arguments.input} and --rendered")
    apart = arguments.layouts is not None or arguments.classes40 is not None or arguments.face_ids is not None
    if apart and (arguments.input is None or not is_mat(arguments.input)):
        raise DataError("--layouts, --face-ids and --classes40 go with an NYU v2 .mat file only")
    if arguments.face_ids is not None and arguments.layouts is None:
        raise DataError("--face-ids says how to read --layouts; give that too")
    of_rendered = {name: getattr(arguments, name) for name in RENDERED if getattr(arguments, name) is not None}
    if arguments.rendered is not None:
        chosen = RENDERED | of_rendered
        return SyntheticSource(arguments.rendered, chosen["seed"], chosen["scene"], chosen["noise"], walk=False)
    if of_rendered:
        name, value = next(iter(of_rendered.items()))
        raise DataError(
            f"--{name} {value} is of rendered rooms, and {arguments.input} is none; give --rendered N for it"
        )
    if not apart:
        return open_and_tell(arguments.input)
    return open_nyu(
        arguments.input,
        layouts=None if arguments.layouts is None else read_layouts(arguments.layouts, _face_ids(arguments.face_ids)),
        class_map=None if arguments.classes40 is None else read_class_map(arguments.classes40),
    )


def _face_ids(text: str | None) -> tuple[int, ...]:
    if text is None:
        return FACES
    try:
        ids = tuple(int(word) for word in text.split(","))
    except ValueError:
        ids = ()
    if len(ids) != N_FACES:
        raise DataError(f"--face-ids {text}: five whole numbers with commas are needed")
    return ids
