"""One frame with its estimate and what is derived from it on demand, computed once for all outputs that want it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

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
_NEAR_M, _NEAR_RAD = 0.15, np.deg2rad(6.0)
"""What is measured farther from the given floor than this, and than this angle, is another (core/floor_plane.py)."""
_BELOW_SHARE = 0.05
"""Of the measured pixels; noise and mirrors are less."""
_REACH_M = 5.0
_EXPECTED_SHARE = 0.15
"""Of the image, in which floor is expected within reach: few pixels may lie behind anything."""
_ON_M, _ON_RAD = 0.05, np.deg2rad(1.5)
_ON_FLOOR_SHARE = 0.5
"""Of those pixels. Of a wrong floor up to a third are near it by chance, where walls run through it."""


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
        return bool(seen >= least) or self._sees_through

    @cached_property
    def hides_floor(self) -> bool:
        """Whether depth is measured in much of the view of the given floor, and most of it is none.

        Things may stand before it, for a while; where floor never shows, it is not where it is said to be.
        """
        if self._over_floor is None:
            return False
        height_m, depth_m, floor_m = self._over_floor
        expected = (floor_m > 0.0) & (floor_m < _REACH_M)
        on_floor = np.count_nonzero(np.abs(height_m[expected]) < _ON_M + np.tan(_ON_RAD) * depth_m[expected])
        number = np.count_nonzero(expected) * _STRIDE**2
        return bool(
            number >= _EXPECTED_SHARE * self.estimate.labels.size and on_floor * _STRIDE**2 < _ON_FLOOR_SHARE * number
        )

    @cached_property
    def has_level_floor(self) -> bool:
        """Whether what is labelled floor lies level below the camera by the direction that is given."""
        if self.geometry is None or self.floor is None:
            return False
        points = self.geometry.points(_STRIDE)[self.estimate.labels[::_STRIDE, ::_STRIDE] == FLOOR].astype(np.float64)
        points = points[np.isfinite(points[:, 2])]
        if len(points) * _STRIDE**2 < _LEAST_PIXELS:
            return False
        along = points @ self.floor.normal
        height_m = float(np.median(along))
        level = np.abs(along - height_m) < _ON_M + np.tan(_ON_RAD) * points[:, 2]
        return height_m > 0.0 and bool(np.count_nonzero(level) >= _ON_FLOOR_SHARE * len(points))

    @cached_property
    def _sees_through(self) -> bool:
        """Whether so much is measured below the given floor that there is none."""
        if self._over_floor is None:
            return False
        height_m, depth_m, _ = self._over_floor
        below = np.count_nonzero(height_m < -(_NEAR_M + np.tan(_NEAR_RAD) * depth_m))
        return bool(below * _STRIDE**2 >= _LEAST_PIXELS and below >= _BELOW_SHARE * len(height_m))

    @cached_property
    def _over_floor(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
        """Of a grid of measured pixels: height over the given floor, depth, and that of the floor along the ray.

        The last is below 0 where the ray meets none. None without depth or a floor that is given whole.
        """
        if self.geometry is None or self.floor is None or not np.isfinite(self.floor.distance_m):
            return None
        points = self.geometry.points(_STRIDE).reshape(-1, 3).astype(np.float64)
        points = points[np.isfinite(points[:, 2])]
        along, depth_m = points @ self.floor.normal, points[:, 2]
        with np.errstate(divide="ignore"):
            floor_m = self.floor.distance_m / along * depth_m
        return self.floor.distance_m - along, depth_m, floor_m

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
