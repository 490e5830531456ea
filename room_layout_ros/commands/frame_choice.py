"""Which frames of an input: a subset by the name of a list, a file or names, and those never to learn from."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import DataError, FramesFolder, FrameSource
from room_layout_ros.datasets.frame_names import find_name
from room_layout_ros.datasets.nyu import NyuSource

_HOLD_OUT, _FRAMES = "--hold-out", "--frames"


def add_hold_out_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that names frames for `subset_names`."""
    parser.add_argument(
        _HOLD_OUT, metavar="SUBSET", help="list of splits.json, file or names of frames never to learn from"
    )


def open_frames_folder(path: Path, needed: str) -> FramesFolder:
    """Open a frames folder; `needed` says what for, should it be none.

    Raises
    ------
    DataError
        When it cannot be opened, or is another kind of input.
    """
    source = open_and_tell(path)
    if not isinstance(source, FramesFolder):
        raise DataError(f"{source.title} is no frames folder; {needed}")
    return source


def subset_names(source: FramesFolder, subset: str | None, option: str = _HOLD_OUT) -> tuple[str, ...]:
    """Return the names of a subset of a frames folder that an option names as --frames does; none without one."""
    return () if subset is None else _names(source, subset, option)


def choose_frames(source: FrameSource, subset: str | None, rooms: dict[str, RoomCuboid] | None = None) -> FrameSource:
    """Return the source restricted to a named subset; without one, to the frames known to have a true layout.

    Parameters
    ----------
    rooms : dict, optional
        Fitted rooms by name, which count as layouts.

    Raises
    ------
    DataError
        When the subset is unknown, or the input cannot be restricted.
    """
    if not isinstance(source, FramesFolder | NyuSource):
        if subset is not None:
            raise DataError(f"{_FRAMES} {subset} needs a frames folder or an NYU v2 .mat; {source.title} is neither")
        return source
    if subset is not None:
        return source.subset(_names(source, subset, _FRAMES))
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
