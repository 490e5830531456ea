"""The output of the estimator: what a room looks like from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from .confidence import Signs
from .frame import RgbdFrame
from .labels import N_FACES
from .layout import FacePolygon, RoomCuboid


class Status(Enum):
    """How an estimate ended. Expected failures are values, not exceptions."""

    OK = "ok"
    NO_DEPTH = "no depth"
    """Too little depth and no colour estimate wanted or possible."""
    NO_ROOM = "no room in view"
    """Too little structure to place any face."""
    DEADLINE = "deadline"
    """Stopped early; what is there is the best so far (or nothing)."""


@dataclass(frozen=True, slots=True)
class RoomEstimate:
    """Joint estimate of layout and clutter for one frame.

    Images are (H, W) uint8 with the ids of `labels.py`; without an estimate they are all 0.

    Attributes
    ----------
    layout : the empty room's faces, 1..5. labels : faces where seen and clutter, 1..6, 0 unknown.
    furniture : NYU40 id on clutter pixels, 0 elsewhere.
    superpixels : (H, W) int32 superpixel index.
    R_room_camera : (3, 3) rows are the room axes (X right, Y down, Z front) in the camera frame.
    axes_confidence, confidence : 0..1. face_confidence : (5,) 0..1, 0 is "not observed".
    cuboid : the room, None without an estimate. polygons : visible faces.
    metric : False where the scale is unknown (no depth): then one unit is the distance of the front wall.
    signs : what the confidences were computed from, for calibration; None where the method has none.
    energy, lower_bound : of the joint energy; NaN where the method has none. A bound of -inf was not computed (the
        setting `joint_bound`, a deadline).
    timings_ms : wall time per stage.
    """

    status: Status
    layout: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    furniture: NDArray[np.uint8]
    superpixels: NDArray[np.int32]
    R_room_camera: NDArray[np.float64]
    axes_confidence: float
    confidence: float
    face_confidence: NDArray[np.float64]
    cuboid: RoomCuboid | None
    polygons: tuple[FacePolygon, ...]
    metric: bool = True
    energy: float = float("nan")
    lower_bound: float = float("nan")
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    stamp_ns: int = 0
    frame_id: str = ""
    name: str = ""
    signs: Signs | None = None

    @property
    def gap(self) -> float:
        """Energy above the lower bound: 0 proves the optimum, +inf or NaN says that no bound was computed."""
        return self.energy - self.lower_bound


def no_estimate(status: Status, frame: RgbdFrame, timings_ms: Mapping[str, float]) -> RoomEstimate:
    """Return the answer where there is none: empty images and the reason."""
    size = (frame.camera.height, frame.camera.width)
    return RoomEstimate(
        status=status,
        layout=np.zeros(size, np.uint8),
        labels=np.zeros(size, np.uint8),
        furniture=np.zeros(size, np.uint8),
        superpixels=np.zeros(size, np.int32),
        R_room_camera=np.eye(3),
        axes_confidence=0.0,
        confidence=0.0,
        face_confidence=np.zeros(N_FACES),
        cuboid=None,
        polygons=(),
        timings_ms=timings_ms,
        stamp_ns=frame.stamp_ns,
        frame_id=frame.frame_id,
        name=frame.name,
    )
