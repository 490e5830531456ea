"""Frames of a folder one by one: who works on a frame reads it, so that the master does not read them all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..datasets import BadFrame, FramesFolder, FrameSource, Sample


@dataclass(frozen=True, slots=True)
class FrameAt:
    """One frame of a folder, not read yet; a hundred bytes to send. The folder must be where it is read.

    Attributes
    ----------
    folder : restricted to this frame, with an absolute path.
    """

    folder: FramesFolder

    @property
    def name(self) -> str:
        """Name of the frame."""
        return self.folder.names[0]

    def read(self) -> Sample | BadFrame:
        """Read the frame; one that cannot be used is an error value."""
        return next(iter(self.folder))


def frames_apart(source: FrameSource) -> Iterator[FrameAt | Sample | BadFrame]:
    """Yield the frames of a source in order: of a folder where they are, of other sources as they are read here."""
    if not isinstance(source, FramesFolder):
        yield from source
        return
    path = source.path.absolute()
    for name in source.names:
        poses = {name: source.poses[name]} if name in source.poses else {}
        stamps_ns = {name: source.stamps_ns[name]}
        yield FrameAt(FramesFolder(path, source.calibration, (name,), stamps_ns, poses, source.color))


def read_frame(item: FrameAt | Sample | BadFrame) -> Sample | BadFrame:
    """Return what `frames_apart` stands for."""
    return item.read() if isinstance(item, FrameAt) else item
