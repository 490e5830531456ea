"""Planes in inverse depth: one per superpixel, robust; one per window, for the gradient."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .superpixel_assignment import CAP, KW, N_CENTER, PA, PB, PC, X, Y
from .superpixel_sums import N_SUMS, accumulate, plane_of_sums, plane_sse

MIN_PLANE_PIXELS = 30
"""Superpixels with fewer inliers have no plane."""

_GRADIENT_RADIUS_PX = 5
_INLIER = 2.5
_MIN_RMS = 1e-4
_ROW_PX = 2


@njit(cache=True, nogil=True)
def fit_planes(lab, w, gradient, pieces, ids, sums, row_px, has_depth):  # type: ignore[no-untyped-def]
    """Return the planes (K, 3) float64 (a, b, c), w = a x + b y + c, and the rms (K,) float32 of their inliers.

    `ids` (pieces,) tells which superpixel each piece of the image `pieces` belongs to.
    The least-squares plane of the sums, fitted once more (on every second row) without the residuals beyond 2.5
    times the rms of the first. NaN where fewer than 30 pixels are left. Columns that span no plane get slope 0.
    """
    count = len(sums)
    plane, rms = np.full((count, 3), np.nan), np.full(count, np.nan, np.float32)
    if not has_depth:
        return plane, rms
    fits = np.zeros((count, N_CENTER), np.float32)
    for k in range(count):
        s = sums[k]
        fits[k, X], fits[k, Y] = s[1] / s[0], s[2] / s[0]
        fits[k, PA], fits[k, PB], fits[k, PC] = plane_of_sums(s, fits[k, X], fits[k, Y])
        fits[k, KW] = 1.0 / max(plane_sse(s) / max(s[9], 1.0), _MIN_RMS**2)
        fits[k, CAP] = _INLIER**2
    of_pieces = np.empty((len(ids), N_CENTER), np.float32)
    for piece in range(len(ids)):
        of_pieces[piece] = fits[ids[piece]]
    step = max(1, _ROW_PX // row_px)
    by_piece = accumulate(lab, w, gradient, of_pieces, pieces, step, row_px, False, False)
    again = np.zeros((count, N_SUMS))
    for piece in range(len(ids)):
        again[ids[piece]] += by_piece[piece]
    for k in range(count):
        s = again[k]
        if s[9] * step * row_px >= MIN_PLANE_PIXELS:
            plane[k] = plane_of_sums(s, 0.0, 0.0)
            rms[k] = np.sqrt(plane_sse(s) / s[9])
    return plane, rms


def inverse_depth_gradient(inverse_depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the slope of a plane fitted to the measured pixels of an 11x11 window: (2, H, W) float32 in 1/m/px.

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
    slopes = np.stack([(yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det]) * m
    return np.ascontiguousarray(slopes, dtype=np.float32)
