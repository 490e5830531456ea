"""Frames from one kind of storage to another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .bag import BagSource
from .calibration import CameraCalibration
from .errors import DataError
from .folder import FramesFolder
from .readable import ReadablePart
from .sample import BadFrame, FrameSource
from .usable import no_usable_frame
from .writers import SampleWriter


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a conversion did; `damage` is what a source that was read on behind it has lost."""

    written: int
    bad: tuple[BadFrame, ...]
    damage: DataError | None = None


def calibration_of(source: FrameSource) -> CameraCalibration | None:
    """Return the full calibration that a source holds, None where there is only a pinhole camera per frame."""
    if isinstance(source, FramesFolder):
        return source.calibration
    return source.first_calibration() if isinstance(source, BagSource) else None


def copy_frames(
    source: FrameSource, writer: SampleWriter, progress: Callable[[int], object] | None = None, recover: bool = False
) -> Conversion:
    """Write every usable frame of a source.

    Parameters
    ----------
    recover : bool
        Be content with what can be read of a damaged source.

    Raises
    ------
    DataError
        When there is no usable frame, or the source is damaged and `recover` false.
    """
    bad: list[BadFrame] = []
    written = 0
    items = ReadablePart(source)
    with writer:
        for count, item in enumerate(items, 1):
            if isinstance(item, BadFrame):
                bad.append(item)
            else:
                writer.write(item)
                written += 1
            if progress:
                progress(count)
        if items.damage is not None and not (recover and written):
            raise items.damage
        if not written:
            raise no_usable_frame(source.title, bad[0] if bad else None)
    return Conversion(written, tuple(bad), items.damage)
