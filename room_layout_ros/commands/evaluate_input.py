"""What `room-layout evaluate` measures against: frames with truth of their own, published apart, fitted or rendered."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

from room_layout_ros.commands.counts import count, seed
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.core.labels import FACES, N_FACES
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import DataError, FramesFolder, FrameSource
from room_layout_ros.datasets.frame_names import find_name
from room_layout_ros.datasets.nyu import NyuSource, open_nyu
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
        where, wanted = f"list {subset} of {_splits_of(source)}", [str(entry) for entry in splits[subset]]
    elif (listing := Path(subset)).is_file():
        where, wanted = f"{option} {subset}", _words(listing, set(source.names))
    else:
        where, wanted = f"{option} {subset}", [name.strip() for name in subset.split(",") if name.strip()]
        if not set(found := [find_name(name, source.names) for name in wanted]) <= set(source.names):
            strange = next(name for name in found if name not in source.names)
            told = f"; {strange!r} is none" if strange != subset else ""
            known = ", ".join(splits) or "none"
            raise DataError(f"{where}: neither one of its lists ({known}), nor a file, nor names of frames{told}")
    names = tuple(find_name(name, source.names) for name in wanted)
    _check_names(names, source, where)
    return names


def _check_names(names: tuple[str, ...], source: FramesFolder | NyuSource, where: str) -> None:
    if not names:
        raise DataError(f"{where} names no frame; at least one is needed")
    if missing := [name for name in names if name not in set(source.names)]:
        raise DataError(f"{where} names {missing[0]!r}, and {source.title} has no such frame")
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise DataError(f"{where} names {twice[0]!r} more than once; each frame counts once")


def _words(listing: Path, names: set[str]) -> list[str]:
    """Return the names in a file: lines that are names as they are, for these may hold spaces, else their words."""
    try:
        lines = [line.strip() for line in listing.read_text("utf-8").splitlines()]
    except UnicodeDecodeError:
        raise DataError(f"{listing} is no UTF-8 text; a file of frame names is needed") from None
    return [name for line in lines for name in ([line] if line in names else line.split())]


def _splits_of(source: FramesFolder | NyuSource) -> str:
    return "--layouts" if isinstance(source, NyuSource) else str(source.path / "splits.json")


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
