"""A ray caster of another making than `datasets/synthetic`, with which it shares nothing: round and inclined solids.

Boxes, cylinders and ellipsoids in any pose; glass and mirrors. World frame: x and y level, z up, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics

BOX, CYLINDER, ELLIPSOID = range(3)
FLOOR, RAMP, WALL, CEILING, THING = range(5)
MATTE, GLASS, MIRROR, BLACK = range(4)
"""How light and depth sensors take it; what is black has a colour but no depth."""

PLAIN, PLANKS, TILES, CARPET = range(4)
CLEAR, TAKEN, SLOPE, OTHER_LEVEL = range(4)

STEP_M = 0.05
"""Floor is of another level from here on."""

_PASSES = 4
_SAMPLES = 3


class Solids(NamedTuple):
    """What a world is made of: n solids.

    Attributes
    ----------
    shape : (n,) int64, BOX, CYLINDER (about its third axis), ELLIPSOID. role, optics, pattern : (n,) int64, see above.
    centre, half : (n, 3) float64 middle, and half sizes or radii. reach : (n,) radius of a ball that holds it.
    axes : (n, 3, 3) float64, rows are its axes in the world. color : (n, 3) float64 RGB 0..1. seed : (n,) int64.
    thing : (n,) int64, index of the thing that it is a part of.
    """

    shape: NDArray[np.int64]
    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    half: NDArray[np.float64]
    reach: NDArray[np.float64]
    role: NDArray[np.int64]
    optics: NDArray[np.int64]
    color: NDArray[np.float64]
    pattern: NDArray[np.int64]
    seed: NDArray[np.int64]
    thing: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Picture:
    """What a camera sees.

    Attributes
    ----------
    radiance : (H, W, 3) float32 0..255. depth_m : (H, W) float32 along the optical axis, through glass and, in mirrors,
        to the mirrored surface; inf where nothing is.
    solid, surface_m : (H, W) int32 index (-1: none) and float32 depth of the first surface, glass and mirrors too.
    normal : (H, W, 3) float32 of it, towards the camera, camera frame.
    """

    radiance: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    solid: NDArray[np.int32]
    surface_m: NDArray[np.float32]
    normal: NDArray[np.float32]


def look(solids: Solids, camera: CameraIntrinsics, pose: NDArray[np.float64], lamp: NDArray[np.float64]) -> Picture:
    """Render. `pose` : (4, 4) T_world_camera. `lamp` : (4,) float64 place and power of the only lamp."""
    light, depth, solid, surface, normal = _render(solids, pose, _numbers(camera), lamp)
    exposure = 0.62 / max(float(np.percentile(light.mean(axis=2), 70)), 1e-6)
    radiance = (255 * np.clip(light * exposure, 0, 1) ** (1 / 1.9)).astype(np.float32)
    return Picture(radiance, depth, solid, surface, (normal @ pose[:3, :3]).astype(np.float32))


def what_stands(solids: Solids, x: NDArray[np.float64], y: NDArray[np.float64], height_m: float) -> Any:
    """Look up from n places of the floor.

    Returns
    -------
    state : (n,) uint8, TAKEN where a thing or a wall is below `height_m`, else SLOPE on a ramp, OTHER_LEVEL where the
        floor is `STEP_M` or more from 0 or there is none, else CLEAR.
    solid : (n,) int32, the lowest that takes the place; -1 elsewhere. ground_m : (n,) float64 height of the floor.
    """
    return _columns(solids, x, y, height_m)


def pixels_of(
    solids: Solids, camera: CameraIntrinsics, pose: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the (n,) flat index of the pixel that shows each of (n, 3) points in the world, -1 where it is hidden."""
    return np.asarray(_sight(solids, pose, _numbers(camera), points))


def _numbers(camera: CameraIntrinsics) -> tuple[int, int, float, float, float, float]:
    return camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy


@njit(cache=True, nogil=True)
def _turn(R, v):  # type: ignore[no-untyped-def]
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@njit(cache=True, nogil=True)
def _ahead(o, d, t):  # type: ignore[no-untyped-def]
    return (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])


@njit(cache=True, nogil=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def _span(shape, centre, axes, half, o, d):  # type: ignore[no-untyped-def]
    """Where the line o + t d enters and leaves a solid, and by which side: axis 0-2, or 3 where it is round."""
    miss = (1.0, -1.0, -1)
    p, q = _turn(axes, (o[0] - centre[0], o[1] - centre[1], o[2] - centre[2])), _turn(axes, d)
    first, last, side = -np.inf, np.inf, -1
    if shape != BOX:
        a, b, c = 0.0, 0.0, -1.0
        for k in range(3 if shape == ELLIPSOID else 2):
            u, v = p[k] / half[k], q[k] / half[k]
            a, b, c = a + v * v, b + u * v, c + u * u
        if a > 1e-12:
            if b * b <= a * c:
                return miss
            root = np.sqrt(b * b - a * c)
            first, last, side = (-b - root) / a, (-b + root) / a, 3
        elif c > 0:
            return miss
    if shape != ELLIPSOID:
        for k in range(2 if shape == CYLINDER else 0, 3):
            if abs(q[k]) < 1e-12:
                if abs(p[k]) > half[k]:
                    return miss
                continue
            middle, away = -p[k] / q[k], half[k] / abs(q[k])
            if middle - away > first:
                first, side = middle - away, k
            last = min(last, middle + away)
    return first, last, side


@njit(cache=True, nogil=True)
def _nearest(solids, o, d, limit, any_will_do):  # type: ignore[no-untyped-def]
    """The first solid that a ray enters before `limit`, and by which side; or any, which glass is not."""
    best, found, by = limit, -1, -1
    length = _dot(d, d)
    for k in range(len(solids.shape)):
        centre, reach = solids.centre[k], solids.reach[k] ** 2
        to = (centre[0] - o[0], centre[1] - o[1], centre[2] - o[2])
        along, away = _dot(to, d), _dot(to, to)
        if away > reach and (along <= 0 or away * length - along * along > reach * length):
            continue
        if any_will_do and solids.optics[k] == GLASS:
            continue
        first, last, side = _span(solids.shape[k], centre, solids.axes[k], solids.half[k], o, d)
        if last > first and 1e-4 < first < best:
            best, found, by = first, k, side
            if any_will_do:
                break
    return best, found, by


@njit(cache=True, nogil=True)
def _normal(solids, k, side, point, d):  # type: ignore[no-untyped-def]
    """Unit normal of a surface that looks against d, world frame."""
    c, h, axes = solids.centre[k], solids.half[k], solids.axes[k]
    p = _turn(axes, (point[0] - c[0], point[1] - c[1], point[2] - c[2]))
    n = (
        p[0] / h[0] ** 2 if side == 3 else 1.0 * (side == 0),
        p[1] / h[1] ** 2 if side == 3 else 1.0 * (side == 1),
        (p[2] / h[2] ** 2 if solids.shape[k] == ELLIPSOID else 0.0) if side == 3 else 1.0 * (side == 2),
    )
    n = _turn(axes.T, n)
    scale = 1.0 / np.sqrt(_dot(n, n))
    if _dot(n, d) > 0:
        scale = -scale
    return (scale * n[0], scale * n[1], scale * n[2])


@njit(cache=True, nogil=True)
def _render(solids, pose, camera, lamp):  # type: ignore[no-untyped-def]
    width, height, fx, fy, cx, cy = camera
    light = np.zeros((height, width, 3))
    depth = np.full((height, width), np.inf, np.float32)
    surface = np.full((height, width), np.inf, np.float32)
    solid = np.full((height, width), -1, np.int32)
    normal = np.zeros((height, width, 3))
    eye = (pose[0, 3], pose[1, 3], pose[2, 3])
    for v in range(height):
        for u in range(width):
            for s in range(_SAMPLES):
                ju, jv = (0.0, 0.0) if s == 0 else (_hash(u, v, s, 1) - 0.5, _hash(u, v, s, 2) - 0.5)
                o, d = eye, _turn(pose, ((u + ju - cx) / fx, (v + jv - cy) / fy, 1.0))
                gone, clear = 0.0, 1.0
                for turn in range(_PASSES):
                    t, k, side = _nearest(solids, o, d, np.inf, False)
                    if k < 0:
                        light[v, u] += clear
                        break
                    o = _ahead(o, d, t)
                    gone += t
                    n = _normal(solids, k, side, o, d)
                    if s == 0 and turn == 0:
                        surface[v, u], solid[v, u] = gone, k
                        normal[v, u, 0], normal[v, u, 1], normal[v, u, 2] = n
                    if solids.optics[k] == GLASS:
                        clear *= 0.9
                        light[v, u] += 0.02
                    elif solids.optics[k] == MIRROR:
                        clear *= 0.9
                        d = _ahead(d, n, -2.0 * _dot(d, n))
                    else:
                        if s == 0:
                            depth[v, u] = gone
                        jitter = _hash(u, v, s, 3) - 0.5, _hash(u, v, s, 4) - 0.5
                        bright = clear * _texture_of(solids, k, side, o) * _lit(solids, o, n, lamp, jitter)
                        light[v, u] += bright * solids.color[k]
                        break
    return light / _SAMPLES, depth, solid, surface, normal


@njit(cache=True, nogil=True)
def _lit(solids, point, n, lamp, jitter):  # type: ignore[no-untyped-def]
    """Light of the lamp, 70 cm wide, where nothing shades it, and of all around."""
    to = (lamp[0] + 0.7 * jitter[0] - point[0], lamp[1] + 0.7 * jitter[1] - point[1], lamp[2] - point[2])
    around, square = 0.4 + 0.1 * n[2], _dot(to, to)
    facing = _dot(n, to) / np.sqrt(square)
    if facing <= 0 or _nearest(solids, _ahead(point, n, 1e-3), to, 0.97, True)[1] >= 0:
        return around
    return around + lamp[3] * facing / (0.6 + square)


@njit(cache=True, nogil=True)
def _hash(i, j, k, seed):  # type: ignore[no-untyped-def]
    n = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791) ^ (seed * 2654435761)
    n = (n ^ (n >> 13)) * 1274126177
    return ((n ^ (n >> 16)) & 0xFFFF) / 65535.0


@njit(cache=True, nogil=True)
def _cloudy(x, y, z, seed):  # type: ignore[no-untyped-def]
    """Value noise with features of 1, -0.5..0.5."""
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    f, g, h = x - i, y - j, z - k
    total = -0.5
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (f if a else 1 - f) * (g if b else 1 - g) * (h if c else 1 - h)
                total += share * _hash(i + a, j + b, k + c, seed)
    return total


@njit(cache=True, nogil=True)
def _texture_of(solids, k, side, point):  # type: ignore[no-untyped-def]
    """Brightness about 1 at a point of a surface; x and y run along it where it is flat."""
    c, seed, pattern = solids.centre[k], solids.seed[k], solids.pattern[k]
    x, y, z = _turn(solids.axes[k], (point[0] - c[0], point[1] - c[1], point[2] - c[2]))
    if side == 0:
        x, y, z = y, z, x
    elif side == 1:
        y, z = z, y
    fine = _cloudy(60 * x, 60 * y, 60 * z, seed)
    grain = 1 + 0.08 * _cloudy(3 * x, 3 * y, 3 * z, seed) + 0.06 * fine
    if pattern == CARPET:
        return grain + 0.4 * fine
    if pattern == PLAIN:
        return grain
    long, wide = (1.2, 0.12) if pattern == PLANKS else (0.33, 0.33)
    row = int(np.floor(y / wide))
    shift = _hash(row, 1, 2, seed) if pattern == PLANKS else 0.0
    column = int(np.floor(x / long + shift))
    joint = y / wide - row < 0.03 or (x / long + shift - column) * long < 0.006
    return (grain + 0.3 * (_hash(row, column, 5, seed) - 0.5)) * (0.6 if joint else 1.0)


@njit(cache=True, nogil=True)
def _columns(solids, x, y, height_m):  # type: ignore[no-untyped-def]
    n = len(x)
    state, solid, ground = np.zeros(n, np.uint8), np.full(n, -1, np.int32), np.full(n, -np.inf)
    for i in range(n):
        lowest, slope = np.inf, False
        for k in range(len(solids.shape)):
            c = solids.centre[k]
            if (c[0] - x[i]) ** 2 + (c[1] - y[i]) ** 2 > solids.reach[k] ** 2:
                continue
            column = (x[i], y[i], 0.0)
            low, high, _ = _span(solids.shape[k], c, solids.axes[k], solids.half[k], column, (0.0, 0.0, 1.0))
            if high <= low:
                continue
            if solids.role[k] <= RAMP:
                slope = slope or (solids.role[k] == RAMP and high > 0.0)
                ground[i] = max(ground[i], high)
            elif high > 0.005 and low < min(height_m, lowest):
                lowest, solid[i] = low, k
        if solid[i] >= 0:
            state[i] = TAKEN
        elif slope:
            state[i] = SLOPE
        elif abs(ground[i]) > STEP_M - 1e-6:
            state[i] = OTHER_LEVEL
    return state, solid, ground


@njit(cache=True, nogil=True)
def _sight(solids, pose, camera, points):  # type: ignore[no-untyped-def]
    width, height, fx, fy, cx, cy = camera
    eye = (pose[0, 3], pose[1, 3], pose[2, 3])
    pixel = np.full(len(points), -1, np.int64)
    for i in range(len(points)):
        d = (points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2])
        p = _turn(pose[:3, :3].T, d)
        if p[2] < 0.05:
            continue
        u, v = int(np.rint(p[0] / p[2] * fx + cx)), int(np.rint(p[1] / p[2] * fy + cy))
        if 0 <= u < width and 0 <= v < height and _nearest(solids, eye, d, 0.998, False)[1] < 0:
            pixel[i] = v * width + u
    return pixel
