"""Where a command writes: its folder is made, with those above it, if it is missing; what is not ours stays."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.folder import is_frames_folder

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def make_folder(option: str, folder: Path) -> None:
    """Make a folder that an option names.

    Raises
    ------
    DataError
        When it is a file, or lies in one, or is a link to nowhere.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        there = (path for path in (folder, *folder.parents) if path.exists() or path.is_symlink())
        other = next(path for path in there if not path.is_dir())
        kind = "a file" if other.exists() else "a link to nothing"
        raise DataError(f"{other} is {kind}; {option} needs a folder") from None


@contextmanager
def held_alone(option: str, folder: Path) -> Iterator[None]:
    """Make a folder that an option names and hold it while the block runs; it is released however the process ends.

    Where the block fails with nothing in the folder, those that were made for it go again.

    Raises
    ------
    DataError
        As `make_folder` and `named_when_full`, and when another run holds it.
    """
    with _made(option, folder), named_when_full(folder), _held(option, folder):
        yield


@contextmanager
def _made(option: str, folder: Path) -> Iterator[None]:
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    make_folder(option, folder)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # something is in it
            for path in new:
                path.rmdir()
        raise


@contextmanager
def named_when_full(folder: Path) -> Iterator[None]:
    """Let a disk that fills up while the block writes say which folder was written: the system does not.

    Raises
    ------
    DataError
        In the place of an error of the system that there is no room.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _NO_ROOM or error.filename is not None:
            raise
        raise DataError(f"{folder} cannot be written: {error.strerror}") from None


@contextmanager
def _held(option: str, folder: Path) -> Iterator[None]:
    if sys.platform == "win32":  # a folder cannot be locked there
        yield
        return
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DataError(f"another run is writing into {option} {folder}; wait for it, or choose another") from None
        except OSError:
            pass  # a file system without locks cannot tell two runs apart
        yield
    finally:
        os.close(handle)


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
