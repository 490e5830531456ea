"""Frames folders: rgb/ (or color/, image/), depth/, camera.yaml and what is known beside them (docs/data.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import N_FACES

from .calibration import CameraCalibration, read_calibration
from .errors import DataError
from .frame_names import there_are
from .images import read_color, read_depth, read_index
from .poses import Pose, read_poses, read_stamps
from .sample import MAX_NYU40, BadFrame, FrameTruth, Sample

COLOR_SUFFIXES = (".png", ".jpg", ".jpeg")
COLOR_FOLDERS = ("rgb", "color", "image")
"""Names of the colour folder: ours, and those of other people's data sets. Ours wins."""

DEFAULT_RATE_HZ = 30
FIRST_STAMP_NS = 1_000_000_000
"""Folders without stamps start at one second: a stamp of 0 means "not set" in ROS."""

_Pixels = TypeVar("_Pixels", bound=np.generic)


def is_frames_folder(path: Path) -> bool:
    """Whether a folder looks like a frames folder."""
    return any((path / name).is_dir() for name in (*COLOR_FOLDERS, "depth"))


def color_folder(path: Path) -> str:
    """Return the name of the colour folder of a frames folder; "rgb" where there is none.

    Raises
    ------
    DataError
        When several could be meant.
    """
    there = [name for name in COLOR_FOLDERS if (path / name).is_dir()] or ["rgb"]
    if len(there) > 1 and there[0] != "rgb":
        raise DataError(f"{path} has {' and '.join(f'{name}/' for name in there)}; name the colour images' folder rgb/")
    return there[0]


def default_stamp_ns(index: int) -> int:
    """Return the stamp of frame `index` where the source has none: 30 Hz."""
    return FIRST_STAMP_NS + round(index * 1e9 / DEFAULT_RATE_HZ)


@dataclass(frozen=True, slots=True)
class FramesFolder:
    """A frames folder; any frame can be read by its name.

    Attributes
    ----------
    path : the folder. calibration : of all its frames. names : of the frames, sorted.
    stamps_ns : by name; None where stamps.txt leaves the frame out, which is a bad one then.
    poses : by name; may be incomplete. color : name of the folder of the colour images.
    """

    path: Path
    calibration: CameraCalibration
    names: tuple[str, ...]
    stamps_ns: dict[str, int | None]
    poses: dict[str, Pose]
    color: str = "rgb"

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"frames folder {self.path}"

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.names)

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield the frames in the order of their names; a bad one as an error value."""
        for name in self.names:
            try:
                yield self.read(name)
            except ValueError as error:
                yield BadFrame(name, str(error), self.stamps_ns[name] or 0)

    def read(self, name: str) -> Sample:
        """Read one frame with its truth.

        Raises
        ------
        DataError
            When a file of the frame, or its stamp, is missing or bad.
        ValueError
            When the images do not fit the camera.
        """
        stamp_ns = self.stamps_ns[name]
        if stamp_ns is None:
            raise DataError(f"{self.path / 'stamps.txt'} has no stamp of frame {name}")
        color = self._image(self.color, name, COLOR_SUFFIXES, read_color)
        depth_m = self._image("depth", name, (".png",), read_depth)
        camera, frame_id = self.calibration.intrinsics, self.calibration.camera_name
        frame = RgbdFrame(camera, color, depth_m, stamp_ns, frame_id, name)
        layout = self._truth("layout", name, N_FACES)
        labels40 = self._truth("labels40", name, MAX_NYU40)
        truth = None if layout is None and labels40 is None else FrameTruth(layout, labels40)
        return Sample(frame, truth, self.poses.get(name))

    def subset(self, names: tuple[str, ...]) -> FramesFolder:
        """Return the source restricted to these frames, in this order.

        Raises
        ------
        DataError
            When a name is not in the folder.
        """
        known = set(self.names)
        if missing := [name for name in names if name not in known]:
            raise DataError(f"{self.path} has no frame {missing[0]!r}; {there_are(self.names)}")
        return replace(self, names=names)

    def _image(
        self, kind: str, name: str, suffixes: tuple[str, ...], read: Callable[[Path], NDArray[_Pixels]]
    ) -> NDArray[_Pixels] | None:
        folder = self.path / kind
        if not folder.is_dir():
            return None
        for suffix in suffixes:
            if (path := folder / f"{name}{suffix}").exists():
                return read(path)
        others = f" (nor is there {', '.join(suffixes[1:])})" if suffixes[1:] else ""
        raise DataError(f"{folder / name}{suffixes[0]} is missing{others}")

    def _truth(self, kind: str, name: str, highest: int) -> NDArray[np.uint8] | None:
        path = self.path / kind / f"{name}.png"
        if not path.exists():
            return None
        image = read_index(path, highest)
        if image.shape != (self.calibration.height, self.calibration.width):
            raise DataError(
                f"{path} has shape {image.shape}; the camera says {(self.calibration.height, self.calibration.width)}"
            )
        return image


def open_folder(path: Path) -> FramesFolder:
    """Open a frames folder.

    Raises
    ------
    DataError
        When there is no camera.yaml, no frame, or a list beside the frames is bad.
    """
    if not is_frames_folder(path):
        raise DataError(f"{path} has neither rgb/ (or color/, image/) nor depth/; it is no frames folder")
    color = color_folder(path)
    calibration = read_calibration(path / "camera.yaml")
    names = _names(path, color)
    if not names:
        told = f" ({others})" if (others := unread(path)) else ""
        raise DataError(f"{path} holds no frames; {color}/NAME.jpg or .png and depth/NAME.png are needed{told}")
    stamps: dict[str, int | None] = {name: default_stamp_ns(i) for i, name in enumerate(names)}
    if (path / "stamps.txt").exists():
        stamps = dict.fromkeys(names) | read_stamps(path / "stamps.txt")
    poses = read_poses(path / "poses.txt", names) if (path / "poses.txt").exists() else {}
    return FramesFolder(path, calibration, names, stamps, poses, color)


def unread(path: Path) -> str:
    """Return what of a frames folder is not read, in a sentence for people; "" where there is nothing to say.

    That is colour or depth in a folder of no known name, and pictures, of the truth too, of an unknown suffix.
    """
    known = ", ".join(f"{name}/" for name in COLOR_FOLDERS)
    others = sorted(p.name for p in path.glob("*/") if p.name not in (*COLOR_FOLDERS, *_KNOWN) and _pictures(p))
    hint = f"; {', '.join(f'{name}/' for name in others)} is not read" if others else ""
    if not any((path / name).is_dir() for name in COLOR_FOLDERS):
        return f"{path} is read as depth alone: it has no colour in a folder of the names {known}{hint}"
    if others and not (path / "depth").is_dir():
        return f"{path} is read as colour alone: it has no depth in a folder of the name depth/{hint}"
    for name, suffixes in ((color_folder(path), COLOR_SUFFIXES), *((known, (".png",)) for known in _KNOWN)):
        unread = [p for p in _pictures(path / name) if p.suffix not in suffixes]
        if unread:
            allowed = " or ".join(suffixes)
            return (
                f"{len(unread)} files in {path / name} are not read, as {unread[0].name}; names must end in {allowed}"
            )
    return ""


_KNOWN = ("depth", "layout", "labels40")


def _pictures(folder: Path) -> list[Path]:
    """Return the files that are pictures by their suffix, whatever its letters."""
    files = folder.iterdir() if folder.is_dir() else ()
    return sorted(p for p in files if p.suffix.lower() in COLOR_SUFFIXES and not p.name.startswith("."))


def _names(path: Path, color_name: str) -> tuple[str, ...]:
    pictures = (p for suffix in COLOR_SUFFIXES for p in path.glob(f"{color_name}/*{suffix}"))
    color = {p.stem for p in pictures if not p.name.startswith(".")}
    depth = {p.stem for p in path.glob("depth/*.png") if not p.name.startswith(".")}
    names = sorted(color | depth)
    counted = all(name.isascii() and name.isdecimal() for name in names)  # 0, 1, ... 10 without zeros before them
    return tuple(sorted(names, key=int) if counted else names)
