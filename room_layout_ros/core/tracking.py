"""What one frame may hand to the next. The estimator keeps no state: its caller passes this value on, or does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .estimate import RoomEstimate, Status


@dataclass(frozen=True, slots=True)
class TemporalPrior:
    """Knowledge from before the frame.

    Attributes
    ----------
    R_room_camera : (3, 3) float64 or None, the room's axes in the previous frame (warm start).
    gravity : (3,) float64 or None, direction of gravity in the camera frame (TF or IMU), any length.
    """

    R_room_camera: NDArray[np.float64] | None = None
    gravity: NDArray[np.float64] | None = None


def next_prior(estimate: RoomEstimate) -> TemporalPrior:
    """Return the prior for the next frame; an estimate without axes hands on nothing."""
    found = estimate.status in (Status.OK, Status.DEADLINE)  # the axes come before what a deadline cuts short
    return TemporalPrior(estimate.R_room_camera if found else None)
