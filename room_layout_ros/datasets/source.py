"""One door for all inputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .errors import DataError
from .folder import is_frames_folder, open_folder
from .sample import FrameSource

BAG_SUFFIXES = (".db3", ".mcap")
BAG_METADATA = "metadata.yaml"


def is_bag(path: Path) -> bool:
    """Whether a path looks like a rosbag2: its folder or its storage file."""
    if path.is_dir():
        return (path / BAG_METADATA).exists() or any(p.suffix in BAG_SUFFIXES for p in path.iterdir())
    return path.suffix in BAG_SUFFIXES


def is_mat(path: Path) -> bool:
    """Whether a path is named as a MATLAB file, in whatever letters."""
    return path.suffix.lower() == ".mat"


def opens_as_bag(path: Path) -> bool:
    """Whether `open_source` takes a path for a bag: a frames folder is none, whatever else lies in it."""
    return is_bag(path) and not (path.is_dir() and is_frames_folder(path))


def open_source(path: Path | str, **options: Any) -> FrameSource:
    """Open whatever `path` is: a frames folder, a rosbag2 (sqlite3, mcap), or an NYU v2 .mat.

    Parameters
    ----------
    path : path or str
    **options
        Of bags: see `bag.open_bag`.

    Raises
    ------
    DataError
        One sentence when it is missing, none of these, or damaged.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path} does not exist; give a frames folder, a rosbag2 or an NYU .mat file")
    if opens_as_bag(path):
        from .bag import open_bag

        return open_bag(path, **options)
    if path.is_dir() and is_frames_folder(path):
        return open_folder(path)
    if is_mat(path):
        from .nyu import open_nyu

        return open_nyu(path)
    if path.name == BAG_METADATA:
        raise DataError(f"{path} is the metadata of a rosbag2; give its folder, {path.parent}")
    if path.suffix.lower() == ".bag":
        raise DataError(f"{path} is a ROS 1 bag; rosbags-convert --src {path} --dst {path.stem} makes a rosbag2 of it")
    raise DataError(
        f"{path} is no frames folder (rgb/ or color/, depth/), no rosbag2 ({BAG_METADATA}, .db3, .mcap) "
        "and no .mat file"
    )
