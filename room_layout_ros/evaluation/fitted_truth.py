"""Frames with rooms fitted to their class labels as truth (`room-layout fit`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import BadFrame, FrameSource, FrameTruth, Sample


@dataclass(frozen=True, slots=True)
class FittedSource:
    """A source whose frames get the cuboid of their fit, and its layout where they have no true one."""

    source: FrameSource
    rooms: Mapping[str, RoomCuboid]

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"{self.source.title}, with fitted rooms"

    @property
    def length(self) -> int | None:
        """Number of frames."""
        return self.source.length

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield the frames in order."""
        for item in self.source:
            room = self.rooms.get(item.name)
            yield item if room is None or isinstance(item, BadFrame) else _with_room(item, room)


def _with_room(sample: Sample, room: RoomCuboid) -> Sample:
    truth = sample.truth or FrameTruth()
    layout = room.raster(sample.frame.camera) if truth.layout is None else truth.layout
    return replace(sample, truth=replace(truth, layout=layout, cuboid=room))
