"""The official labelled NYU-Depth v2 file (HDF5 by MATLAB), by its documented fields.

MATLAB stores H x W x 3 x N by columns, so that HDF5 sees N x 3 x W x H. Fields used: `images`, `depths`
(metres, holes filled by the data set) or `rawDepths`, and `labels` (894 classes) where their mapping to 40 is given, or
`labels40` where somebody added it. Layouts and the mapping were published apart from the file: `nyu_truth`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame

from .errors import DataError
from .folder import default_stamp_ns
from .mat_fields import open_hdf5
from .nyu_truth import NyuLayouts
from .sample import MAX_NYU40, BadFrame, FrameTruth, Sample

NYU_CAMERA = CameraIntrinsics(640, 480, 518.857901, 519.469611, 325.582449, 253.736166)
"""Colour camera of the data set's toolbox; the depths are registered to it."""


@dataclass(frozen=True, slots=True)
class NyuSource:
    """Frames of a labelled .mat file; they are named by their number from 1, as the data set counts.

    Attributes
    ----------
    numbers : of the frames that are yielded. depth_field : `depths` or `rawDepths`. has_labels40 : of the file.
    layouts : their true layouts, or None. class_map : (895,) uint8 NYU40 class of each class of `labels`, or None.
    """

    path: Path
    numbers: tuple[int, ...]
    depth_field: str
    has_labels40: bool
    layouts: NyuLayouts | None = None
    class_map: NDArray[np.uint8] | None = None

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"NYU v2 file {self.path}"

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.numbers)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(map(frame_name, self.numbers))

    @property
    def splits(self) -> dict[str, tuple[int, ...]]:
        """Lists of frames that were published with the layouts, by name."""
        return {} if self.layouts is None else dict(self.layouts.splits)

    def subset(self, names: tuple[str, ...]) -> NyuSource:
        """Return the source restricted to these frames, in this order.

        Raises
        ------
        DataError
            When a name is not among them.
        """
        number_of = dict(zip(self.names, self.numbers, strict=True))
        if missing := [name for name in names if name not in number_of]:
            of_them = " with a layout" if self.layouts else ""
            raise DataError(f"{self.path} has no frame {missing[0]!r}{of_them}")
        return replace(self, numbers=tuple(number_of[name] for name in names))

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield the frames; only one is in memory at a time."""
        with open_hdf5(self.path) as file:
            for number in self.numbers:
                try:
                    yield self._read(file, number)
                except (OSError, ValueError) as error:
                    bad = f"{self.path} frame {number}: {error}"
                    yield BadFrame(frame_name(number), bad, default_stamp_ns(number - 1))

    def _read(self, file: Any, number: int) -> Sample:
        i, stamp_ns = number - 1, default_stamp_ns(number - 1)
        color = np.ascontiguousarray(file["images"][i].transpose(2, 1, 0))
        depth_m = np.ascontiguousarray(file[self.depth_field][i].T.astype(np.float32))
        depth_m[~((depth_m > 0) & np.isfinite(depth_m))] = np.nan
        layout = None if self.layouts is None else self.layouts.of(number)
        labels40 = self._labels40(file, i)
        truth = None if layout is None and labels40 is None else FrameTruth(layout, labels40)
        frame = RgbdFrame(NYU_CAMERA, color, depth_m, stamp_ns, "nyu_depth_v2", frame_name(number))
        return Sample(frame, truth)

    def _labels40(self, file: Any, i: int) -> NDArray[np.uint8] | None:
        if self.class_map is not None:
            labels = file["labels"][i].T
            if labels.max(initial=0) >= len(self.class_map):
                raise DataError(f"labels holds {labels.max()}; the mapping has classes 1 to {len(self.class_map) - 1}")
            return np.ascontiguousarray(self.class_map[labels])
        if not self.has_labels40:
            return None
        labels40 = file["labels40"][i].T
        if labels40.max(initial=0) > MAX_NYU40:
            raise DataError(f"labels40 holds {labels40.max()}; allowed are 0 to {MAX_NYU40}")
        return np.ascontiguousarray(labels40.astype(np.uint8))


def frame_name(number: int) -> str:
    """Return the name of a frame by its number."""
    return f"{number:04d}"


def open_nyu(
    path: Path,
    raw_depth: bool = False,
    layouts: NyuLayouts | None = None,
    class_map: NDArray[np.uint8] | None = None,
) -> NyuSource:
    """Open a labelled NYU v2 file.

    Parameters
    ----------
    raw_depth : bool
        Take `rawDepths` (with holes) instead of `depths`.
    layouts : NyuLayouts, optional
        True layouts of some frames; the source is restricted to these.
    class_map : (K + 1,) uint8 array, optional
        NYU40 class of each class of `labels`; it is taken even where the file has `labels40`.

    Raises
    ------
    DataError
        When it is no HDF5 file, a field is missing or of the wrong shape, or the layouts are of other images.
    """
    depth_field = "rawDepths" if raw_depth else "depths"
    wanted = ("images", depth_field, *([] if class_map is None else ["labels"]))
    with open_hdf5(path) as file:
        for field in wanted:
            if field not in file:
                raise DataError(f"{path} has no field {field!r}; the labelled NYU v2 file is needed")
        images, expected = file["images"], (NYU_CAMERA.width, NYU_CAMERA.height)
        if images.ndim != 4 or images.shape[1:] != (3, *expected) or images.dtype != np.uint8:
            raise DataError(
                f"{path}: images have shape {images.shape} of {images.dtype}; N x 3 x 640 x 480 uint8 is needed"
            )
        count = int(images.shape[0])
        for field in (*wanted[1:], "labels40"):
            if field in file and file[field].shape != (count, *expected):
                raise DataError(f"{path}: {field} has shape {file[field].shape}; {(count, *expected)} is needed")
        if layouts is not None:
            _check_layouts(layouts, count, path)
        numbers = tuple(range(1, count + 1)) if layouts is None else layouts.numbers
        return NyuSource(path, numbers, depth_field, "labels40" in file, layouts, class_map)


def _check_layouts(layouts: NyuLayouts, count: int, path: Path) -> None:
    if layouts.numbers[-1] > count:
        raise DataError(f"the layouts name image {layouts.numbers[-1]}; {path} holds {count}")
    if layouts.faces.shape[1:] != (NYU_CAMERA.height, NYU_CAMERA.width):
        raise DataError(
            f"layouts have shape {layouts.faces.shape[1:]}; {(NYU_CAMERA.height, NYU_CAMERA.width)} is needed"
        )
