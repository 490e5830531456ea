"""The floor under the camera, fitted to the depth alone so that a thing of 3 cm on it stands out.

The plane of the cuboid is a compromise with walls and right angles; this one is not. In inverse depth w the plane
n . P = d is linear, w = (n / d) . ray, and the noise of structured light and stereo is even: the fit is weighted least
squares over the pixels near the floor, with Tukey's weights so that what stands on the floor does not pull. The noise
of the height is then measured on the floor itself, by distance: no sensor model is needed to tell noise from a thing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import NOISE_FLOOR_M, NOISE_QUADRATIC, DepthGeometry, depth_sigma
from .estimate import RoomEstimate
from .frame import CameraIntrinsics
from .labels import CLUTTER, FLOOR

BAND_M = 0.5
"""Width of the distance bands in which the noise is measured."""

TILE_PX = 64
"""Side of the image tiles in which the slow error of the sensor (ripple, radial error) is followed."""

_BANDS = 24
_STRIDE = 2
_PASSES_M = ((0.10, 4), (0.05, 4), (0.03, 4), (0.03, 2))
"""Half width of the band around the plane and pixel step of each pass."""

_MIN_SIGMA_M = 0.002
_MIN_BAND_PIXELS = 40
_MIN_TILE_PIXELS = 40
_HISTOGRAM_M = 0.001
_HISTOGRAM_BINS = 120
_MAD_TO_SIGMA = 1.4826


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
    offset_m : (rows, cols) float64 height that the sensor gives to the floor in each tile of `TILE_PX`: its slow error.
    pixels : how many support it (0: taken over from the prior as it is).
    source : of the start, with "+depth" where the depth image refined it.
    """

    normal: NDArray[np.float64]
    distance_m: float
    sigma_m: NDArray[np.float64]
    offset_m: NDArray[np.float64]
    pixels: int
    source: str


def fit_floor(
    geometry: DepthGeometry, estimate: RoomEstimate, config: EstimatorConfig, prior: FloorPlane | None = None
) -> FloorFit | None:
    """Fit the floor, starting from a prior, else from the floor of the cuboid.

    Parameters
    ----------
    geometry : DepthGeometry
    estimate : RoomEstimate
        Of the same frame; its labels say what may be floor.
    prior : FloorPlane, optional
        Kept as it is where no floor is in view.

    Returns
    -------
    FloorFit or None
        None where no floor is seen and no complete prior is given.
    """
    start = prior if prior is not None else _from_cuboid(estimate)
    if start is None:
        return None
    maybe = _may_be_floor(estimate)
    if np.isnan(start.distance_m):
        height = _height_along(geometry, maybe == 2, start.normal)
        if height is None:
            return None
        start = FloorPlane(start.normal, height, start.source)
    plane = start.normal / start.distance_m
    camera = geometry.camera
    intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
    least = max(int(config.floor_min_share * geometry.inverse_depth.size), 500)
    pixels = 0
    for half_width, step in _PASSES_M:
        sums, count = _floor_sums(geometry.inverse_depth, maybe, *intrinsics, plane, half_width, step)
        pixels = int(count) * step * step
        if pixels < least:
            return None if prior is None or np.isnan(prior.distance_m) else _as_given(prior, camera)
        plane = np.linalg.solve(sums[:, :3], sums[:, 3])
    length = float(np.linalg.norm(plane))
    flat = np.zeros(_tiles(camera.height, camera.width))
    sigma = _sigma_bands(_heights(geometry.inverse_depth, maybe, *intrinsics, plane, flat, _STRIDE), 1.0 / length)
    offset = _offsets(geometry.inverse_depth, maybe, *intrinsics, plane, sigma, _STRIDE)
    sigma = _sigma_bands(_heights(geometry.inverse_depth, maybe, *intrinsics, plane, offset, _STRIDE), 1.0 / length)
    return FloorFit(plane / length, 1.0 / length, sigma, offset, pixels, f"{start.source}+depth")


def _from_cuboid(estimate: RoomEstimate) -> FloorPlane | None:
    if estimate.cuboid is None or not estimate.metric or not np.isfinite(estimate.cuboid.distances[1]):
        return None
    return FloorPlane(estimate.cuboid.R_room_camera[1].copy(), float(estimate.cuboid.distances[1]), "cuboid")


def _may_be_floor(estimate: RoomEstimate) -> NDArray[np.uint8]:
    """(H, W) uint8: 2 labelled floor, 1 clutter (a rug, a mislabelled patch), 0 wall or ceiling."""
    table = np.zeros(8, np.uint8)
    table[[FLOOR, CLUTTER]] = 2, 1
    return table[estimate.labels]


def _height_along(geometry: DepthGeometry, floor: NDArray[np.bool_], normal: NDArray[np.float64]) -> float | None:
    seen = floor & (geometry.inverse_depth > 0)
    if seen.sum() < _MIN_BAND_PIXELS:
        return None
    rays = geometry.camera.rays()[seen]
    return float(np.median((rays @ normal) / geometry.inverse_depth[seen]))


def _as_given(prior: FloorPlane, camera: CameraIntrinsics) -> FloorFit:
    z = (np.arange(_BANDS) + 0.5) * BAND_M
    sigma = np.asarray(depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC)) * prior.distance_m / z
    flat = np.zeros(_tiles(camera.height, camera.width))
    return FloorFit(prior.normal, prior.distance_m, np.maximum(sigma, _MIN_SIGMA_M), flat, 0, prior.source)


def _tiles(height: int, width: int) -> tuple[int, int]:
    return -(-height // TILE_PX), -(-width // TILE_PX)


def _sigma_bands(counts: NDArray[np.int64], height: float) -> NDArray[np.float64]:
    """Standard deviation per band from the median |height|; bands without floor follow the model of the noise."""
    z = (np.arange(_BANDS) + 0.5) * BAND_M
    model = np.asarray(depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC)) * height / z
    total = counts.sum(axis=1)
    enough = total >= _MIN_BAND_PIXELS
    median = (np.argmax(np.cumsum(counts, axis=1) >= 0.5 * total[:, None], axis=1) + 0.5) * _HISTOGRAM_M
    measured = _MAD_TO_SIGMA * median
    ratio = float(np.median(measured[enough] / model[enough])) if enough.any() else 1.0
    return np.maximum(np.where(enough, measured, ratio * model), _MIN_SIGMA_M)


@njit(cache=True, nogil=True)
def _floor_sums(inverse, maybe, fx, fy, cx, cy, plane, half_width, stride):  # type: ignore[no-untyped-def]
    """Normal equations (3, 4) of w = plane . ray over pixels near the plane, Tukey's weights; and their number."""
    sums = np.zeros((3, 4))
    count = 0
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    height, width = inverse.shape
    for y in range(0, height, stride):
        ry = (y - cy) / fy
        for x in range(0, width, stride):
            w = inverse[y, x]
            if w <= 0.0 or maybe[y, x] == 0:
                continue
            rx = (x - cx) / fx
            expected = plane[0] * rx + plane[1] * ry + plane[2]
            if expected <= 0.0:
                continue
            h = d * (1.0 - expected / w)
            # The height of a pixel is as uncertain as its depth times the slope of its ray, d / Z.
            reach = half_width + 2.0 * depth_sigma(1.0 / w, NOISE_FLOOR_M, NOISE_QUADRATIC) * d * w
            u = h / reach
            if u * u >= 1.0:
                continue
            weight = (1.0 - u * u) ** 2
            if maybe[y, x] == 1:
                weight *= 0.3
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
def tile_offset(offset, u, v):  # type: ignore[no-untyped-def]
    """Offset of the floor at a pixel, bilinear between the middles of the tiles."""
    rows, cols = offset.shape
    y = min(max((v + 0.5) / TILE_PX - 0.5, 0.0), rows - 1.0)
    x = min(max((u + 0.5) / TILE_PX - 0.5, 0.0), cols - 1.0)
    i, j = min(int(y), max(rows - 2, 0)), min(int(x), max(cols - 2, 0))
    m, n = min(i + 1, rows - 1), min(j + 1, cols - 1)
    p, q = y - i, x - j
    top = offset[i, j] + q * (offset[i, n] - offset[i, j])
    return top + p * (offset[m, j] + q * (offset[m, n] - offset[m, j]) - top)


@njit(cache=True, nogil=True)
def _heights(inverse, maybe, fx, fy, cx, cy, plane, offset, stride):  # type: ignore[no-untyped-def]
    """Count |height| of pixels at or below the floor in mm bins, per distance band: things only stand above it."""
    counts = np.zeros((_BANDS, _HISTOGRAM_BINS), np.int64)
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    height, width = inverse.shape
    for y in range(0, height, stride):
        ry = (y - cy) / fy
        for x in range(0, width, stride):
            w = inverse[y, x]
            if w <= 0.0 or maybe[y, x] == 0:
                continue
            h = d * (1.0 - (plane[0] * ((x - cx) / fx) + plane[1] * ry + plane[2]) / w) - tile_offset(offset, x, y)
            k = int(abs(h) / _HISTOGRAM_M)
            band = int(1.0 / (w * BAND_M))
            if k < _HISTOGRAM_BINS and band < _BANDS and h <= 0.0:
                counts[band, k] += 1
    return counts


@njit(cache=True, nogil=True)
def _offsets(inverse, maybe, fx, fy, cx, cy, plane, sigma, stride):  # type: ignore[no-untyped-def]
    """Median height of the floor pixels within three sigma, per tile; at most one sigma, 0 where there are few."""
    height, width = inverse.shape
    rows, cols = (height + TILE_PX - 1) // TILE_PX, (width + TILE_PX - 1) // TILE_PX
    result = np.zeros((rows, cols))
    values = np.empty(TILE_PX * TILE_PX)
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    for i in range(rows):
        for j in range(cols):
            count, noise = 0, 0.0
            for y in range(i * TILE_PX, min((i + 1) * TILE_PX, height), stride):
                ry = (y - cy) / fy
                for x in range(j * TILE_PX, min((j + 1) * TILE_PX, width), stride):
                    w = inverse[y, x]
                    if w <= 0.0 or maybe[y, x] == 0:
                        continue
                    h = d * (1.0 - (plane[0] * ((x - cx) / fx) + plane[1] * ry + plane[2]) / w)
                    s = sigma[min(int(1.0 / (w * BAND_M)), _BANDS - 1)]
                    if abs(h) < 3.0 * s:
                        values[count] = h
                        noise += s
                        count += 1
            if count >= _MIN_TILE_PIXELS:
                noise /= count
                result[i, j] = min(max(np.median(values[:count]), -noise), noise)
    return result
