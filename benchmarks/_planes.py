"""Errors of the planes in view, gathered over frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.datasets import Sample
from room_layout_ros.evaluation.room_scores import planes_by_name


@dataclass
class Planes:
    """Offsets in m and angles in degrees; medians and shares are NaN where no plane was seen."""

    offsets_m: list[float] = field(default_factory=list)
    angles_deg: list[float] = field(default_factory=list)

    def add(self, sample: Sample, estimate: RoomEstimate) -> None:
        """Add those of a frame; none where the truth or the estimate has no room."""
        truth = None if sample.truth is None else sample.truth.cuboid
        if truth is None or estimate.cuboid is None:
            return
        errors = planes_by_name(truth, estimate.cuboid, sample.frame.camera, estimate.layout)
        seen = np.isfinite(errors.offset_m)
        self.offsets_m += errors.offset_m[seen].tolist()
        self.angles_deg += errors.angle_deg[seen].tolist()

    def columns(self) -> tuple[float, float, float]:
        """Return median offset in cm, median angle in degrees, percent within 3 cm and 0.5 degrees."""
        if not self.offsets_m:
            return np.nan, np.nan, np.nan
        offsets, angles = np.array(self.offsets_m), np.array(self.angles_deg)
        within = 100.0 * np.mean((offsets <= 0.03) & (angles <= 0.5))
        return 100 * float(np.median(offsets)), float(np.median(angles)), float(within)
