"""What a run has to say of its depth: frames that were estimated without it, and a room of a strange size."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.working_size import resize_frame
from room_layout_ros.datasets import Sample
from room_layout_ros.runtime.depth_scale import DepthScale, measure_scale
from room_layout_ros.runtime.diagnosis import depth_unit_question

from .frame_words import who_has


class DepthSeen(NamedTuple):
    """Whether a frame has depth, whether the estimator can use it, and how large the room looks by it.

    `room` is False where none was found.
    """

    there: bool
    usable: bool
    color: bool
    scale: DepthScale | None
    room: bool = True

    @property
    def became(self) -> str:
        """What became of the frame without depth."""
        if not self.color:
            return "nothing could be estimated"
        return "estimated from colour alone, lengths have no unit" if self.room else "no room was found"


def see_depth(frame: RgbdFrame, config: EstimatorConfig, estimate: RoomEstimate | None = None) -> DepthSeen:
    """Look at the depth of a frame as the estimator does; the scale needs the estimate."""
    resized = resize_frame(frame, config.working_size_px)
    usable = compute_depth_geometry(resized, config) is not None
    scale = None if estimate is None else measure_scale(frame, estimate)
    room = estimate is None or estimate.cuboid is not None
    return DepthSeen(frame.depth_m is not None, usable, frame.color is not None and config.use_color, scale, room)


@dataclass(slots=True)
class DepthDoubts:
    """What was seen of the depth so far; nothing is said where `rgb_only` or the settings leave it unused."""

    config: EstimatorConfig
    rgb_only: bool = False
    frames: int = 0
    lost: list[DepthSeen] = field(default_factory=list)
    scales: list[DepthScale] = field(default_factory=list)

    def add(self, seen: DepthSeen) -> None:
        """Count a frame."""
        self.frames += 1
        if not seen.usable:
            self.lost.append(seen)
        self.weigh(seen.scale)

    def weigh(self, scale: DepthScale | None) -> None:
        """Take note how large the room looks in a frame that is counted already."""
        if scale is not None:
            self.scales.append(scale)

    def watch(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        """Yield the samples and count them on the way."""
        for sample in samples:
            self.add(see_depth(sample.frame, self.config))
            yield sample

    def tell(self) -> None:
        """Say on stderr what is odd, a line each."""
        for sentence in self.sentences():
            print(sentence, file=sys.stderr)

    def sentences(self) -> list[str]:
        """Return what is odd, in sentences."""
        if self.rgb_only or not self.config.use_depth:
            return []
        question = _unit_question(self.scales)
        return [*self._lost(), *([question] if question else [])]

    def _lost(self) -> list[str]:
        """Return a sentence for each thing that frames without depth became."""
        groups: dict[str, list[DepthSeen]] = {}
        for seen in self.lost:
            groups.setdefault(seen.became, []).append(seen)
        return [self._sentence(became, those) for became, those in groups.items()]

    def _sentence(self, became: str, those: list[DepthSeen]) -> str:
        there, c = any(seen.there for seen in those), self.config
        allowed = (
            f"; 16 bit must be millimetres, float metres, and {100 * c.min_valid_depth:g} % of the pixels "
            f"measured from {c.min_depth_m:g} to {c.max_depth_m:g} m"
        )
        what = "no usable depth" if there else "no depth"
        return f"{who_has(len(those), self.frames)} {what}: {became}{allowed if there else ''}"


def _unit_question(scales: list[DepthScale]) -> str:
    """Ask for the unit of the depth where the node would; what cures it there is no option here."""
    if not scales:
        return ""
    heights = [scale.camera_height_m for scale in scales if scale.camera_height_m is not None]
    depth_m = median(scale.median_depth_m for scale in scales)
    return depth_unit_question(depth_m, median(heights) if heights else float("nan"))
