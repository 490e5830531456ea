"""What each pixel shows, by its height over the floor: floor, a thing on it, a wall of the room, a hole.

A pixel's height is h = d - n . P, its standard deviation that of the floor pixels at its depth. A row is sorted in
float32, a pass over it for each step, so that each runs on vectors; the few pixels that float32 cannot tell are left to
`exact_kind`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..labels import CLUTTER
from .floor_noise import PER_METRE, STEPS

NOTHING, FLOOR_PIXEL, OBSTACLE_PIXEL, WALL_PIXEL, HOLE_PIXEL, BEYOND_PIXEL, FLYING_PIXEL = range(7)
"""Kinds of pixels: not measured or over the robot, floor, thing, wall of the room, below the floor, beyond a wall,
between a near and a far surface: of neither, or of a level top that is seen flat."""

_ON_WALL_M = 0.02
_ON_WALL_SIGMAS = 3.0
_NEAR_M, _NEAR_GAIN = 1.7, 1.5
_FAR_M, _FAR_GAIN = 3.0, 0.8
"""Deviations by which the threshold is lower within `_NEAR_M` on the floor, and per metre of depth up to `_FAR_M`."""

_LOW = 3.0
"""A thing is low up to this many thresholds: its pixels raise the mean height of the cells behind their foot."""

_FLYING_M = 0.08
"""A pixel this far behind what is on its one side and before what is on its other is no thing: at an edge the sensor,
or who filled its holes, took the middle."""

BESIDE_PX = 2
"""A flying pixel is told by those so many columns beside it."""

_TINY = np.float32(1e-6)
"""Least inverse depth in 1/m: pixels without depth are computed too, and passed over later."""

DOWN = -1e-3
"""Rays that do not fall by more than this meet no floor."""

LOW_THING, HIGH_THING, UNSURE = 7, 8, 9
"""Kinds while a row is sorted: two kinds of things, and pixels that float32 cannot tell."""

_SURE = np.float32(1e-5)
"""Part of a threshold by which a pixel has to be away from it to be told in float32."""


@njit(cache=True, nogil=True, error_model="numpy")
def pixel_rays(T, intrinsics, v):  # type: ignore[no-untyped-def]
    """Rays of a row in floor axes (ahead, to the left, up): each that of pixel 0, and how much more per pixel."""
    fx, fy, cx, cy = intrinsics
    ry = (v - cy) / fy
    return (
        T[1, 0] * ry + T[2, 0] - T[0, 0] * cx / fx, T[0, 0] / fx,
        T[1, 1] * ry + T[2, 1] - T[0, 1] * cx / fx, T[0, 1] / fx,
        T[1, 2] * ry + T[2, 2] - T[0, 2] * cx / fx, T[0, 2] / fx,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def camera_height(T):  # type: ignore[no-untyped-def]
    """Height in m of the camera over the floor of `T_camera_floor`."""
    return -(T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3])


@njit(cache=True, nogil=True)
def narrow_limits(limits):  # type: ignore[no-untyped-def]
    """Limits in float32, the highest height rounded down: a float32 is above it where it is above that in float64."""
    lowest, factor, highest = limits
    highest_32 = np.float32(highest)
    highest_32 = highest_32 if highest_32 <= highest else np.nextafter(highest_32, np.float32(0.0))
    return np.float32(lowest), np.float32(factor), highest_32


@njit(cache=True, nogil=True)
def row_places(inverse, column, rays, distance, walls, places):  # type: ignore[no-untyped-def]
    """Write depth, height over the floor and how far before the nearest wall (inf without) the pixels of a row are."""
    ax0, ax1, ay0, ay1, az0, az1 = rays
    depth, high, inside = places
    _row_heights(inverse, column, np.float32(distance), np.float32(az0), np.float32(az1), depth, high)
    inside[:] = np.inf
    for k in range(len(walls)):
        a, b = walls[k, 0], walls[k, 1]
        out, out_per_px = np.float32(a * ax0 + b * ay0), np.float32(a * ax1 + b * ay1)
        _row_inside(depth, column, np.float32(walls[k, 2]), out, out_per_px, inside)


@njit(cache=True, nogil=True, error_model="numpy")
def sort_row(inverse, labels, column, rays, distance, places, noise_at, limits, scratch, kinds):  # type: ignore[no-untyped-def]
    """Write the kinds of a row of pixels, `UNSURE` where float32 cannot tell them.

    A pass over the row for each step, all float32: so each runs on vectors, which sort nearly all pixels.
    """
    ax0, ax1, ay0, ay1, az0, az1 = rays
    depth, high, inside = places
    lowest, factor, highest = limits
    noise, threshold, tolerance = scratch
    across = (np.float32(ax0), np.float32(ax1), np.float32(ay0), np.float32(ay1))
    _row_noise(depth, noise_at, noise)
    _row_thresholds(depth, column, noise, across, lowest, factor, threshold)
    _row_tolerances(depth, noise, np.float32(_ON_WALL_SIGMAS / distance), tolerance)
    _row_kinds(
        inverse, high, inside, labels, threshold, tolerance, column, np.float32(az0), np.float32(az1), highest, kinds
    )
    left, here, right = inverse[: -2 * BESIDE_PX], inverse[BESIDE_PX:-BESIDE_PX], inverse[2 * BESIDE_PX :]
    _row_edges(left, here, right, kinds[BESIDE_PX:-BESIDE_PX])


@njit(cache=True, nogil=True, error_model="numpy")
def exact_kind(h, z, x, y, az, inside, on_clutter, flies, noise_at, limits):  # type: ignore[no-untyped-def]
    """Kind of a pixel, in float64."""
    lowest, factor, distance = limits
    noise = noise_at[min(int(z * PER_METRE), STEPS - 1)]
    near = x * x + y * y < _NEAR_M * _NEAR_M
    gain = _NEAR_GAIN if near else _FAR_GAIN * min(max(_FAR_M - z, 0.0), _NEAR_GAIN)
    threshold = max(lowest, (factor - gain) * noise)
    if h <= threshold:
        floor = FLOOR_PIXEL if h > -threshold else HOLE_PIXEL
        return floor if az <= DOWN else NOTHING
    if flies:
        return FLYING_PIXEL
    tolerance = _ON_WALL_M + _ON_WALL_SIGMAS * noise * z / distance
    if inside < (-tolerance if on_clutter else tolerance):
        return WALL_PIXEL if inside >= -tolerance else BEYOND_PIXEL
    return LOW_THING if h < _LOW * threshold else HIGH_THING


@njit(cache=True, nogil=True)
def flies_between(left, here, right):  # type: ignore[no-untyped-def]
    """Whether a pixel hangs between a near and a far surface beside it, all inverse depths."""
    step = _FLYING_M * here * here
    if min(left, right) <= 0.0:
        return False
    return (left - here > step and here - right > step) or (right - here > step and here - left > step)


@njit(cache=True, nogil=True)
def _row_heights(inverse, column, distance, rise, rise_per_px, depth, high):  # type: ignore[no-untyped-def]
    """Write depth and height over the floor of a row of pixels; by itself, all float32, so that it runs on vectors."""
    for u in range(len(inverse)):
        depth[u] = np.float32(1.0) / (inverse[u] if inverse[u] > _TINY else _TINY)
        high[u] = distance + (rise + rise_per_px * column[u]) * depth[u]


@njit(cache=True, nogil=True)
def _row_inside(depth, column, reach, out, out_per_px, inside):  # type: ignore[no-untyped-def]
    """Lower `inside` of a row of pixels to how far they are before a wall."""
    for u in range(len(depth)):
        before = reach - (out + out_per_px * column[u]) * depth[u]
        inside[u] = before if before < inside[u] else inside[u]


@njit(cache=True, nogil=True)
def _row_noise(depth, noise_at, noise):  # type: ignore[no-untyped-def]
    """Write the noise of the height of a row of pixels, NaN where float32 cannot tell its step of depth: within a
    thousandth of a step of its ends.
    """
    for u in range(len(depth)):
        step = depth[u] * np.float32(PER_METRE)
        step = step if step < np.float32(STEPS - 1) else np.float32(STEPS - 1)
        k = np.int32(step)
        part = step - np.float32(k)
        sure = abs(part - np.float32(0.5)) < np.float32(0.499)
        noise[u] = noise_at[np.uint32(k)] if sure else np.float32(np.nan)


@njit(cache=True, nogil=True)
def _row_thresholds(depth, column, noise, rays, lowest, factor, threshold):  # type: ignore[no-untyped-def]
    """Write from which height on pixels of a row are things, NaN where that is not sure: at `_NEAR_M`, where it jumps.

    Near the camera a thing covers many more pixels than a ripple of the noise: a lower threshold does.
    """
    ax0, ax1, ay0, ay1 = rays
    near_m2, near_gain, far_gain = np.float32(_NEAR_M * _NEAR_M), np.float32(_NEAR_GAIN), np.float32(_FAR_GAIN)
    for u in range(len(depth)):
        z = depth[u]
        x, y = (ax0 + ax1 * column[u]) * z, (ay0 + ay1 * column[u]) * z
        before = x * x + y * y - near_m2
        nearer = np.float32(_FAR_M) - z
        nearer = nearer if nearer > np.float32(0.0) else np.float32(0.0)
        gain = far_gain * (nearer if nearer < near_gain else near_gain)
        gain = near_gain if before < np.float32(0.0) else gain
        limit = (factor - gain) * noise[u]
        limit = lowest if limit < lowest else limit
        threshold[u] = limit if abs(before) > np.float32(1e-4) else np.float32(np.nan)


@njit(cache=True, nogil=True)
def _row_tolerances(depth, noise, per_sigma, tolerance):  # type: ignore[no-untyped-def]
    """Write how far from a wall pixels of a row lie on it."""
    for u in range(len(depth)):
        tolerance[u] = np.float32(_ON_WALL_M) + per_sigma * noise[u] * depth[u]


@njit(cache=True, nogil=True)
def _row_kinds(inverse, high, inside, labels, threshold, tolerance, column, az, az_per_px, highest, kinds):  # type: ignore[no-untyped-def]
    """Write the kinds of a row of pixels, all float32, so that it runs on vectors."""
    for u in range(len(kinds)):
        h, limit, before, on_wall = high[u], threshold[u], inside[u], tolerance[u]
        down = az + az_per_px * column[u]
        floor = FLOOR_PIXEL if h > -limit else HOLE_PIXEL
        floor = floor if down <= np.float32(DOWN) else NOTHING
        thing = LOW_THING if h < np.float32(_LOW) * limit else HIGH_THING
        wall = WALL_PIXEL if before >= -on_wall else BEYOND_PIXEL
        thing = wall if before < (-on_wall if labels[u] == CLUTTER else on_wall) else thing
        sure = (abs(abs(h) - limit) > _SURE * limit) & (abs(h - np.float32(_LOW) * limit) > _SURE * limit)
        sure &= (abs(abs(before) - on_wall) > _SURE * on_wall) & (abs(down - np.float32(DOWN)) > _SURE)
        kind = (thing if h > limit else floor) if sure else UNSURE
        kinds[u] = kind if (inverse[u] > np.float32(0.0)) & (h <= highest) else NOTHING


@njit(cache=True, nogil=True)
def _row_edges(left, here, right, kinds):  # type: ignore[no-untyped-def]
    """Things and walls may be flying pixels where the depth falls or rises through them: not sure.

    By a little less than `_FLYING_M`, for float32.
    """
    for u in range(len(here)):
        step = np.float32(0.99 * _FLYING_M) * here[u] * here[u]
        from_left, to_right = left[u] - here[u], here[u] - right[u]
        hangs = (min(from_left, to_right) > step) | (max(from_left, to_right) < -step)
        kinds[u] = UNSURE if hangs & (kinds[u] >= WALL_PIXEL) & (kinds[u] != HOLE_PIXEL) else kinds[u]
