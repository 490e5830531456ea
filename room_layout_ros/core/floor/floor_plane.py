"""The floor under the camera, fitted to the depth alone so that a thing of 3 cm on it stands out.

The plane of the cuboid is a compromise with walls and right angles; this one is not. In inverse depth w the plane
n . P = d is linear, w = (n / d) . ray, and the noise of structured light and stereo is even: the fit is weighted least
squares over the pixels near the floor, with Tukey's weights so that what stands on the floor does not pull. The noise
of the height is then measured on the floor itself, by distance: no sensor model is needed to tell noise from a thing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..config import EstimatorConfig
from ..depth import NOISE_FLOOR_M, NOISE_QUADRATIC, DepthGeometry, depth_sigma
from ..estimate import RoomEstimate
from ..frame import CameraIntrinsics
from ..labels import CLUTTER, FLOOR
from .floor_level import height_over, level_of_camera
from .floor_noise import MIN_BAND_PIXELS, count_heights, sigma_bands, usual_sigma
from .floor_step import FloorStep, are_before, find_step
from .floor_support import holds_floor
from .slow_error import measure_slow_error, tiles

_STRIDE = 2
_HALF_WIDTHS_M = (0.10, 0.04, 0.03)
"""Of the band around the plane in each pass; the last looks at all pixels, those before at a quarter of them."""

_ONE_LEVEL_SHARE, _FARTHER_SHARE = 0.9, 0.67
"""Where less of the floor than this is near the plane (usual: 0.93 to 1), the plane runs through two levels, and is
fitted anew to the nearest third, on which the camera stands."""

_LARGE_FLOOR = 8
"""Times the least support: a smaller floor has no third to fit to."""

_CUBOID_RAD, _CUBOID_M = np.deg2rad(0.3), 0.015
"""How well the floor of the cuboid is known before the fit: it has the walls' right angles."""

_TOLERANCE_M, _TURN_PER_M = 0.15, np.deg2rad(40.0)
"""A start that is not given whole may be wrong by so much, and any by so much of a turn for each metre that its height
may be wrong by (`floor_tolerance_m`). Where the depth is farther from one that is given whole it shows another level,
and the start is kept."""

_KNOWN_M, _KNOWN_RAD = 2.0 / 3.0, 0.5
"""Standard deviations of a start, as parts of how wrong it may be."""

_WORST_CONDITION = 1e9
"""Pixels on one line make no plane."""

_SHARED_PIXELS, _INVERSE_NOISE = 400.0, 0.0015
"""So many of the fit's pixels share an error (ripple, slow error) of this deviation, 1/m."""

_NOTHING_EXPECTED = np.zeros((3, 4))

_GATHER_M = 0.35
"""Pixels farther above or below the start are no floor, however wrong the start is."""

_CLUTTER_WEIGHT = 0.3


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
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    plane = fit.normal / fit.distance_m
    level_m = level_of_camera(geometry.inverse_depth, estimate.labels, color, intrinsics, plane)
    if level_m == 0.0:
        return fit
    if not level_m < fit.distance_m:
        return None
    under = FloorPlane(fit.normal, fit.distance_m - level_m, start.source)
    return _fit(geometry, estimate.labels, config, under, _TOLERANCE_M)


def _fit_given(
    geometry: DepthGeometry, estimate: RoomEstimate, config: EstimatorConfig, prior: FloorPlane
) -> FloorFit:
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
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    plane = start.normal / start.distance_m
    pixels, coarse = _near_plane(geometry.inverse_depth, labels, intrinsics, plane)
    least = max(int(config.floor_min_share * geometry.inverse_depth.size), 500)
    expected = _expected(start, tolerance_m)
    plane, support = _settle(pixels, coarse, intrinsics, plane, _HALF_WIDTHS_M, least, expected)
    if not support:
        return None
    step = find_step(pixels[:coarse], intrinsics, plane)
    if step is None:
        held = _NOTHING_EXPECTED if tolerance_m is None else expected
        plane, support = _on_one_level(pixels, coarse, intrinsics, plane, support, least, held)
    else:
        before = are_before(pixels, intrinsics, step)
        pixels, coarse = pixels[before], int(before[:coarse].sum())
        plane, support = _settle_before(step, pixels, coarse, intrinsics, support)
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
    return bool(turned <= _TURN_PER_M * tolerance_m and abs(fit.distance_m - prior.distance_m) <= tolerance_m)


def _settle(
    pixels: NDArray[np.float32],
    coarse: int,
    intrinsics: tuple[float, ...],
    plane: NDArray[np.float64],
    half_widths_m: tuple[float, ...],
    least: int,
    expected: NDArray[np.float64] = _NOTHING_EXPECTED,
) -> tuple[NDArray[np.float64], int]:
    """Return the plane after its passes and the pixels of the image that support it; 0 if ever less than `least`.

    `expected` is what `_expected` makes of the start: normal equations (3, 4) that hold the plane where few pixels do.
    """
    support = 0
    for half_width in half_widths_m:
        last = half_width == half_widths_m[-1]
        sums, count = _floor_sums(pixels if last else pixels[:coarse], intrinsics, plane, half_width)
        support = int(count) * _STRIDE**2 * (1 if last else 4)
        if support < least:
            return plane, 0
        sums += expected / (1 if last else 4)
        if _is_line(sums[:, :3]):
            return plane, 0
        plane = np.linalg.solve(sums[:, :3], sums[:, 3])
    return plane, support


def _is_line(A: NDArray[np.float64]) -> bool:
    """Whether the normal equations (3, 3) are those of pixels on one line, which make no plane."""
    (a, b, c), (_, d, e), (_, _, f) = A.tolist()
    trace, det = a + d + f, a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    if 0.0 < trace**3 < 1e-2 * _WORST_CONDITION * det:  # an upper bound of the condition, for a tenth of the time
        return False
    return bool(np.linalg.cond(A) > _WORST_CONDITION)


def _expected(start: FloorPlane, tolerance_m: float | None) -> NDArray[np.float64]:
    """(3, 4) normal equations of the start: as many pixels as would be as sure of the plane as it is."""
    turn_rad, height_m = _CUBOID_RAD, _CUBOID_M
    if tolerance_m is not None:
        turn_rad, height_m = _KNOWN_RAD * _TURN_PER_M * tolerance_m, _KNOWN_M * tolerance_m
    n, d = start.normal, start.distance_m
    along = np.outer(n, n)
    weight = (d * d / height_m) ** 2 * along + (d / turn_rad) ** 2 * (np.eye(3) - along)
    return _SHARED_PIXELS * _INVERSE_NOISE**2 * np.column_stack([weight, weight @ n / d])


def _on_one_level(
    pixels: NDArray[np.float32],
    coarse: int,
    intrinsics: tuple[float, ...],
    plane: NDArray[np.float64],
    support: int,
    least: int,
    expected: NDArray[np.float64],
) -> tuple[NDArray[np.float64], int]:
    """Return the plane and its support; fitted anew where it runs through two levels."""
    if support < _LARGE_FLOOR * least:
        return plane, support
    floor, on_plane = _count_on_plane(pixels[:coarse], intrinsics, plane, _HALF_WIDTHS_M[-1])
    if not floor or on_plane / floor >= _ONE_LEVEL_SHARE:
        return plane, support
    sure = pixels[:coarse][pixels[:coarse, 3] == 1.0]
    near = sure[sure[:, 2] >= np.quantile(sure[:, 2], _FARTHER_SHARE)]
    plane, _ = _settle(near, len(near), intrinsics, plane, _HALF_WIDTHS_M, MIN_BAND_PIXELS, expected)
    return _settle(pixels, coarse, intrinsics, plane, _HALF_WIDTHS_M[1:], least, expected)


def _settle_before(
    step: FloorStep, pixels: NDArray[np.float32], coarse: int, intrinsics: tuple[float, ...], support: int
) -> tuple[NDArray[np.float64], int]:
    """Return the plane of the level before a step, fitted to its pixels, and its support."""
    distance = 1.0 / float(np.linalg.norm(step.plane))
    expected = _expected(FloorPlane(step.plane * distance, distance), tolerance_m=None)
    plane, near = _settle(pixels, coarse, intrinsics, step.plane, _HALF_WIDTHS_M[1:], MIN_BAND_PIXELS, expected)
    return (plane, near) if near else (step.plane, support)


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


@njit(cache=True, nogil=True)
def _near_plane(inverse, labels, intrinsics, plane):  # type: ignore[no-untyped-def]
    """Pixels (n, 4) float32 near the start: u, v, inverse depth, weight; first those of every fourth row and column.

    Those labelled floor, and with less weight clutter (a rug, a mislabelled patch); no wall, no ceiling.
    """
    fx, fy, cx, cy = intrinsics
    height, width = inverse.shape
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    fine = _STRIDE * 2
    pixels = np.empty((((height + 1) // _STRIDE) * ((width + 1) // _STRIDE), 4), np.float32)
    count, coarse = 0, 0
    for turn in range(2):
        for v in range(0, height, _STRIDE):
            expected_row = plane[1] * (v - cy) / fy + plane[2] - plane[0] * cx / fx
            on_row = v % fine == 0
            if turn == 0 and not on_row:
                continue
            first, step = (0, fine) if turn == 0 else ((_STRIDE, fine) if on_row else (0, _STRIDE))
            for u in range(first, width, step):
                w, label = inverse[v, u], labels[v, u]
                if w <= 0.0 or (label != FLOOR and label != CLUTTER):
                    continue
                expected = expected_row + plane[0] / fx * u
                noise = depth_sigma(1.0 / w, NOISE_FLOOR_M, NOISE_QUADRATIC) * d * w
                if expected > 0.0 and abs(d * (w - expected)) < (_GATHER_M + 4.0 * noise) * w:
                    pixels[count, 0], pixels[count, 1], pixels[count, 2] = u, v, w
                    pixels[count, 3] = 1.0 if label == FLOOR else _CLUTTER_WEIGHT
                    count += 1
        if turn == 0:
            coarse = count
    return pixels[:count], coarse


@njit(cache=True, nogil=True)
def _floor_sums(pixels, intrinsics, plane, half_width):  # type: ignore[no-untyped-def]
    """Normal equations (3, 4) of w = plane . ray over pixels near the plane, Tukey's weights; and their number."""
    fx, fy, cx, cy = intrinsics
    sums = np.zeros((3, 4))
    count = 0
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    for k in range(len(pixels)):
        rx, ry, w = (pixels[k, 0] - cx) / fx, (pixels[k, 1] - cy) / fy, pixels[k, 2]
        expected = plane[0] * rx + plane[1] * ry + plane[2]
        if expected <= 0.0:
            continue
        z = 1.0 / w
        h = d * (1.0 - expected * z)
        # The height of a pixel is as uncertain as its depth times the slope of its ray, d / Z.
        reach = half_width + 2.0 * depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC) * d * w
        u = h / reach
        if u * u >= 1.0:
            continue
        weight = pixels[k, 3] * (1.0 - u * u) ** 2
        count += 1
        sums[0, 0] += weight * rx * rx
        sums[0, 1] += weight * rx * ry
        sums[0, 2] += weight * rx
        sums[1, 1] += weight * ry * ry
        sums[1, 2] += weight * ry
        sums[2, 2] += weight
        sums[0, 3] += weight * rx * w
        sums[1, 3] += weight * ry * w
        sums[2, 3] += weight * w
    sums[1, 0], sums[2, 0], sums[2, 1] = sums[0, 1], sums[0, 2], sums[1, 2]
    return sums, count


@njit(cache=True, nogil=True)
def _count_on_plane(pixels, intrinsics, plane, half_width):  # type: ignore[no-untyped-def]
    """Pixels labelled floor, and those of them within a half width and twice the noise of the plane."""
    fx, fy, cx, cy = intrinsics
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    floor, on_plane = 0, 0
    for k in range(len(pixels)):
        if pixels[k, 3] != 1.0:
            continue
        floor += 1
        rx, ry, z = (pixels[k, 0] - cx) / fx, (pixels[k, 1] - cy) / fy, 1.0 / pixels[k, 2]
        h = height_over(plane, d, rx, ry, z)
        on_plane += abs(h) < half_width + 2.0 * depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC) * d / z
    return floor, on_plane
