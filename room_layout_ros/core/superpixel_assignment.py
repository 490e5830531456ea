"""Kernels of depth-aware SLIC: which centre each pixel belongs to (paper 3.1)."""

from __future__ import annotations

import numpy as np
from numba import njit

TILE_H, TILE_W = 8, 16
"""Rows and columns of a tile. Its pixels share a list of candidates and are copied together, so that the loops over
them run in vector registers; where rows are left out, a tile has as many rows and is as much higher."""

_N = TILE_H * TILE_W

MAX_CANDIDATES = 64
"""Centres compared per tile; six bits of the packed cost."""

# columns of a centre
X, Y, CL, CA, CB, PA, PB, PC, KW, CAP, GA, GB = range(12)
N_CENTER = 12
"""Position; mean Lab; plane w = PA (x - X) + PB (y - Y) + PC, weight and cap of its residual; mean gradient."""

L_SCALE, AB_OFFSET = np.float32(100.0 / 255.0), np.float32(128.0)

_COST_STEPS = np.float32(2.0**14)
_COST_LIMIT = np.float32(2.0**10 - 1.0)
_GRADIENT_CAP = np.float32(16.0)


@njit(cache=True, nogil=True)
def candidates_of_tiles(centers, reach, rows, width, step, row_px):  # type: ignore[no-untyped-def]
    """Return the centres within `reach` of each tile: (tiles, MAX_CANDIDATES) int32 and their number (tiles,).

    Where there are more than MAX_CANDIDATES, the first ones count; where there is none, the nearest one.
    """
    tile_h = TILE_H * step * row_px
    down, across = (rows * row_px + tile_h - 1) // tile_h, (width + TILE_W - 1) // TILE_W
    lists = np.empty((down * across, MAX_CANDIDATES), np.int32)
    count = np.zeros(down * across, np.int32)
    for k in range(len(centers)):
        x, y = centers[k, X], centers[k, Y]
        first_x, last_x = max(0, int((x - reach) // TILE_W)), min(across - 1, int((x + reach) // TILE_W))
        first_y, last_y = max(0, int((y - reach) // tile_h)), min(down - 1, int((y + reach) // tile_h))
        for ty in range(first_y, last_y + 1):
            dy = max(ty * tile_h - y, y - (ty + 1) * tile_h, 0.0)
            for tx in range(first_x, last_x + 1):
                dx = max(tx * TILE_W - x, x - (tx + 1) * TILE_W, 0.0)
                t = ty * across + tx
                if dx * dx + dy * dy <= reach * reach and count[t] < MAX_CANDIDATES:
                    lists[t, count[t]] = k
                    count[t] += 1
    for t in range(down * across):
        if count[t] == 0:
            lists[t, 0], count[t] = _nearest(centers, (t % across + 0.5) * TILE_W, (t // across + 0.5) * tile_h), 1
    return lists, count


@njit(cache=True, nogil=True)
def _nearest(centers, x, y):  # type: ignore[no-untyped-def]
    nearest, least = 0, np.inf
    for k in range(len(centers)):
        far = (centers[k, X] - x) ** 2 + (centers[k, Y] - y) ** 2
        if far < least:
            least, nearest = far, k
    return nearest


@njit(cache=True, nogil=True)
def _copy_row(lab, w, gradient, y, x0, n, at, pixel, color, depth, by_gradient):  # type: ignore[no-untyped-def]
    if color:
        for j in range(n):
            pixel[0, at + j] = lab[0, y, x0 + j] * L_SCALE
            pixel[1, at + j] = lab[1, y, x0 + j] - AB_OFFSET
            pixel[2, at + j] = lab[2, y, x0 + j] - AB_OFFSET
    if depth:
        for j in range(n):
            pixel[3, at + j] = w[y, x0 + j]
    if by_gradient:
        for j in range(n):
            pixel[4, at + j] = gradient[0, y, x0 + j]
            pixel[5, at + j] = gradient[1, y, x0 + j]


@njit(cache=True, nogil=True)
def first_row(step, rows):  # type: ignore[no-untyped-def]
    """Return the first of every `step`-th row: in the middle of the rows that it stands for, if there is such a row."""
    return step // 2 if rows > step // 2 else 0


@njit(cache=True, nogil=True, fastmath={"contract"})
def assign(lab, w, gradient, centers, lists, count, step, row_px, weights, index):  # type: ignore[no-untyped-def]
    """Write into `index` (rows, W) the centre of least energy, for every `step`-th row from `first_row(step, rows)` on.

    Row i of the images is at y = row_px i of the frame.

    Energy of pixel p at centre s, weights = (space, color, depth?, gradient):
    space |p - mu|^2 + color |I - c|^2 + [measured] (min(KW (w - plane(p))^2, CAP) + gradient |g - g_s|^2)
    (paper 3.1, eq. 1, with the residual to the plane beside the gradient). Cost and place in the candidate list are
    packed in one integer, so that the search is a minimum; of equal costs the first candidate wins.
    """
    height, width = index.shape
    phase = first_row(step, height)
    across = (width + TILE_W - 1) // TILE_W
    px, py = np.empty(_N, np.float32), np.empty(_N, np.float32)
    for i in range(TILE_H):
        for j in range(TILE_W):
            px[i * TILE_W + j] = j
            py[i * TILE_W + j] = (i * step + phase) * row_px
    pixel = np.zeros((6, _N), np.float32)
    own, steep, best = np.empty(_N, np.float32), np.zeros(_N, np.float32), np.empty(_N, np.int32)
    zero, two = np.float32(0), np.float32(2)
    space, color = np.float32(weights[0]), np.float32(weights[1])
    depth, gradient_weight = np.float32(weights[2]), np.float32(weights[3])
    by_color, by_depth, by_gradient = weights[1] > 0, weights[2] > 0, weights[3] > 0
    for t in range(len(lists)):
        x0, y0 = (t % across) * TILE_W, (t // across) * TILE_H * step
        columns = min(TILE_W, width - x0)
        for i in range(TILE_H):
            y = y0 + i * step + phase
            if y < height:
                measured = by_depth or by_gradient
                if columns == TILE_W:
                    _copy_row(lab, w, gradient, y, x0, TILE_W, i * TILE_W, pixel, by_color, measured, by_gradient)
                else:
                    _copy_row(lab, w, gradient, y, x0, columns, i * TILE_W, pixel, by_color, measured, by_gradient)
        for p in range(_N):
            best[p] = 2**31 - 1
            lab2 = pixel[0, p] * pixel[0, p] + pixel[1, p] * pixel[1, p] + pixel[2, p] * pixel[2, p]
            own[p] = space * (px[p] * px[p] + py[p] * py[p]) + color * lab2
        for slot in range(count[t]):
            # |p - s|^2 multiplied out: |p|^2 is the tile's, |s|^2 the centre's, and the rest is linear in the pixel
            center = centers[lists[t, slot]]
            cx, cy = center[X] - np.float32(x0), center[Y] - np.float32(y0 * row_px)
            cl, ca, cb = center[CL], center[CA], center[CB]
            k0 = space * (cx * cx + cy * cy) + color * (cl * cl + ca * ca + cb * cb)
            kx, ky = two * space * cx, two * space * cy
            kl, ka, kb = two * color * cl, two * color * ca, two * color * cb
            pa, pb, kw, cap = center[PA], center[PB], center[KW] * depth, center[CAP]
            pc = center[PC] - pa * cx - pb * cy
            if by_gradient:
                ga, gb = center[GA], center[GB]
                for p in range(_N):
                    dx, dy = pixel[4, p] - ga, pixel[5, p] - gb
                    term = min(gradient_weight * (dx * dx + dy * dy), _GRADIENT_CAP)
                    steep[p] = term if pixel[3, p] > zero else zero
            for p in range(_N):
                w_p = pixel[3, p]
                r = w_p - (pa * px[p] + pb * py[p] + pc)
                fit = kw * r * r
                fit = cap if fit > cap else fit
                fit = fit if w_p > zero else zero
                linear = kx * px[p] + ky * py[p] + kl * pixel[0, p] + ka * pixel[1, p] + kb * pixel[2, p]
                cost = own[p] + k0 - linear + steep[p] + fit
                cost = _COST_LIMIT if cost > _COST_LIMIT else cost
                packed = np.int32((np.int32(cost * _COST_STEPS) << 6) | slot)
                best[p] = packed if packed < best[p] else best[p]
        for i in range(TILE_H):
            y = y0 + i * step + phase
            if y < height:
                for j in range(columns):
                    index[y, x0 + j] = lists[t, best[i * TILE_W + j] & 63]
