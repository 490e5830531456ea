"""Whether the depth image speaks against a floor that is given by TF, an IMU or parameters."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .core.config import EstimatorConfig
from .core.depth import DepthGeometry
from .core.floor.floor_plane import FloorPlane
from .core.floor.floor_support import LEAST_PIXELS, STRIDE, labelled_points, lies_on
from .core.labels import FLOOR

_NEAR_M, _NEAR_RAD = 0.15, np.deg2rad(6.0)
"""What is measured farther from the given floor than this, and than this angle, is another (`floor_plane.py`)."""
_BELOW_SHARE = 0.05
"""Of the measured pixels; noise and mirrors are less."""
_REACH_M = 5.0
_EXPECTED_SHARE = 0.15
"""Of the image, in which floor is expected within reach: few pixels may lie behind anything."""
_ON_FLOOR_SHARE = 0.5
"""Of those pixels. Of a wrong floor up to a third are near it by chance, where walls run through it."""


class FloorCheck:
    """What the depth of a frame says of a floor that is given.

    Parameters
    ----------
    geometry : DepthGeometry
        Of the frame.
    labels : (H, W) uint8
        Of the estimate.
    floor : FloorPlane or None
        As given; with a NaN height only its direction.
    config : EstimatorConfig
    """

    def __init__(
        self,
        geometry: DepthGeometry,
        labels: NDArray[np.uint8],
        floor: FloorPlane | None,
        config: EstimatorConfig,
    ) -> None:
        self._geometry, self._labels, self._floor, self._config = geometry, labels, floor, config

    @property
    def denies_floor(self) -> bool:
        """Whether depth that does not lie on the given floor is measured where that should be.

        Either floor is seen elsewhere, by its label; or so much is measured through the given floor, below it, that
        there is none. Labels alone do not tell: with a wrong tilt they name a wall or the ceiling so, or nothing.
        """
        return self._is_elsewhere or self._sees_through

    @property
    def hides_floor(self) -> bool:
        """Whether depth is measured in much of the view of the given floor, and most of it is none.

        Things may stand before it, for a while; where floor never shows, it is not where it is said to be.
        """
        if self._over_floor is None:
            return False
        height_m, depth_m, floor_m = self._over_floor
        expected = (floor_m > 0.0) & (floor_m < _REACH_M)
        on_floor = np.count_nonzero(lies_on(height_m[expected], depth_m[expected]))
        number = np.count_nonzero(expected)
        much = number * STRIDE**2 >= _EXPECTED_SHARE * self._labels.size
        return bool(much and on_floor < _ON_FLOOR_SHARE * number)

    @property
    def has_level_floor(self) -> bool:
        """Whether what is labelled floor lies level below the camera by the direction that is given."""
        if self._floor is None:
            return False
        points = self._labelled
        if len(points) * STRIDE**2 < LEAST_PIXELS:
            return False
        along = points @ self._floor.normal
        height_m = float(np.median(along))
        level = lies_on(along - height_m, points[:, 2])
        return height_m > 0.0 and bool(np.count_nonzero(level) >= _ON_FLOOR_SHARE * len(points))

    @cached_property
    def _labelled(self) -> NDArray[np.float64]:
        return labelled_points(self._geometry, self._labels, FLOOR)

    @property
    def _is_elsewhere(self) -> bool:
        """Whether floor is labelled, and most of it does not lie on the given one."""
        points = self._labelled
        least = max(self._config.floor_min_share * self._labels.size, LEAST_PIXELS)
        if self._floor is None or len(points) * STRIDE**2 < least:
            return False
        on = lies_on(self._floor.distance_m - points @ self._floor.normal, points[:, 2])
        return bool(np.count_nonzero(on) < _ON_FLOOR_SHARE * len(points))

    @property
    def _sees_through(self) -> bool:
        """Whether so much is measured below the given floor that there is none."""
        if self._over_floor is None:
            return False
        height_m, depth_m, _ = self._over_floor
        below = np.count_nonzero(height_m < -(_NEAR_M + np.tan(_NEAR_RAD) * depth_m))
        return bool(below * STRIDE**2 >= LEAST_PIXELS and below >= _BELOW_SHARE * len(height_m))

    @cached_property
    def _over_floor(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
        """Of a grid of measured pixels: height over the given floor, depth, and that of the floor along the ray.

        The last is below 0 where the ray meets none. None without a floor that is given whole.
        """
        if self._floor is None or not np.isfinite(self._floor.distance_m):
            return None
        points = self._geometry.points(STRIDE).reshape(-1, 3).astype(np.float64)
        points = points[np.isfinite(points[:, 2])]
        along, depth_m = points @ self._floor.normal, points[:, 2]
        with np.errstate(divide="ignore"):
            floor_m = self._floor.distance_m / along * depth_m
        return self._floor.distance_m - along, depth_m, floor_m
