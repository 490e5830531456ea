"""The depth of things, smoothed on the planes of their superpixels.

What stands in a room is mostly made of flat pieces: fronts, tops, seats. A piece is as flat as the superpixel it lies
in, and the plane through its hundreds of pixels is known several times better than each of them. So a pixel above the
floor is moved along its ray to that plane, if it lies on it as far as its noise can tell; what is round or cluttered
stays as it was measured. The noise is that of the floor in the same frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..labels import FLOOR, N_LABELS
from .floor_noise import band_sigma
from .floor_plane import FloorFit

_STRIDE = 3
_ROUNDS = 2
_SIGMAS = 4.0
"""Pixels within so many deviations of the plane lie on it."""

_ABOVE_SIGMAS = 2.0
"""A pixel this far above the floor is no floor, for the fit."""

_MIN_PIXELS = 8
"""Of every third row and column, that make a plane."""

_STEPS, _PER_UNIT = 1000, 200.0
"""Entries of the table of the noise, and per 1/m of inverse depth."""


def smooth_things(
    inverse_depth: NDArray[np.float32],
    labels: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    fit: FloorFit,
    camera: CameraIntrinsics,
    lowest_m: float,
) -> None:
    """Move the pixels of things to the planes of their superpixels, in place.

    Parameters
    ----------
    inverse_depth : (H, W) float32, 1/m, 0 where nothing was measured.
    labels : (H, W) uint8 of the estimate: a superpixel across two walls has two planes; floor is left as it is.
    superpixels : (H, W) int32 index. fit : FloorFit of the frame.
    lowest_m : what is lower over the floor stays as it is.
    """
    floor = fit.normal / fit.distance_m
    a, b = floor[0] / camera.fx, floor[1] / camera.fy
    plane = tuple(np.float32(k) for k in (a, b, floor[2] - a * camera.cx - b * camera.cy))
    noise = _noise(fit.sigma_m, fit.distance_m)
    planes = _fit_planes(inverse_depth, labels, superpixels, plane, noise, (lowest_m, fit.distance_m))
    lowest = np.float32(lowest_m / fit.distance_m)
    _move(inverse_depth, labels, superpixels, plane, noise, lowest, planes.astype(np.float32))


@njit(cache=True, nogil=True)
def _noise(sigma_m, distance):  # type: ignore[no-untyped-def]
    """Standard deviation of the inverse depth, 1/m, per step of inverse depth, from that of the floor's height."""
    noise = np.empty(_STEPS, np.float32)
    for k in range(_STEPS):
        z = _PER_UNIT / (k + 0.5)
        noise[k] = band_sigma(sigma_m, z) / (distance * z)
    return noise


@njit(cache=True, nogil=True, error_model="numpy")
def _fit_planes(inverse, labels, index, floor, noise, limits):  # type: ignore[no-untyped-def]
    """(pieces, 3) inverse depth a u + b v + c of each one's things, NaN where too few pixels agree."""
    pixels, owner = _above_floor(inverse, labels, index, floor, noise, limits)
    planes = np.full(((index.max() + 1) * (N_LABELS + 1), 3), np.nan)
    pixels, start = _by_piece(pixels, owner, len(planes))
    for k in range(len(planes)):
        mine = pixels[start[k] : start[k + 1]]
        if len(mine) >= _MIN_PIXELS:
            for turn in range(_ROUNDS + 1):
                planes[k] = _solve(_plane_sums(mine, planes[k], turn > 0))
    return planes


@njit(cache=True, nogil=True)
def _by_piece(pixels, owner, pieces):  # type: ignore[no-untyped-def]
    """Pixels in the order of their pieces, and where each piece begins (pieces + 1,)."""
    start = np.zeros(pieces + 1, np.int64)
    for n in range(len(owner)):
        start[owner[n] + 1] += 1
    start = np.cumsum(start)
    fill, ordered = start[:-1].copy(), np.empty_like(pixels)
    for n in range(len(owner)):
        at = fill[owner[n]]
        for k in range(4):
            ordered[at, k] = pixels[n, k]
        fill[owner[n]] = at + 1
    return ordered, start


@njit(cache=True, nogil=True, error_model="numpy")
def _plane_sums(pixels, plane, weighted):  # type: ignore[no-untyped-def]
    """Sums over a piece's pixels, with Tukey's weights about a plane: 1, u, v, w, uu, uv, vv, uw, vw; their number."""
    s0 = su = sv = sw = suu = suv = svv = suw = svw = count = 0.0
    a, b, c = plane[0], plane[1], plane[2]
    for n in range(len(pixels)):
        u, v, w, weight = pixels[n, 0], pixels[n, 1], pixels[n, 2], 1.0
        if weighted:
            q = (w - a * u - b * v - c) / (_SIGMAS * pixels[n, 3])
            if not q * q < 1.0:
                continue
            weight = (1.0 - q * q) ** 2
        s0 += weight
        su += weight * u
        sv += weight * v
        sw += weight * w
        suu += weight * u * u
        suv += weight * u * v
        svv += weight * v * v
        suw += weight * u * w
        svw += weight * v * w
        count += 1.0
    return s0, su, sv, sw, suu, suv, svv, suw, svw, count


@njit(cache=True, nogil=True)
def _above_floor(inverse, labels, index, floor, noise, limits):  # type: ignore[no-untyped-def]
    """Pixels (n, 4) float32 above the floor: u, v, inverse depth and its deviation; and the piece each is of."""
    lowest, distance = limits
    height, width = inverse.shape
    most = ((height + _STRIDE - 1) // _STRIDE) * ((width + _STRIDE - 1) // _STRIDE)
    pixels, owner = np.empty((most, 4), np.float32), np.empty(most, np.int32)
    count = 0
    for v in range(0, height, _STRIDE):
        for u in range(0, width, _STRIDE):
            w = inverse[v, u]
            if w <= 0.0 or labels[v, u] == FLOOR:
                continue
            sigma = noise[min(int(w * _PER_UNIT), _STEPS - 1)]
            over = w - (floor[0] * u + floor[1] * v + floor[2])
            if over > lowest / distance * w and over > _ABOVE_SIGMAS * sigma:
                pixels[count, 0], pixels[count, 1], pixels[count, 2], pixels[count, 3] = u, v, w, sigma
                owner[count] = _piece(index[v, u], labels[v, u])
                count += 1
    return pixels[:count], owner[:count]


@njit(cache=True, nogil=True)
def _piece(superpixel, label):  # type: ignore[no-untyped-def]
    """Index of the part of a superpixel that has this label."""
    return np.int64(superpixel) * (N_LABELS + 1) + label


@njit(cache=True, nogil=True)
def _solve(sums):  # type: ignore[no-untyped-def]
    """Plane a u + b v + c from the weighted sums of its pixels; NaN where too few are."""
    plane = np.full(3, np.nan)
    if sums[9] < _MIN_PIXELS or sums[0] <= 0.0:
        return plane
    u, v, w = sums[1] / sums[0], sums[2] / sums[0], sums[3] / sums[0]
    uu, uv, vv = sums[4] / sums[0] - u * u, sums[5] / sums[0] - u * v, sums[6] / sums[0] - v * v
    uw, vw = sums[7] / sums[0] - u * w, sums[8] / sums[0] - v * w
    det = uu * vv - uv * uv
    if det <= 1e-6 * max(uu * vv, 1e-9):
        return plane
    plane[0], plane[1] = (vv * uw - uv * vw) / det, (uu * vw - uv * uw) / det
    plane[2] = w - plane[0] * u - plane[1] * v
    return plane


@njit(cache=True, nogil=True)
def _move(inverse, labels, index, floor, noise, lowest, planes):  # type: ignore[no-untyped-def]
    """Set the inverse depth of pixels above the floor to that of their superpixel's plane where they lie on it."""
    height, width = inverse.shape
    column, piece = np.arange(width).astype(np.float32), np.empty(width, np.int32)
    on_plane, near = np.empty(width, np.float32), np.empty(width, np.float32)
    for v in range(height):
        row = floor[1] * np.float32(v) + floor[2]
        _row_pieces(index[v], labels[v], piece)
        _row_noise(inverse[v], noise, near)
        _row_planes(planes, piece, column, np.float32(v), on_plane)
        _move_row(inverse[v], on_plane, near, column, floor[0], row, lowest)


@njit(cache=True, nogil=True)
def _row_pieces(index, labels, piece):  # type: ignore[no-untyped-def]
    """Write the piece of each pixel of a row, -1 where it is floor."""
    for u in range(len(index)):
        mine = index[u] * np.int32(N_LABELS + 1) + np.int32(labels[u])
        piece[u] = mine if labels[u] != FLOOR else np.int32(-1)


@njit(cache=True, nogil=True)
def _row_noise(inverse, noise, near):  # type: ignore[no-untyped-def]
    """Write how far from a plane the pixels of a row lie on it."""
    for u in range(len(inverse)):
        step = min(inverse[u] * np.float32(_PER_UNIT), np.float32(_STEPS - 1))
        near[u] = np.float32(_SIGMAS) * noise[np.uint32(np.int32(max(step, np.float32(0.0))))]


@njit(cache=True, nogil=True)
def _row_planes(planes, piece, column, v, on_plane):  # type: ignore[no-untyped-def]
    """Write the inverse depth of the planes of a row's pieces, NaN where there is none."""
    last, a, b, c = np.int32(-1), np.float32(np.nan), np.float32(np.nan), np.float32(np.nan)
    for u in range(len(piece)):
        if piece[u] != last:
            last = piece[u]
            if last >= 0:
                a, b, c = planes[last, 0], planes[last, 1] * v, planes[last, 2]
            else:
                a = np.float32(np.nan)
        on_plane[u] = a * column[u] + b + c


@njit(cache=True, nogil=True)
def _move_row(inverse, on_plane, near, column, floor, row, lowest):  # type: ignore[no-untyped-def]
    """Set what lies on its plane to it; by itself, all float32, so that it runs on vectors."""
    for u in range(len(inverse)):
        w = inverse[u]
        thing = (w - (floor * column[u] + row) > lowest * w) & (w > np.float32(0.0))
        inverse[u] = on_plane[u] if thing & (abs(w - on_plane[u]) < near[u]) else w
