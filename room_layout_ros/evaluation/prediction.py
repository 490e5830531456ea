"""What a method says about a frame, wherever it comes from: the estimator, a baseline, files of an earlier run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid


@dataclass(frozen=True, slots=True)
class Prediction:
    """Attributes as in `RoomEstimate`; None or NaN where the method does not say.

    `metric` is False where the cuboid's scale is unknown; `free_floor` are the cells called free, on those of the
    sample's floor map. `status` is "ok" or what the method said instead; `milliseconds` is its wall time for the
    frame, NaN where nobody knows it, None where whoever calls the method shall take the time of the call.
    """

    layout: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    furniture: NDArray[np.uint8] | None = None
    cuboid: RoomCuboid | None = None
    metric: bool = True
    free_floor: NDArray[np.bool_] | None = None
    confidence: float = float("nan")
    face_confidence: NDArray[np.float64] = field(default_factory=lambda: np.full(5, np.nan))
    status: str = "ok"
    milliseconds: float | None = None

    @classmethod
    def nothing(
        cls, camera: CameraIntrinsics, status: str, milliseconds: float | None = None, names_furniture: bool = False
    ) -> Prediction:
        """Return the prediction of a method that has none for this frame: every pixel unknown, so wrong.

        `names_furniture` : the method says what furniture there is in other frames, so here it has missed it.
        """
        empty = np.zeros((camera.height, camera.width), np.uint8)
        furniture = empty if names_furniture else None
        return cls(layout=empty, labels=empty, furniture=furniture, status=status, milliseconds=milliseconds)

    @classmethod
    def of_estimate(
        cls,
        estimate: RoomEstimate,
        milliseconds: float | None = None,
        free_floor: NDArray[np.bool_] | None = None,
    ) -> Prediction:
        """Take over the estimator's result."""
        return cls(
            layout=estimate.layout,
            labels=estimate.labels,
            furniture=estimate.furniture,
            cuboid=estimate.cuboid,
            metric=estimate.metric,
            free_floor=free_floor,
            confidence=estimate.confidence,
            face_confidence=estimate.face_confidence,
            status=estimate.status.value,
            milliseconds=milliseconds,
        )
