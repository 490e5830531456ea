"""Frames into folders and bags; what is written reads back equal."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.decoding.image import depth_from_mm

from . import bag_messages as messages
from . import bag_topics as topics
from .bag import NAMES_KEY
from .calibration import CameraCalibration, write_calibration
from .errors import DataError
from .images import depth_to_millimetres, write_image
from .poses import write_poses, write_stamps
from .sample import Sample

STORAGES = ("sqlite3", "mcap")


class SampleWriter(Protocol):
    """Where samples go; a context manager, complete only after a clean exit."""

    def __enter__(self) -> SampleWriter:
        """Start writing."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish, or leave nothing that looks finished."""

    def write(self, sample: Sample) -> None:
        """Write one sample."""


def fits_millimetres(depth_m: NDArray[np.float32]) -> bool:
    """Whether whole millimetres of uint16 hold this depth without loss."""
    return bool(np.array_equal(depth_from_mm(depth_to_millimetres(depth_m)), depth_m, equal_nan=True))


class FolderWriter:
    """Writes a frames folder.

    Parameters
    ----------
    path : Path
        Must not exist or be empty.
    calibration : CameraCalibration or None
        Of all frames; None takes an ideal camera from the first.
    jpeg_quality : int or None
        None writes colour as PNG, without loss.

    Raises
    ------
    DataError
        When the folder holds something already.
    """

    def __init__(
        self, path: Path, calibration: CameraCalibration | None = None, jpeg_quality: int | None = None
    ) -> None:
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise DataError(f"{path} exists already and is not empty; choose another folder")
        self.path, self.calibration, self.jpeg_quality = path, calibration, jpeg_quality
        self.rounded = 0
        self._stamps: dict[str, int] = {}
        self._poses: dict[str, NDArray[np.float64]] = {}

    def __enter__(self) -> FolderWriter:
        """Make the folder."""
        self.path.mkdir(parents=True, exist_ok=True)
        return self

    def write(self, sample: Sample) -> None:
        """Write the images of one sample; `rounded` counts frames whose depth is finer than a millimetre."""
        frame, truth, name = sample.frame, sample.truth, sample.name
        if name in self._stamps:
            raise DataError(f"two frames are named {name!r}; names must differ")
        if self.calibration is None:
            self.calibration = CameraCalibration.from_intrinsics(frame.camera, frame.frame_id or "camera")
        if self.calibration.intrinsics != frame.camera:
            raise DataError(f"frame {name} has another camera than the frames before; a frames folder has one for all")
        if frame.color is not None:
            quality = self.jpeg_quality
            self._image("rgb", name, frame.color, ".png" if quality is None else ".jpg", quality or 92)
        if frame.depth_m is not None:
            self.rounded += not fits_millimetres(frame.depth_m)
            self._image("depth", name, depth_to_millimetres(frame.depth_m))
        for kind, image in (("layout", truth and truth.layout), ("labels40", truth and truth.labels40)):
            if image is not None:
                self._image(kind, name, image)
        if sample.T_world_camera is not None:
            self._poses[name] = sample.T_world_camera
        self._stamps[name] = frame.stamp_ns

    def _image(self, kind: str, name: str, image: Any, suffix: str = ".png", quality: int = 92) -> None:
        (self.path / kind).mkdir(exist_ok=True)
        write_image(self.path / kind / f"{name}{suffix}", image, quality)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write camera, stamps and poses: without them the folder does not open."""
        if kind is None and self.calibration is not None:
            write_stamps(self.path / "stamps.txt", self._stamps)
            if self._poses:
                write_poses(self.path / "poses.txt", self._poses)
            write_calibration(self.path / "camera.yaml", self.calibration)


class BagWriter:
    """Writes a rosbag2 with the topic names that the node subscribes to.

    Parameters
    ----------
    path : Path
        Of the bag's folder; must not exist.
    calibration : CameraCalibration or None
        Published with every frame; None takes the frame's ideal camera.
    storage : "sqlite3" or "mcap"

    Raises
    ------
    DataError
        When the path exists or the storage is unknown.
    """

    def __init__(self, path: Path, calibration: CameraCalibration | None = None, storage: str = "mcap") -> None:
        messages.need_rosbags()
        if storage not in STORAGES:
            raise DataError(f"storage is {storage!r}; allowed are {', '.join(STORAGES)}")
        if path.exists():
            raise DataError(f"{path} exists already; choose another name for the bag")
        self.path, self.calibration, self.storage = path, calibration, storage
        self._names: dict[int, str] = {}
        self._connections: dict[str, Any] = {}
        self._stack = ExitStack()

    def __enter__(self) -> BagWriter:
        """Make the bag."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        plugin = StoragePlugin.MCAP if self.storage == "mcap" else StoragePlugin.SQLITE3
        with self._refusals_named():
            self._writer = self._stack.enter_context(Writer(self.path, version=9, storage_plugin=plugin))
        return self

    def write(self, sample: Sample) -> None:
        """Write the messages of one sample; bag time is the frame's stamp."""
        frame, truth, stamp_ns = sample.frame, sample.truth, sample.frame.stamp_ns
        frame_id = frame.frame_id or "camera"
        if stamp_ns in self._names:
            raise DataError(f"frames {self._names[stamp_ns]} and {sample.name} have the same stamp {stamp_ns}")
        calibration = self.calibration or CameraCalibration.from_intrinsics(frame.camera, frame_id)
        if truth and truth.layout is not None:
            self._image(topics.LAYOUT_TOPIC, truth.layout, "mono8", stamp_ns, frame_id)
        if truth and truth.labels40 is not None:
            self._image(topics.CLASSES_TOPIC, truth.labels40, "mono8", stamp_ns, frame_id)
        if sample.T_world_camera is not None:
            self._put(topics.POSE_TOPIC, messages.POSE, stamp_ns, messages.encode_pose(sample.T_world_camera, stamp_ns))
        info = messages.encode_camera_info(calibration, stamp_ns, frame_id)
        self._put(topics.COLOR_INFO_TOPIC, messages.CAMERA_INFO, stamp_ns, info)
        if frame.color is not None:
            self._image(topics.COLOR_TOPIC, frame.color, "rgb8", stamp_ns, frame_id)
        if frame.depth_m is not None:
            exact = fits_millimetres(frame.depth_m)
            pixels, encoding = (depth_to_millimetres(frame.depth_m), "16UC1") if exact else (frame.depth_m, "32FC1")
            self._image(topics.DEPTH_TOPIC, pixels, encoding, stamp_ns, frame_id)
        self._names[stamp_ns] = sample.name

    def _image(self, topic: str, pixels: NDArray[Any], encoding: str, stamp_ns: int, frame_id: str) -> None:
        raw = messages.encode_image_message(pixels, encoding, stamp_ns, frame_id)
        self._put(topic, messages.IMAGE, stamp_ns, raw)

    def _put(self, topic: str, kind: str, stamp_ns: int, raw: bytes) -> None:
        with self._refusals_named():
            if topic not in self._connections:
                store = messages.typestore()
                self._connections[topic] = self._writer.add_connection(topic, kind, typestore=store)
            self._writer.write(self._connections[topic], stamp_ns, raw)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write the index and the names, or neither."""
        with self._refusals_named():
            if kind is None:
                self._writer.set_custom_data(NAMES_KEY, json.dumps({str(s): n for s, n in self._names.items()}))
            self._stack.__exit__(kind, error, trace)

    @contextmanager
    def _refusals_named(self) -> Iterator[None]:
        """Let what SQLite cannot write, on a full disk, say which bag that is: it is no error of the system."""
        try:
            yield
        except sqlite3.OperationalError as error:
            raise DataError(f"{self.path} cannot be written: {error}") from None
