"""Where a command writes: its folder is made, with those above it, if it is missing."""

from __future__ import annotations

from pathlib import Path

from room_layout_ros.datasets import DataError


def make_folder(option: str, folder: Path) -> None:
    """Make a folder that an option names.

    Raises
    ------
    DataError
        When it is a file, or lies in one.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        file = next(path for path in (folder, *folder.parents) if path.is_file())
        raise DataError(f"{file} is a file; {option} needs a folder") from None
