"""What `room-layout evaluate` measures against: frames with truth of their own, published apart, fitted or rendered."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from room_layout_ros.commands.counts import count, seed
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.core.labels import FACES, N_FACES
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import DataError, FramesFolder, FrameSource
from room_layout_ros.datasets.frame_names import find_name
from room_layout_ros.datasets.nyu import NyuSource, open_nyu
from room_layout_ros.datasets.nyu_truth import read_class_map, read_layouts
from room_layout_ros.datasets.synthetic import KINDS, NOISES, SyntheticSource
from room_layout_ros.evaluation.fitted_truth import FittedSource
from room_layout_ros.learning.fit_frame import read_fits


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
    parser.add_argument(
        "--scene", choices=("random", *KINDS), default="cuboid", help="rendered rooms (default %(default)s)"
    )
    parser.add_argument("--noise", choices=tuple(NOISES), default="kinect", help="their sensor (default %(default)s)")
    parser.add_argument("--seed", type=seed, default=2013, metavar="N", help="their seed (default %(default)s)")


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
    if apart and (arguments.input is None or arguments.input.suffix != ".mat"):
        raise DataError("--layouts, --face-ids and --classes40 go with an NYU v2 .mat file only")
    if arguments.face_ids is not None and arguments.layouts is None:
        raise DataError("--face-ids says how to read --layouts; give that too")
    if arguments.rendered is not None:
        return SyntheticSource(arguments.rendered, arguments.seed, arguments.scene, arguments.noise, walk=False)
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


def choose_frames(
    source: FrameSource, subset: str | None, rooms: dict[str, RoomCuboid] | None = None, option: str = "--frames"
) -> FrameSource:
    """Return the source restricted to a named subset; without one, to the frames known to have a true layout.

    Parameters
    ----------
    rooms : dict, optional
        Fitted rooms by name, which count as layouts.
    option : str
        What names the subset, for the words of a refusal.

    Raises
    ------
    DataError
        When the subset is unknown, or the input cannot be restricted.
    """
    if not isinstance(source, FramesFolder | NyuSource):
        if subset is not None:
            raise DataError(f"{option} {subset} needs a frames folder or an NYU v2 .mat; {source.title} is neither")
        return source
    if subset is not None:
        return source.subset(_names(source, subset, option))
    if isinstance(source, NyuSource):
        if source.layouts is None and not rooms:
            raise DataError(f"{source.title} holds no layouts; give the published ones by --layouts FILE")
        return source
    known = {path.stem for path in (source.path / "layout").glob("*.png")} | set(rooms or ())
    return source.subset(tuple(name for name in source.names if name in known))


def _names(source: FramesFolder | NyuSource, subset: str, option: str) -> tuple[str, ...]:
    splits = _splits(source)
    if subset in splits:
        return tuple(find_name(str(entry), source.names) for entry in splits[subset])
    if (listing := Path(subset)).is_file():
        return tuple(find_name(name, source.names) for name in listing.read_text("utf-8").split())
    names = tuple(find_name(name, source.names) for name in subset.split(",") if name)
    if not names or not set(names) <= set(source.names):
        known = ", ".join(splits) or "none"
        raise DataError(f"{option} {subset}: neither one of its lists ({known}), nor a file, nor names of frames")
    return names


def _splits(source: FramesFolder | NyuSource) -> dict[str, tuple[int | str, ...]]:
    if isinstance(source, NyuSource):
        return dict(source.splits)
    path = source.path / "splits.json"
    try:
        content = json.loads(path.read_text("utf-8")) if path.exists() else {}
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise DataError(f"{path} is no table of lists; it must be a JSON object with a list of frames for each name")
    return {name: tuple(entries) for name, entries in content.items() if isinstance(entries, list)}
