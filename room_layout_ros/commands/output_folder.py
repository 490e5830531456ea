"""Where a command writes: its folder is made, with those above it, if it is missing; what is not ours stays."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.folder import is_frames_folder


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


def refuse_frames(option: str, folder: Path, source: Path) -> None:
    """Refuse a folder of results where frames are: its layout/ would be written over the true one.

    Raises
    ------
    DataError
        When it is the input, or a frames folder.
    """
    if folder.resolve() == source.resolve():
        raise DataError(f"{option} {folder} is the input; choose another folder, or the results would spoil it")
    if folder.is_dir() and ((folder / "camera.yaml").exists() or is_frames_folder(folder)):
        raise DataError(
            f"{option} {folder} is a frames folder; choose another, or the results would replace its layout/"
        )


def remove_files(files: Iterable[Path], folders: Iterable[Path]) -> None:
    """Remove these files, and those of the folders that are empty then, the inner ones named first."""
    for file in files:
        file.unlink(missing_ok=True)
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
