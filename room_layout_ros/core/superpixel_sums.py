"""Sums over the pixels of each superpixel, and the means and planes that follow from them in closed form."""

from __future__ import annotations

import numpy as np
from numba import njit

from .superpixel_assignment import AB_OFFSET, CA, CAP, CB, CL, GA, GB, KW, L_SCALE, PA, PB, PC, X, Y, first_row

N_SUMS = 19
"""n, x, y, L, a, b; measured, gradient (2); pixels of the plane: m, x, y, xx, xy, yy, w, xw, yw, ww."""

MIN_CENTER_PIXELS = 6.0
"""A centre whose plane has fewer pixels has none."""

_NO_PLANE = 1e20
"""KW of a centre without plane: finite, as 0 times infinity is no number."""

_NEUTRAL = 1.0
"""Cost of a measured pixel at a centre without plane: that of a usual residual, so that neither is preferred."""

_RIDGE_PX2 = 0.05
"""Added to the variance of the pixels' positions: slopes that a line of pixels cannot tell become 0."""

_CHANNEL_BITS = 21
_CHANNEL = 2**_CHANNEL_BITS - 1
"""Of a sum of 8-bit channels of which three are packed in an int64: room for runs of 8224 pixels."""


@njit(cache=True, nogil=True, error_model="numpy")
def accumulate(lab, w, gradient, centers, index, step, row_px, by_gradient, by_color=True):  # type: ignore[no-untyped-def]
    """Return the sums (K, N_SUMS) of the pixels of every `step`-th row from `first_row(step, rows)` on.

    Row i of the images is at y = row_px i of the frame. Without `by_color` the sums of Lab mean nothing.
    A run of one label is summed in registers, x from its start, and added to its centre once (half the time of adding
    each pixel).
    A pixel whose residual is capped at its centre (KW r^2 > CAP) is no part of the centre's plane: that makes the
    fit the exact minimiser of the capped energy for fixed inliers. KW = 0 takes all.
    """
    rows, width = index.shape
    sums = np.zeros((len(centers), N_SUMS))
    limit = _inlier_limits(centers)
    packed = np.zeros(width, np.int64)
    for row in range(first_row(step, rows), rows, step):
        y = row * row_px
        if by_color:
            _pack_row(lab, row, packed)
        x = 0
        while x < width:
            k, first = index[row, x], x
            if limit[k] == np.inf:
                x, colors, run = _sum_measured(w, index, row, x, packed)
            else:
                x, colors, run = _sum_inliers(w, index, row, x, packed, centers[k], y, limit[k])
            _add_run(sums[k], first, x - first, y, colors, run)
            if by_gradient:
                for i in range(first, x):
                    sums[k, 7] += gradient[0, row, i]
                    sums[k, 8] += gradient[1, row, i]
    return sums


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sum_measured(w, index, row, x, packed):  # type: ignore[no-untyped-def]
    """(x behind the run that begins at x, its packed colours, its sums) of all that is measured; what is not is 0.

    Sums: measured pixels, those of the plane, and of these x from the run's start, x^2, w, x w and w^2.
    """
    k, width, zero, one = index[row, x], index.shape[1], np.float32(0), np.float32(1)
    colors = np.int64(0)
    m, mx, mxx, mw, mxw, mww, j = zero, zero, zero, zero, zero, zero, zero
    while x < width and index[row, x] == k:
        colors += packed[x]
        value = w[row, x]
        inlier = one if value > zero else zero
        m += inlier
        mx += inlier * j
        mxx += inlier * j * j
        mw += value
        mxw += value * j
        mww += value * value
        j += one
        x += 1
    return x, colors, (m, m, mx, mxx, mw, mxw, mww)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sum_inliers(w, index, row, x, packed, center, y, limit):  # type: ignore[no-untyped-def]
    """`_sum_measured`, of the pixels within `limit` of the centre's plane."""
    k, width, zero, one = index[row, x], index.shape[1], np.float32(0), np.float32(1)
    colors, slope = np.int64(0), center[PA]
    w0 = np.float32(center[PC] + slope * (x - center[X]) + center[PB] * (y - center[Y]))
    seen, m, mx, mxx, mw, mxw, mww, j = zero, zero, zero, zero, zero, zero, zero, zero
    while x < width and index[row, x] == k:
        colors += packed[x]
        value = w[row, x]
        measured = one if value > zero else zero
        inlier = measured if abs(value - w0 - slope * j) <= limit else zero
        seen += measured
        m += inlier
        mx += inlier * j
        mxx += inlier * j * j
        mw += inlier * value
        mxw += inlier * value * j
        mww += inlier * value * value
        j += one
        x += 1
    return x, colors, (seen, m, mx, mxx, mw, mxw, mww)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _add_run(s, first, n, y, colors, run):  # type: ignore[no-untyped-def]
    """Add the sums of a run of n pixels from x = first on, in the frame's coordinates."""
    seen, m, mx, mxx, mw, mxw, mww = run
    s[0] += n
    s[1] += n * (2 * first + n - 1) * 0.5
    s[2] += n * y
    s[3] += np.int32(colors & _CHANNEL) * L_SCALE
    s[4] += np.int32(colors >> _CHANNEL_BITS & _CHANNEL) - n * AB_OFFSET
    s[5] += np.int32(colors >> 2 * _CHANNEL_BITS) - n * AB_OFFSET
    s[6] += seen
    s[9] += m
    s[10] += mx + m * first
    s[11] += m * y
    s[12] += mxx + 2.0 * first * mx + m * first * first
    s[13] += (mx + m * first) * y
    s[14] += m * y * y
    s[15] += mw
    s[16] += mxw + mw * first
    s[17] += mw * y
    s[18] += mww


@njit(cache=True, nogil=True)
def _pack_row(lab, row, packed):  # type: ignore[no-untyped-def]
    """Write L, a and b of a row's pixels into one number each, so that one addition sums the three."""
    for x in range(len(packed)):
        a, b = np.int64(lab[1, row, x]), np.int64(lab[2, row, x])
        packed[x] = np.int64(lab[0, row, x]) | a << _CHANNEL_BITS | b << 2 * _CHANNEL_BITS


@njit(cache=True, nogil=True, error_model="numpy")
def _inlier_limits(centers):  # type: ignore[no-untyped-def]
    """Return the largest residual of each centre that is not capped."""
    limit = np.empty(len(centers), np.float32)
    for k in range(len(centers)):
        kw, cap = centers[k, KW], centers[k, CAP]
        limit[k] = np.sqrt(cap / kw) if 0 < kw < _NO_PLANE else np.inf
    return limit


@njit(cache=True, nogil=True, error_model="numpy")
def move_centers(sums, centers, noise, noise_quantum, weight, cap):  # type: ignore[no-untyped-def]
    """Set each centre to the means and the least-squares plane of its pixels; a centre without pixels stays."""
    for k in range(len(centers)):
        s, c = sums[k], centers[k]
        n = s[0]
        if n == 0:
            continue
        c[X], c[Y] = s[1] / n, s[2] / n
        c[CL], c[CA], c[CB] = s[3] / n, s[4] / n, s[5] / n
        if s[6] > 0:
            c[GA], c[GB] = s[7] / s[6], s[8] / s[6]
        a, b, w = plane_of_sums(s, c[X], c[Y])
        c[PA], c[PB], c[PC] = a, b, w
        if s[9] >= MIN_CENTER_PIXELS:
            c[KW], c[CAP] = weight / plane_variance(w, noise, noise_quantum), weight * cap
        else:
            c[KW], c[CAP] = _NO_PLANE, weight * _NEUTRAL


@njit(cache=True, nogil=True, error_model="numpy")
def plane_variance(w, noise, noise_quantum):  # type: ignore[no-untyped-def]
    """Return the variance of inverse depth: constant for structured light, (quantum w^2)^2 for depth rounded in Z."""
    return noise * noise + (noise_quantum * w * w) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def plane_of_sums(s, x0, y0):  # type: ignore[no-untyped-def]
    """Return (a, b, w0) of the least-squares plane w = a (x - x0) + b (y - y0) + w0 of the sums; 0 without pixels."""
    m = s[9]
    if m < 1:
        return 0.0, 0.0, 0.0
    (mx, my, mw), (xx, xy, yy, xw, yw) = _about_mean(m, s[10], s[11], s[12], s[13], s[14], s[15], s[16], s[17])
    det = xx * yy - xy * xy
    a, b = (yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det
    return a, b, mw + a * (x0 - mx) + b * (y0 - my)


@njit(cache=True, nogil=True, error_model="numpy")
def plane_sse(s):  # type: ignore[no-untyped-def]
    """Return the sum of squared residuals of the least-squares plane of the sums."""
    return _sse(s[9], s[10], s[11], s[12], s[13], s[14], s[15], s[16], s[17], s[18])


@njit(cache=True, nogil=True, error_model="numpy")
def plane_sse_of_both(sums, a, b):  # type: ignore[no-untyped-def]
    """`plane_sse` of the sums of two superpixels added."""
    s, t = sums[a], sums[b]
    return _sse(
        s[9] + t[9], s[10] + t[10], s[11] + t[11], s[12] + t[12], s[13] + t[13],
        s[14] + t[14], s[15] + t[15], s[16] + t[16], s[17] + t[17], s[18] + t[18],
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sse(m, x, y, xx, xy, yy, w, xw, yw, ww):  # type: ignore[no-untyped-def]
    """Sum of squared residuals; of all sums of m pixels, those of 1 and of the products of x, y and w."""
    if m < 1:
        return 0.0
    (_, _, mw), (xx, xy, yy, xw, yw) = _about_mean(m, x, y, xx, xy, yy, w, xw, yw)
    explained = (yy * xw * xw - 2.0 * xy * xw * yw + xx * yw * yw) / (xx * yy - xy * xy)
    return max(0.0, m * (ww / m - mw * mw - explained))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _about_mean(m, x, y, xx, xy, yy, w, xw, yw):  # type: ignore[no-untyped-def]
    """Mean (x, y, w), and mean products xx, xy, yy, xw, yw about it, those of the positions with the ridge."""
    x, y, w = x / m, y / m, w / m
    xx, xy, yy = xx / m - x * x + _RIDGE_PX2, xy / m - x * y, yy / m - y * y + _RIDGE_PX2
    return (x, y, w), (xx, xy, yy, xw / m - x * w, yw / m - y * w)
