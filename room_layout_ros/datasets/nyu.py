"""The official labelled NYU-Depth v2 file (HDF5 by MATLAB), by its documented fields.

MATLAB stores H x W x 3 x N by columns, so that HDF5 sees N x 3 x W x H. Fields used: `images`, `depths`
(metres, holes filled by the data set) or `rawDepths`, and `labels40` where somebody added it: the file itself
holds 894 classes, and their mapping to 40 was published apart from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame

from .errors import DataError
from .folder import default_stamp_ns
from .sample import MAX_NYU40, BadFrame, FrameTruth, Sample

NYU_CAMERA = CameraIntrinsics(640, 480, 518.857901, 519.469611, 325.582449, 253.736166)
"""Colour camera of the data set's toolbox; the depths are registered to it."""


@dataclass(frozen=True, slots=True)
class NyuSource:
    """A labelled .mat file; frames are named by their 1-based index, as the data set counts."""

    path: Path
    count: int
    depth_field: str
    has_labels40: bool

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"NYU v2 file {self.path}"

    @property
    def length(self) -> int:
        """Number of frames."""
        return self.count

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield the frames; only one is in memory at a time."""
        with _open(self.path) as file:
            for i in range(self.count):
                name = f"{i + 1:04d}"
                try:
                    yield self._read(file, i, name)
                except (OSError, ValueError) as error:
                    yield BadFrame(name, f"{self.path} frame {i + 1}: {error}", default_stamp_ns(i))

    def _read(self, file: Any, i: int, name: str) -> Sample:
        color = np.ascontiguousarray(file["images"][i].transpose(2, 1, 0))
        depth_m = np.ascontiguousarray(file[self.depth_field][i].T.astype(np.float32))
        depth_m[~((depth_m > 0) & np.isfinite(depth_m))] = np.nan
        truth = None
        if self.has_labels40:
            labels40 = np.ascontiguousarray(file["labels40"][i].T)
            if labels40.max(initial=0) > MAX_NYU40:
                raise DataError(f"labels40 holds {labels40.max()}; allowed are 0 to {MAX_NYU40}")
            truth = FrameTruth(labels40=labels40.astype(np.uint8))
        return Sample(RgbdFrame(NYU_CAMERA, color, depth_m, default_stamp_ns(i), "nyu_depth_v2", name), truth)


def _open(path: Path) -> Any:
    try:
        import h5py
    except ImportError:
        raise ModuleNotFoundError(
            ".mat files need h5py: pip install 'room_layout_ros[datasets]'", name="h5py"
        ) from None
    try:
        return h5py.File(path, "r")
    except OSError:
        raise DataError(f"{path} is no HDF5 file (a MATLAB file of version 7.3 is needed), or it is cut") from None


def open_nyu(path: Path, raw_depth: bool = False) -> NyuSource:
    """Open a labelled NYU v2 file.

    Parameters
    ----------
    raw_depth : bool
        Take `rawDepths` (with holes) instead of `depths`.

    Raises
    ------
    DataError
        When it is no HDF5 file or a field is missing or of the wrong shape.
    """
    depth_field = "rawDepths" if raw_depth else "depths"
    with _open(path) as file:
        for field in ("images", depth_field):
            if field not in file:
                raise DataError(f"{path} has no field {field!r}; the labelled NYU v2 file is needed")
        images, depths = file["images"], file[depth_field]
        expected = (NYU_CAMERA.width, NYU_CAMERA.height)
        if images.ndim != 4 or images.shape[1:] != (3, *expected) or images.dtype != np.uint8:
            raise DataError(
                f"{path}: images have shape {images.shape} of {images.dtype}; N x 3 x 640 x 480 uint8 is needed"
            )
        if depths.shape != (images.shape[0], *expected):
            raise DataError(f"{path}: {depth_field} has shape {depths.shape}; {(images.shape[0], *expected)} is needed")
        has_labels40 = "labels40" in file
        if has_labels40 and file["labels40"].shape != depths.shape:
            raise DataError(f"{path}: labels40 has shape {file['labels40'].shape}; {depths.shape} is needed")
        return NyuSource(path, int(images.shape[0]), depth_field, has_labels40)
