"""What each superpixel is: area, centre, colour and a robust plane in inverse depth."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .superpixel_assignment import (
    CAP,
    KW,
    N_CENTER,
    N_SUMS,
    PA,
    PB,
    PC,
    TILE_H,
    TILE_W,
    M,
    W,
    X,
    Y,
    accumulate,
    plane_of_sums,
)

MIN_PLANE_PIXELS = 30
_GRADIENT_RADIUS_PX = 5

_INLIER = 2.5
"""Residuals beyond this multiple of the first fit's rms are left out of the second."""

_ROW_STEP = 2
"""Rows left out when planes and colours are summed: 2 leaves 750 pixels per superpixel of 640x480."""


def describe(
    tiles: NDArray[np.float32], index: NDArray[np.int32], count: int
) -> tuple[
    NDArray[np.int32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float64],
    NDArray[np.float32],
    NDArray[np.float32],
]:
    """Return pixels, centre, mean Lab, plane, plane rms and measured share of each superpixel (see `Superpixels`).

    The plane is a least-squares fit in inverse depth, repeated once without the residuals beyond 2.5 rms.
    """
    fits = np.zeros((count, N_CENTER), np.float32)
    sums = np.zeros((count, N_SUMS))
    accumulate(tiles, fits, 1, 0, index, sums)
    area = np.maximum(sums[:, 0], 1)
    fits[:, X], fits[:, Y] = sums[:, 1] / area, sums[:, 2] / area
    set_planes(sums, fits)
    first = residuals(tiles, fits, index)
    with np.errstate(divide="ignore", invalid="ignore"):
        fits[:, KW] = 1.0 / np.maximum(first, 1e-12)
    fits[:, CAP] = _INLIER**2
    again = np.zeros((count, N_SUMS))
    accumulate(tiles, fits, 1, 0, index, again)
    set_planes(again, fits)
    with np.errstate(divide="ignore", invalid="ignore"):
        fits[:, KW] = 1.0 / np.maximum(first, 1e-12)
    second = residuals(tiles, fits, index)
    none = again[:, 9] < MIN_PLANE_PIXELS
    plane = fits[:, [PA, PB, PC]].astype(np.float64)
    plane[:, 2] -= plane[:, 0] * fits[:, X] + plane[:, 1] * fits[:, Y]
    plane[none] = np.nan
    rms = np.where(none, np.nan, np.sqrt(second)).astype(np.float32)
    center = fits[:, [X, Y]].copy()
    lab = (sums[:, 3:6] / area[:, None]).astype(np.float32)
    measured = (sums[:, 6] / area).astype(np.float32)
    return sums[:, 0].astype(np.int32), center, lab, plane, rms, measured


@njit(cache=True, nogil=True)
def set_planes(sums, fits):  # type: ignore[no-untyped-def]
    """Write the least-squares plane of the sums at each fit's position."""
    for k in range(len(fits)):
        a, b, w, _ = plane_of_sums(sums[k], fits[k, X], fits[k, Y])
        fits[k, PA], fits[k, PB], fits[k, PC] = a, b, w


@njit(cache=True, nogil=True)
def residuals(tiles, fits, index):  # type: ignore[no-untyped-def]
    """Return (K,) mean squared residual of the inliers of each plane (all measured pixels while KW is 0)."""
    height, width = index.shape
    total, n = np.zeros(len(fits)), np.zeros(len(fits))
    for y in range(height):
        for x in range(width):
            tile = tiles[y // TILE_H, x // TILE_W]
            p = (y % TILE_H) * TILE_W + x % TILE_W
            if tile[M, p] > 0:
                f = fits[index[y, x]]
                r = tile[W, p] - (f[PA] * (x - f[X]) + f[PB] * (y - f[Y]) + f[PC])
                if f[KW] * r * r <= f[CAP]:
                    total[index[y, x]] += r * r
                    n[index[y, x]] += 1
    return total / np.maximum(n, 1)


def inverse_depth_gradient(inverse_depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the slope of a plane fitted to the measured pixels of an 11x11 window: (H, W, 2) float32 in 1/m/px.

    A difference of neighbouring pixels of 8-bit depth is worthless (0 or a step of 39 mm); the fit's slope has a
    35-fold smaller error. Slopes are 0 where not measured.
    """
    r = _GRADIENT_RADIUS_PX
    offset = np.arange(-r, r + 1, dtype=np.float32)
    one = np.ones_like(offset)
    m = (inverse_depth > 0).astype(np.float32)

    def total(image: NDArray[np.float32], kx: NDArray[np.float32], ky: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.sepFilter2D(image, cv2.CV_32F, kx, ky, borderType=cv2.BORDER_CONSTANT), np.float32)

    s, sx, sy = total(m, one, one), total(m, offset, one), total(m, one, offset)
    sxx, sxy, syy = total(m, offset**2, one), total(m, offset, offset), total(m, one, offset**2)
    w = inverse_depth * m
    sw, sxw, syw = total(w, one, one), total(w, offset, one), total(w, one, offset)
    n = np.maximum(s, 1)
    xx, xy, yy = sxx - sx * sx / n + 1, sxy - sx * sy / n, syy - sy * sy / n + 1
    xw, yw = sxw - sx * sw / n, syw - sy * sw / n
    det = xx * yy - xy * xy
    slopes = np.stack([(yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det], axis=2) * m[..., None]
    return np.ascontiguousarray(slopes, dtype=np.float32)
