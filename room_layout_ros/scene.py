"""One frame with its estimate and what is derived from it on demand, computed once for all outputs that want it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .core.config import EstimatorConfig
from .core.cuboids import ObjectCuboid, compute_object_cuboids
from .core.depth import DepthGeometry, compute_depth_geometry
from .core.estimate import RoomEstimate
from .core.floor_plane import FloorPlane
from .core.frame import RgbdFrame
from .core.freespace import FreeSpace, compute_free_space
from .core.labels import FLOOR
from .node_config import NodeConfig

_LEAST_PIXELS = 500
_STRIDE = 4
_BELOW_M, _BELOW_RAD = 0.15, np.deg2rad(6.0)
"""What is measured deeper below the given floor than this, and than this angle, is below any floor that depth would
take for the given one (core/floor_plane.py)."""
_BELOW_SHARE = 0.05
"""Of the measured pixels; noise and mirrors are less."""


@dataclass(frozen=True)
class Scene:
    """What the outputs are made of. `floor` is where the floor is expected, None where only the estimate can say."""

    frame: RgbdFrame
    estimate: RoomEstimate
    node: NodeConfig
    estimator: EstimatorConfig
    floor: FloorPlane | None = None

    @cached_property
    def geometry(self) -> DepthGeometry | None:
        """Geometry of the depth image; None without (enough) depth."""
        return compute_depth_geometry(self.frame, self.estimator)

    @cached_property
    def free_space(self) -> FreeSpace | None:
        """Free space of the frame; None without depth or floor."""
        if self.geometry is None:
            return None
        return compute_free_space(self.geometry, self.estimate, self.estimator, self.floor, self.frame.color)

    @cached_property
    def denies_floor(self) -> bool:
        """Whether depth that does not lie on the given floor is measured where that should be.

        Either floor is seen, by its label; or so much is measured through the given floor, below it, that there is
        none. Labels alone do not tell: with a wrong tilt they name a wall or the ceiling so, or nothing.
        """
        if self.geometry is None:
            return False
        seen = np.count_nonzero((self.estimate.labels == FLOOR) & (self.geometry.inverse_depth > 0))
        least = max(self.estimator.floor_min_share * self.estimate.labels.size, _LEAST_PIXELS)
        return bool(seen >= least) or self._sees_through(self.geometry)

    def _sees_through(self, geometry: DepthGeometry) -> bool:
        if self.floor is None or not np.isfinite(self.floor.distance_m):
            return False
        points = geometry.points(_STRIDE).reshape(-1, 3)
        points = points[np.isfinite(points[:, 2])].astype(np.float64)
        height_m = self.floor.distance_m - points @ self.floor.normal
        below = np.count_nonzero(height_m < -(_BELOW_M + np.tan(_BELOW_RAD) * points[:, 2]))
        return bool(below * _STRIDE**2 >= _LEAST_PIXELS and below >= _BELOW_SHARE * len(points))

    @cached_property
    def objects(self) -> tuple[ObjectCuboid, ...]:
        """Things in the room; none without depth or floor."""
        if self.geometry is None or self.free_space is None:
            return ()
        return compute_object_cuboids(self.geometry, self.estimate, self.free_space, self.estimator)

    @property
    def floor_frame(self) -> str:
        """Name of the frame on the floor below the camera."""
        return self.node.floor_below(self.frame.frame_id)
