"""Colours of what the rays hit: patterns, lamps, soft contact shadows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics

from .raster import Rectangles
from .shapes import Solid, Surface

_LAMP_RANGE_M = 3.0
_SHADOW_M = 0.13
_TALL_M = 0.4


@dataclass(frozen=True, slots=True)
class Light:
    """Ambient share and lamps: (m, 4) float64 x, y, z, strength."""

    ambient: float
    lamps: NDArray[np.float64]


def shade(
    surfaces: Sequence[Surface],
    solids: Sequence[Solid],
    rectangles: Rectangles,
    light: Light,
    camera: CameraIntrinsics,
    T_world_camera: NDArray[np.float64],
    index: NDArray[np.int32],
    depth_m: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return (H, W, 3) float32 linear colours, about 0..255, not yet clipped."""
    looks = np.array(
        [
            [
                m.pattern,
                *m.color,
                *m.second,
                m.scale_m,
                m.seed % 65536,
                s.thing,
                np.linalg.norm(s.u),
                np.linalg.norm(s.v),
            ]
            for s in surfaces
            for m in (s.material,)
        ],
        dtype=np.float64,
    )
    boxes = np.array(
        [
            [s.x, s.y, *s.axes[0], s.size_x / 2, s.size_y / 2, s.bottom, s.top, s.thing]
            for s in solids
        ],
        dtype=np.float64,
    ).reshape(-1, 9)  # fmt: skip
    color = np.zeros((*index.shape, 3), np.float32)
    pose = np.ascontiguousarray(T_world_camera[:3])
    K = camera.numbers
    _shade_kernel(index, depth_m, rectangles, looks, boxes, light.lamps, light.ambient, pose, K, color)
    return color


@njit(cache=True, nogil=True)
def _hash(i, j, seed):  # type: ignore[no-untyped-def]
    """Repeatable number in 0..1 of a lattice point."""
    # Masks instead of uint32: the same with and without the compiler.
    h = (i * 374761393 + j * 668265263 + seed * 2147483647) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65535.0


@njit(cache=True, nogil=True)
def _noise(s, t, seed):  # type: ignore[no-untyped-def]
    """Smooth noise 0..1 with features of size 1."""
    i, j = int(np.floor(s)), int(np.floor(t))
    a, b = s - i, t - j
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    top = _hash(i, j, seed) * (1 - a) + _hash(i + 1, j, seed) * a
    low = _hash(i, j + 1, seed) * (1 - a) + _hash(i + 1, j + 1, seed) * a
    return top * (1 - b) + low * b


@njit(cache=True, nogil=True)
def _soft(x):  # type: ignore[no-untyped-def]
    return min(1.0, max(0.0, x))


@njit(cache=True, nogil=True)
def _pattern(kind, s, t, w, h, scale, seed, px):  # type: ignore[no-untyped-def]
    """Share of the second colour and brightness at (s, t) metres on a rectangle of w x h; px = metres per pixel."""
    mix, bright = 0.0, 1.0
    if kind == 0:  # plain paint, a little uneven
        bright = 0.97 + 0.06 * _noise(s * 1.3, t * 1.3, seed)
    elif kind == 1:  # tiles with joints
        i, j = np.floor(s / scale), np.floor(t / scale)
        edge = min(min(s / scale - i, 1 - (s / scale - i)), min(t / scale - j, 1 - (t / scale - j))) * scale
        mix = _soft((0.005 + px * 0.5 - edge) / px) * _soft(0.01 / px)
        bright = 0.95 + 0.1 * _hash(int(i), int(j), seed)
    elif kind == 2:  # planks
        i = np.floor(s / scale)
        j = np.floor(t / (scale * 9) + 0.5 * (int(i) % 2) + _hash(int(i), 7, seed))
        edge = min(s / scale - i, 1 - (s / scale - i)) * scale
        mix = 0.35 * _noise(s * 90, t * 4, seed) * _soft(0.012 / px) + 0.8 * _soft((0.002 + px - edge) / px) * _soft(
            0.004 / px
        )
        bright = 0.86 + 0.24 * _hash(int(i), int(j), seed)
    elif kind == 3:  # carpet, cloth
        fade = _soft(scale / px)
        mix = fade * (0.7 * _hash(int(s / scale), int(t / scale), seed)) + (1 - fade) * 0.35
        bright = 0.94 + 0.12 * _noise(s * 6, t * 6, seed)
    elif kind == 4:  # window: frame, bars, a bright outside
        bar = min(min(min(s, w - s), min(t, h - t)), abs(s - w / 2))
        if bar > 0.05:
            sky = _soft((t / h - 0.3 + 0.12 * _noise(s * 3, 1.5, seed)) * 9)
            mix, bright = 1.0, 0.45 + 0.95 * sky + 0.15 * _noise(s * 7, t * 7, seed)
    elif kind == 5:  # picture: frame, blobs
        if min(min(s, w - s), min(t, h - t)) > 0.035:
            v = _noise(s * 5, t * 5, seed) + 0.5 * _noise(s * 13, t * 13, seed + 1)
            mix, bright = _soft(v * 1.5 - 0.5), 0.6 + 0.7 * _noise(s * 8, t * 8, seed + 2)
    elif kind == 6:  # door leaf: two panels, a handle, a dark seam
        a, b = min(s, w - s), t
        panel = a > 0.13 and (0.15 < b < h * 0.42 or h * 0.5 < b < h - 0.15)
        line = min(abs(a - 0.13), min(min(abs(b - 0.15), abs(b - h * 0.42)), min(abs(b - h * 0.5), abs(b - h + 0.15))))
        bright = 0.95 if panel else 1.0
        if line < 0.012 and 0.12 < a and 0.14 < b < h - 0.14:
            bright = 0.82
        if min(a, h - t) < 0.012:
            mix = 1.0
        if abs(b - 1.02) < 0.02 and 0.04 < w - s < 0.17:
            mix, bright = 1.0, 0.6
    elif kind == 7:  # stripes: cloth, drawers
        f = t / scale - np.floor(t / scale)
        mix = _soft(0.06 / px) if f < 0.06 else 0.12 * _noise(s * 30, t * 3, seed)
    elif kind == 8:  # slats: blinds, curtain folds
        mix = (0.5 + 0.5 * np.sin(6.2832 * s / scale)) * _soft(0.5 * scale / px) + 0.5 * (1 - _soft(0.5 * scale / px))
    elif kind == 9:  # cabinet doors with knobs
        n = max(1.0, np.round(w / scale))
        f = s / w * n - np.floor(s / w * n)
        edge = min(f, 1 - f) * w / n
        mix = _soft((0.004 + px * 0.5 - min(edge, min(t, h - t))) / px)
        if abs(t - h * 0.55) < 0.05 and abs(f - 0.88) * w / n < 0.012:
            mix, bright = 1.0, 0.5
        bright *= 0.96 + 0.08 * _noise(s * 60, t * 3, seed)
    elif kind == 10:  # books
        j = np.floor(t / scale)
        f = t / scale - j
        k = np.floor(s / 0.035)
        if f > 0.1 and min(s, w - s) > 0.025 and f < 0.62 + 0.3 * _hash(int(k), int(j), seed):
            mix, bright = 1.0, 0.35 + 1.2 * _hash(int(k), int(j), seed + 5)
        elif f > 0.1 and min(s, w - s) > 0.025:
            bright = 0.35
    elif kind == 11 and min(min(s, w - s), min(t, h - t)) > 0.015:  # screen
        mix = 0.3 + 0.7 * _noise(s * 6, t * 6, seed)
    return mix, bright


@njit(cache=True, nogil=True)
def _contact(x, y, z, thing, boxes):  # type: ignore[no-untyped-def]
    """Darkening near boxes of other objects, and in their shade."""
    factor = 1.0
    for k in range(boxes.shape[0]):
        if boxes[k, 8] == thing:
            continue
        dx, dy = x - boxes[k, 0], y - boxes[k, 1]
        px = abs(dx * boxes[k, 2] + dy * boxes[k, 3]) - boxes[k, 4]
        py = abs(dy * boxes[k, 2] - dx * boxes[k, 3]) - boxes[k, 5]
        px, py = max(0.0, px), max(0.0, py)
        pz = max(0.0, max(boxes[k, 6] - z, z - boxes[k, 7]))
        size = min(1.0, max(0.02, boxes[k, 7] - boxes[k, 6]) / _TALL_M)  # a small thing has a small shade
        near = (px * px + py * py + pz * pz) / (_SHADOW_M * _SHADOW_M * size)
        if near < 12.0:
            factor *= 1.0 - 0.38 / (1.0 + near * near + near)
    return max(factor, 0.3)


@njit(cache=True, nogil=True)
def _shade_kernel(index, depth_m, rectangles, looks, boxes, lamps, ambient, pose, K, color):  # type: ignore[no-untyped-def]
    height, width = index.shape
    fx, fy, cx, cy = K
    for yy in range(height):
        for xx in range(width):
            i = index[yy, xx]
            if i < 0:
                continue
            z = depth_m[yy, xx]
            px, py, pz = (xx - cx) / fx * z, (yy - cy) / fy * z, z * 1.0
            s = t = 0.0
            w, h = looks[i, 10], looks[i, 11]
            for k in range(3):
                p = (px, py, pz)[k] - rectangles[i, k]
                s += p * rectangles[i, 3 + k]
                t += p * rectangles[i, 6 + k]
            s, t = s / w, t / h
            ux, uy, uz = rectangles[i, 3] / w, rectangles[i, 4] / w, rectangles[i, 5] / w
            vx, vy, vz = rectangles[i, 6] / h, rectangles[i, 7] / h, rectangles[i, 8] / h
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            if nx * px + ny * py + nz * pz > 0:
                nx, ny, nz = -nx, -ny, -nz
            slant = max(0.15, -(nx * px + ny * py + nz * pz) / np.sqrt(px * px + py * py + pz * pz))
            mix, bright = _pattern(int(looks[i, 0]), s, t, w, h, looks[i, 7], int(looks[i, 8]), z / fx / slant)
            X = pose[0, 0] * px + pose[0, 1] * py + pose[0, 2] * pz + pose[0, 3]
            Y = pose[1, 0] * px + pose[1, 1] * py + pose[1, 2] * pz + pose[1, 3]
            Z = pose[2, 0] * px + pose[2, 1] * py + pose[2, 2] * pz + pose[2, 3]
            Nx = pose[0, 0] * nx + pose[0, 1] * ny + pose[0, 2] * nz
            Ny = pose[1, 0] * nx + pose[1, 1] * ny + pose[1, 2] * nz
            Nz = pose[2, 0] * nx + pose[2, 1] * ny + pose[2, 2] * nz
            lit = ambient * (0.9 + 0.1 * Nz)
            for k in range(lamps.shape[0]):
                lx, ly, lz = lamps[k, 0] - X, lamps[k, 1] - Y, lamps[k, 2] - Z
                far = np.sqrt(lx * lx + ly * ly + lz * lz) + 1e-6
                facing = (lx * Nx + ly * Ny + lz * Nz) / far
                if facing > 0:
                    lit += lamps[k, 3] * facing / (1.0 + (far / _LAMP_RANGE_M) ** 2)
            lit *= bright * _contact(X, Y, Z, looks[i, 9], boxes)
            for c in range(3):
                color[yy, xx, c] = lit * (looks[i, 1 + c] * (1 - mix) + looks[i, 4 + c] * mix)
