"""Frames from one kind of storage to another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .bag import BagSource
from .calibration import CameraCalibration
from .errors import DataError
from .folder import FramesFolder
from .sample import BadFrame, FrameSource
from .writers import SampleWriter


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a conversion did."""

    written: int
    bad: tuple[BadFrame, ...]


def calibration_of(source: FrameSource) -> CameraCalibration | None:
    """Return the full calibration that a source holds, None where there is only a pinhole camera per frame."""
    if isinstance(source, FramesFolder):
        return source.calibration
    return source.first_calibration() if isinstance(source, BagSource) else None


def copy_frames(
    source: FrameSource, writer: SampleWriter, progress: Callable[[int], object] | None = None
) -> Conversion:
    """Write every usable frame of a source.

    Raises
    ------
    DataError
        When there is no usable frame.
    """
    bad: list[BadFrame] = []
    written = 0
    with writer:
        for count, item in enumerate(source, 1):
            if isinstance(item, BadFrame):
                bad.append(item)
            else:
                writer.write(item)
                written += 1
            if progress:
                progress(count)
        if not written:
            reason = f": {bad[0].error}" if bad else ""
            raise DataError(f"{source.title} has no usable frame{reason}")
    return Conversion(written, tuple(bad))
