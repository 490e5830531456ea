"""A plane settled on the pixels of the floor, of one level, and held by what is expected where few pixels do.

In inverse depth w the plane n . P = d is linear, w = (n / d) . ray, and the noise of structured light and stereo is
even: the fit is weighted least squares over the pixels near the floor, with Tukey's weights so that what stands on the
floor does not pull. Planes are (3,) float64 n / d in the camera frame, 1/m.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..depth import NOISE_FLOOR_M, NOISE_QUADRATIC, depth_sigma
from ..labels import CLUTTER, FLOOR
from .floor_level import height_over
from .floor_noise import MIN_BAND_PIXELS
from .floor_step import FloorStep

HALF_WIDTHS_M = (0.10, 0.04, 0.03)
"""Of the band around the plane in each pass; the last looks at all pixels, those before at a quarter of them."""

_STRIDE = 2

_ONE_LEVEL_SHARE, _FARTHER_SHARE = 0.9, 0.67
"""Where less of the floor than this is near the plane (usual: 0.93 to 1), the plane runs through two levels, and is
fitted anew to the nearest third, on which the camera stands."""

_LARGE_FLOOR = 8
"""Times the least support: a smaller floor has no third to fit to."""

TURN_PER_M = np.deg2rad(40.0)
"""A start may be wrong by so much of a turn for each metre that its height may be wrong by."""

_CUBOID_RAD, _CUBOID_M = np.deg2rad(0.3), 0.015
"""How well the floor of the cuboid is known before the fit: it has the walls' right angles."""

_KNOWN_M, _KNOWN_RAD = 2.0 / 3.0, 0.5
"""Standard deviations of a start, as parts of how wrong it may be."""

_WORST_CONDITION = 1e9
"""Pixels on one line make no plane."""

_SHARED_PIXELS, _INVERSE_NOISE = 400.0, 0.0015
"""So many of the fit's pixels share an error (ripple, slow error) of this deviation, 1/m."""

NOTHING_EXPECTED = np.zeros((3, 4))

_GATHER_M = 0.35
"""Pixels farther above or below the start are no floor, however wrong the start is."""

_CLUTTER_WEIGHT = 0.3


def settle(
    pixels: NDArray[np.float32],
    coarse: int,
    intrinsics: tuple[float, ...],
    plane: NDArray[np.float64],
    half_widths_m: tuple[float, ...],
    least: int,
    held: NDArray[np.float64] = NOTHING_EXPECTED,
) -> tuple[NDArray[np.float64], int]:
    """Return the plane after its passes and the pixels of the image that support it; 0 if ever less than `least`.

    Parameters
    ----------
    pixels : (n, 4) float32 of `near_plane`; the first `coarse` of them are looked at before the last pass.
    intrinsics : fx, fy, cx, cy. plane : to begin with. held : (3, 4) float64 of `expected`.
    """
    support = 0
    for half_width in half_widths_m:
        last = half_width == half_widths_m[-1]
        sums, count = _floor_sums(pixels if last else pixels[:coarse], intrinsics, plane, half_width)
        support = int(count) * _STRIDE**2 * (1 if last else 4)
        if support < least:
            return plane, 0
        sums += held / (1 if last else 4)
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


def expected(normal: NDArray[np.float64], distance_m: float, tolerance_m: float | None) -> NDArray[np.float64]:
    """Return the normal equations (3, 4) of a start: as many pixels as would be as sure of the plane as it is.

    `tolerance_m` : how wrong its height may be; None for the floor of a cuboid.
    """
    turn_rad, height_m = _CUBOID_RAD, _CUBOID_M
    if tolerance_m is not None:
        turn_rad, height_m = _KNOWN_RAD * TURN_PER_M * tolerance_m, _KNOWN_M * tolerance_m
    n, d = normal, distance_m
    along = np.outer(n, n)
    weight = (d * d / height_m) ** 2 * along + (d / turn_rad) ** 2 * (np.eye(3) - along)
    return _SHARED_PIXELS * _INVERSE_NOISE**2 * np.column_stack([weight, weight @ n / d])


def on_one_level(
    pixels: NDArray[np.float32],
    coarse: int,
    intrinsics: tuple[float, ...],
    plane: NDArray[np.float64],
    support: int,
    least: int,
    held: NDArray[np.float64],
) -> tuple[NDArray[np.float64], int]:
    """Return the plane and its support; fitted anew where it runs through two levels."""
    if support < _LARGE_FLOOR * least:
        return plane, support
    floor, on_plane = _count_on_plane(pixels[:coarse], intrinsics, plane, HALF_WIDTHS_M[-1])
    if not floor or on_plane / floor >= _ONE_LEVEL_SHARE:
        return plane, support
    sure = pixels[:coarse][pixels[:coarse, 3] == 1.0]
    near = sure[sure[:, 2] >= np.quantile(sure[:, 2], _FARTHER_SHARE)]
    plane, _ = settle(near, len(near), intrinsics, plane, HALF_WIDTHS_M, MIN_BAND_PIXELS, held)
    return settle(pixels, coarse, intrinsics, plane, HALF_WIDTHS_M[1:], least, held)


def settle_before(
    step: FloorStep, pixels: NDArray[np.float32], coarse: int, intrinsics: tuple[float, ...], support: int
) -> tuple[NDArray[np.float64], int]:
    """Return the plane of the level before a step, fitted to its pixels, and its support."""
    distance_m = 1.0 / float(np.linalg.norm(step.plane))
    held = expected(step.plane * distance_m, distance_m, tolerance_m=None)
    plane, near = settle(pixels, coarse, intrinsics, step.plane, HALF_WIDTHS_M[1:], MIN_BAND_PIXELS, held)
    return (plane, near) if near else (step.plane, support)


@njit(cache=True, nogil=True)
def near_plane(inverse, labels, intrinsics, plane):  # type: ignore[no-untyped-def]
    """Pixels (n, 4) float32 near a plane: u, v, inverse depth, weight; first those of every fourth row and column, and
    how many these are.

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
