"""Cameras that hang on their side or upside down: a frame is turned by quarters until down in the room is down in it.

Network and classifiers have seen upright pictures only, and free space takes what is lower in the picture for what is
lower in the room, or nearer on the floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .depth import DepthGeometry
from .estimate import RoomEstimate
from .frame import CameraIntrinsics, RgbdFrame
from .layout import RoomCuboid
from .tracking import TemporalPrior

_QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""What was right is down: a vector of the camera frame after its picture was turned to the left by a quarter."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Turns what belongs to a frame to the left, by 0 to 3 quarters; 0 change nothing."""

    quarters: int

    @classmethod
    def upright(cls, down: NDArray[np.float64]) -> Turn:
        """Return the turn after which `down` (3,), camera frame, is nearest to down in the picture."""
        quarters = 0
        while quarters < 3 and down[1] < abs(down[0]):
            down = _QUARTER @ down
            quarters += 1
        return cls(quarters)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) from the camera frame to that of the turned camera."""
        return np.linalg.matrix_power(_QUARTER, self.quarters)

    def image(self, image: NDArray[Any]) -> NDArray[Any]:
        """Turn (H, W, ...) pixels."""
        return np.ascontiguousarray(np.rot90(image, self.quarters))

    def camera(self, camera: CameraIntrinsics) -> CameraIntrinsics:
        """Return the camera of the turned picture."""
        for _ in range(self.quarters):
            c = camera
            camera = CameraIntrinsics(c.height, c.width, c.fy, c.fx, c.cy, c.width - 1 - c.cx)
        return camera

    def frame(self, frame: RgbdFrame) -> RgbdFrame:
        """Return the frame of the turned picture."""
        color = None if frame.color is None else self.image(frame.color)
        depth_m = None if frame.depth_m is None else self.image(frame.depth_m)
        return replace(frame, camera=self.camera(frame.camera), color=color, depth_m=depth_m)

    def prior(self, prior: TemporalPrior) -> TemporalPrior:
        """Return what was known before, in the frame of the turned camera."""
        R, gravity = prior.R_room_camera, prior.gravity
        return TemporalPrior(
            None if R is None else R @ self.rotation.T, None if gravity is None else self.rotation @ gravity
        )

    def geometry(self, geometry: DepthGeometry) -> DepthGeometry:
        """Return the geometry of the turned picture."""
        return DepthGeometry(self.camera(geometry.camera), self.image(geometry.inverse_depth), geometry.measured)

    def estimate(self, estimate: RoomEstimate) -> RoomEstimate:
        """Return the estimate of the turned picture, without its polygons."""
        R, cuboid = estimate.R_room_camera @ self.rotation.T, estimate.cuboid
        if cuboid is not None:
            cuboid = RoomCuboid(cuboid.R_room_camera @ self.rotation.T, cuboid.distances)
        return replace(
            estimate,
            layout=self.image(estimate.layout),
            labels=self.image(estimate.labels),
            furniture=self.image(estimate.furniture),
            superpixels=self.image(estimate.superpixels),
            R_room_camera=R,
            cuboid=cuboid,
            polygons=(),
        )

    def back(self, estimate: RoomEstimate) -> RoomEstimate:
        """Return the estimate of the picture before the turn, without its polygons."""
        return Turn(-self.quarters % 4).estimate(estimate)
