"""The floor under the camera, fitted to the depth alone so that a thing of 3 cm on it stands out.

The plane of the cuboid is a compromise with walls and right angles; this one is not. From where the floor is expected a
plane is settled on its pixels (`plane_settling.py`). The noise of the height is then measured on the floor itself, by
distance: no sensor model is needed to tell noise from a thing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import EstimatorConfig
from ..depth import DepthGeometry
from ..estimate import RoomEstimate
from ..frame import CameraIntrinsics
from ..labels import FLOOR
from .floor_level import level_of_camera
from .floor_noise import MIN_BAND_PIXELS, count_heights, sigma_bands, usual_sigma
from .floor_step import are_before, find_step
from .floor_support import holds_floor
from .plane_settling import (
    HALF_WIDTHS_M,
    NOTHING_EXPECTED,
    TURN_PER_M,
    expected,
    near_plane,
    on_one_level,
    settle,
    settle_before,
)
from .slow_error import measure_slow_error, tiles

_TOLERANCE_M = 0.15
"""A start that is not given whole may be wrong by so much, one that is by `floor_tolerance_m`: where the depth is
farther from that it shows another level, and the start is kept."""


@dataclass(frozen=True, slots=True)
class FloorPlane:
    """Where the floor is expected, from anything but the depth image: TF, an IMU, parameters, the cuboid.

    Parameters
    ----------
    normal : (3,) float64
        Unit vector down in the camera frame (the direction of gravity).
    distance_m : float
        Height of the camera over the floor; NaN where only the direction is known (an IMU).
    source : str
        Where it is from, for diagnostics: "tf", "imu", "parameters", "cuboid".

    Raises
    ------
    ValueError
        When the normal is not of unit length or the height is not above 0.
    """

    normal: NDArray[np.float64]
    distance_m: float
    source: str = "parameters"

    def __post_init__(self) -> None:
        if self.normal.shape != (3,) or not abs(float(np.linalg.norm(self.normal)) - 1.0) < 1e-6:
            raise ValueError(f"floor normal is {self.normal.tolist()}; it must be a unit vector of three numbers")
        if self.distance_m <= 0 or np.isinf(self.distance_m):
            raise ValueError(f"camera height is {self.distance_m} m; it must be above 0 (NaN: not known)")


@dataclass(frozen=True, slots=True)
class FloorFit:
    """The floor as measured.

    Attributes
    ----------
    normal : (3,) float64 unit vector down, camera frame. distance_m : height of the camera over it.
    sigma_m : (24,) float64 standard deviation of the height of floor pixels, per `BAND_M` of depth Z.
    bias : (rows, cols) float64, 1/m, slow error of the inverse depth in the middle of each tile of `TILE_PX`, measured
        on the floor and smoothly carried on beyond it.
    source : of the start, with "+depth" where the depth image refined it.
    """

    normal: NDArray[np.float64]
    distance_m: float
    sigma_m: NDArray[np.float64]
    bias: NDArray[np.float64]
    source: str


def fit_floor(
    geometry: DepthGeometry,
    estimate: RoomEstimate,
    config: EstimatorConfig,
    prior: FloorPlane | None = None,
    color: NDArray[np.uint8] | None = None,
) -> FloorFit | None:
    """Fit the floor, starting from a prior, else from the floor of the cuboid.

    Parameters
    ----------
    geometry : DepthGeometry
    estimate : RoomEstimate
        Of the same frame; its labels say what may be floor.
    prior : FloorPlane, optional
        With a height it is kept as it is where no floor is in view or the depth shows another level.
    color : (H, W, 3) uint8, optional
        The picture; it tells a table from a drop.

    Returns
    -------
    FloorFit or None
        None where no floor is seen, or what is nearest may be a drop, and no complete prior is given.
    """
    start = prior if prior is not None else _from_cuboid(estimate)
    if start is None:
        return None
    if np.isnan(start.distance_m):
        height = _height_along(geometry, estimate.labels == FLOOR, start.normal)
        if height is None:
            return None
        start = FloorPlane(start.normal, height, start.source)
    if prior is not None and not np.isnan(prior.distance_m):
        return _fit_given(geometry, estimate, config, prior)
    fit = _fit(geometry, estimate.labels, config, start, _TOLERANCE_M if prior is not None else None)
    if fit is None:
        return None
    camera = geometry.camera
    intrinsics = camera.numbers
    plane = fit.normal / fit.distance_m
    level_m = level_of_camera(geometry.inverse_depth, estimate.labels, color, intrinsics, plane)
    if level_m == 0.0:
        return fit
    if not level_m < fit.distance_m:
        return None
    under = FloorPlane(fit.normal, fit.distance_m - level_m, start.source)
    return _fit(geometry, estimate.labels, config, under, _TOLERANCE_M)


def _fit_given(geometry: DepthGeometry, estimate: RoomEstimate, config: EstimatorConfig, prior: FloorPlane) -> FloorFit:
    """Refine a floor that is given whole: from that of the cuboid where it is the same, else from itself.

    As given where what is seen is another, or things alone: a plane that is a few degrees off runs through them.
    """
    seen, tolerance_m = _from_cuboid(estimate), config.floor_tolerance_m
    for start in (seen, prior):  # held loosely both: the cuboid's floor may be the other level of a step
        fit = None if start is None else _fit(geometry, estimate.labels, config, start, tolerance_m)
        if fit is None or not _is_near(fit, prior, tolerance_m):
            continue
        if holds_floor(fit.normal, fit.distance_m, geometry, estimate.labels):
            return replace(fit, source=f"{prior.source}+depth")
    return _as_given(prior, geometry.camera)


def _fit(
    geometry: DepthGeometry,
    labels: NDArray[np.uint8],
    config: EstimatorConfig,
    start: FloorPlane,
    tolerance_m: float | None,
) -> FloorFit | None:
    """Fit the floor from a start that has a height; None where it has too little support.

    `tolerance_m` : how wrong the start may be; None for the floor of a cuboid, which its walls hold, but which may lie
    between two levels.
    """
    camera = geometry.camera
    intrinsics = camera.numbers
    plane = start.normal / start.distance_m
    pixels, coarse = near_plane(geometry.inverse_depth, labels, intrinsics, plane)
    least = max(int(config.floor_min_share * geometry.inverse_depth.size), 500)
    start_held = expected(start.normal, start.distance_m, tolerance_m)
    plane, support = settle(pixels, coarse, intrinsics, plane, HALF_WIDTHS_M, least, start_held)
    if not support:
        return None
    step = find_step(pixels[:coarse], intrinsics, plane)
    if step is None:
        held = NOTHING_EXPECTED if tolerance_m is None else start_held
        plane, support = on_one_level(pixels, coarse, intrinsics, plane, support, least, held)
    else:
        before = are_before(pixels, intrinsics, step)
        pixels, coarse = pixels[before], int(before[:coarse].sum())
        plane, support = settle_before(step, pixels, coarse, intrinsics, support)
    if not support:
        return None
    length = float(np.linalg.norm(plane))
    flat = np.zeros(tiles(camera.height, camera.width))
    sigma = sigma_bands(count_heights(pixels[:coarse], intrinsics, plane, flat), 1.0 / length)
    bias = measure_slow_error(pixels, intrinsics, plane, sigma, flat.shape)
    sigma = sigma_bands(count_heights(pixels, intrinsics, plane, bias), 1.0 / length)
    return FloorFit(plane / length, 1.0 / length, sigma, bias, f"{start.source}+depth")


def _is_near(fit: FloorFit, prior: FloorPlane, tolerance_m: float) -> bool:
    """Whether a fit is the floor that was given, not another level."""
    turned = np.arccos(np.clip(fit.normal @ prior.normal, -1.0, 1.0))
    return bool(turned <= TURN_PER_M * tolerance_m and abs(fit.distance_m - prior.distance_m) <= tolerance_m)


def _from_cuboid(estimate: RoomEstimate) -> FloorPlane | None:
    if estimate.cuboid is None or not estimate.metric or not np.isfinite(estimate.cuboid.distances[1]):
        return None
    return FloorPlane(estimate.cuboid.R_room_camera[1].copy(), float(estimate.cuboid.distances[1]), "cuboid")


def _height_along(geometry: DepthGeometry, floor: NDArray[np.bool_], normal: NDArray[np.float64]) -> float | None:
    seen = floor & (geometry.inverse_depth > 0)
    if seen.sum() < MIN_BAND_PIXELS:
        return None
    rays = geometry.camera.rays()[seen]
    height = float(np.median((rays @ normal) / geometry.inverse_depth[seen]))
    return height if height > 0.0 else None  # that direction is not down


def _as_given(prior: FloorPlane, camera: CameraIntrinsics) -> FloorFit:
    flat = np.zeros(tiles(camera.height, camera.width))
    return FloorFit(prior.normal, prior.distance_m, usual_sigma(prior.distance_m), flat, prior.source)
