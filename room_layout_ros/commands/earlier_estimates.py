"""What an earlier `room-layout estimate` or `fit` left in its folder: the next one replaces that and nothing else."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeVar

from room_layout_ros.commands.output_folder import make_folder, remove_files
from room_layout_ros.datasets import DataError

LINES = "estimates.jsonl"
Suffixes = Mapping[str, tuple[str, ...]]
"""Folders of images and how their files end."""

SUFFIXES: Suffixes = {
    **dict.fromkeys(("layout", "labels", "furniture"), (".png",)),
    "overlay": (".jpg",),
    "free_space": (".png", ".yaml"),
}


class _HasLine(Protocol):
    @property
    def line(self) -> Mapping[str, Any]:
        """What is told of a frame; with "error" where it could not be used."""


_Result = TypeVar("_Result", bound=_HasLine)


def until_usable(results: Iterator[_Result], check: Callable[[], None] = lambda: None) -> tuple[list[_Result], bool]:
    """Return the results up to the first usable one, `check` after each, and whether there is one.

    Before it nothing of an earlier run may go: the next one may not be possible.
    """
    first = []
    for result in results:
        first.append(result)
        if "error" not in result.line:
            return first, True
        check()
    return first, False


def earlier_files(out: Path, lines: str = LINES, suffixes: Suffixes = SUFFIXES, what: str = "estimate") -> list[Path]:
    """Return the images of the frames that the folder's list of an earlier run names.

    Parameters
    ----------
    lines : name of the list, a JSON line a frame. suffixes : folders of images and how their files end.
    what : the run left, for the words of a refusal.

    Raises
    ------
    DataError
        When the folders of images hold others too, or a line names no frame.
    """
    named = list(_names(out / lines, what))
    ends = [(kind, suffix) for kind, those in suffixes.items() for suffix in those]
    files = {out / kind / f"{name}{suffix}" for name in named for kind, suffix in ends}
    for kind in suffixes:
        there = sorted((out / kind).iterdir()) if (out / kind).is_dir() else []
        for path in there:
            if path not in files and not path.name.startswith("."):
                raise DataError(
                    f"{path} is of no frame of an earlier {what}; choose another folder by --out, or empty this one"
                )
    return sorted(file for file in files if file.exists())


def replace_earlier(out: Path, earlier: Iterable[Path], wanted: Mapping[str, bool]) -> None:
    """Make the folders of images that are wanted, and remove the files of an earlier run."""
    for kind, is_wanted in wanted.items():
        if is_wanted:
            make_folder("--out", out / kind)
    remove_files(earlier, (out / kind for kind, is_wanted in wanted.items() if not is_wanted))


def _names(listing: Path, what: str) -> Iterator[str]:
    lines = listing.read_text("utf-8", "replace").splitlines() if listing.is_file() else []
    for number, text in enumerate(lines, 1):
        try:
            name = json.loads(text)["name"]
        except (ValueError, KeyError, TypeError):
            name = None
        if not isinstance(name, str) or Path(name).name != name:  # nothing is removed elsewhere
            raise DataError(
                f"{listing} line {number} names no frame, so that it is not known what is of the earlier {what}; "
                "choose another folder by --out, or empty this one"
            )
        yield name
