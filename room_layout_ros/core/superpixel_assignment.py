"""Kernels of depth-aware SLIC: which centre each pixel belongs to (paper 3.1)."""

from __future__ import annotations

import numpy as np
from numba import njit

TILE_H, TILE_W = 8, 16
"""The pixels of a tile share a list of candidates; they are copied together, so the loops run in vector registers."""

MAX_CANDIDATES = 64
"""Centres compared per tile; six bits of the packed cost."""

# columns of a centre
X, Y, CL, CA, CB, PA, PB, PC, KW, CAP, GA, GB = range(12)
N_CENTER = 12
"""Position; mean Lab; plane w = PA (x - X) + PB (y - Y) + PC, weight and cap of its residual; mean gradient."""

L_SCALE = np.float32(100.0 / 255.0)

_COST_STEPS = np.float32(2.0**14)
_COST_LIMIT = np.float32(2.0**10 - 1.0)
_GRADIENT_CAP = np.float32(16.0)


@njit(cache=True, nogil=True)
def candidates_of_tiles(centers, reach, down, across):  # type: ignore[no-untyped-def]
    """Return the centres within `reach` of each tile: (tiles, MAX_CANDIDATES) int32 and their number (tiles,)."""
    lists = np.empty((down * across, MAX_CANDIDATES), np.int32)
    count = np.zeros(down * across, np.int32)
    for k in range(len(centers)):
        x, y = centers[k, X], centers[k, Y]
        first_x, last_x = max(0, int((x - reach) // TILE_W)), min(across - 1, int((x + reach) // TILE_W))
        first_y, last_y = max(0, int((y - reach) // TILE_H)), min(down - 1, int((y + reach) // TILE_H))
        for ty in range(first_y, last_y + 1):
            for tx in range(first_x, last_x + 1):
                t = ty * across + tx
                if count[t] < MAX_CANDIDATES:
                    lists[t, count[t]] = k
                    count[t] += 1
    for t in range(down * across):
        if count[t] == 0:
            lists[t, 0], count[t] = _nearest(centers, (t % across + 0.5) * TILE_W, (t // across + 0.5) * TILE_H), 1
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
            pixel[1, at + j] = lab[1, y, x0 + j]
            pixel[2, at + j] = lab[2, y, x0 + j]
    if depth:
        for j in range(n):
            pixel[3, at + j] = w[y, x0 + j]
    if by_gradient:
        for j in range(n):
            pixel[4, at + j] = gradient[0, y, x0 + j]
            pixel[5, at + j] = gradient[1, y, x0 + j]


@njit(cache=True, nogil=True, fastmath={"contract"})
def assign(lab, w, gradient, centers, lists, count, step, phase, weights, index):  # type: ignore[no-untyped-def]
    """Write into `index` (H, W) the centre of least energy, for every `step`-th row of each tile from `phase` on.

    Energy of pixel p at centre s, weights = (space, color, depth?, gradient):
    space |p - mu|^2 + color |I - c|^2 + [measured] (min(KW (w - plane(p))^2, CAP) + gradient |g - g_s|^2)
    (paper 3.1, eq. 1, with the residual to the plane beside the gradient). Cost and place in the candidate list are
    packed in one integer, so that the search is a minimum; of equal costs the first candidate wins.
    """
    height, width = index.shape
    across = (width + TILE_W - 1) // TILE_W
    rows = TILE_H // step
    n = rows * TILE_W
    px, py = np.empty(n, np.float32), np.empty(n, np.float32)
    for i in range(rows):
        for j in range(TILE_W):
            px[i * TILE_W + j] = j
            py[i * TILE_W + j] = i * step + phase
    pixel = np.zeros((6, n), np.float32)
    cost, best = np.empty(n, np.float32), np.empty(n, np.int32)
    space, color, gradient_weight = np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[3])
    by_color, by_depth, by_gradient = weights[1] > 0, weights[2] > 0, weights[3] > 0
    for t in range(len(lists)):
        x0, y0 = (t % across) * TILE_W, (t // across) * TILE_H
        columns = min(TILE_W, width - x0)
        for i in range(rows):
            y = y0 + i * step + phase
            if y < height:
                measured = by_depth or by_gradient
                if columns == TILE_W:
                    _copy_row(lab, w, gradient, y, x0, TILE_W, i * TILE_W, pixel, by_color, measured, by_gradient)
                else:
                    _copy_row(lab, w, gradient, y, x0, columns, i * TILE_W, pixel, by_color, measured, by_gradient)
        best[:] = 2**31 - 1
        for slot in range(count[t]):
            center = centers[lists[t, slot]]
            cx, cy = center[X] - np.float32(x0), center[Y] - np.float32(y0)
            if by_color:
                cl, ca, cb = center[CL], center[CA], center[CB]
                for p in range(n):
                    dx, dy = px[p] - cx, py[p] - cy
                    dl, da, db = pixel[0, p] - cl, pixel[1, p] - ca, pixel[2, p] - cb
                    cost[p] = space * (dx * dx + dy * dy) + color * (dl * dl + da * da + db * db)
            else:
                for p in range(n):
                    dx, dy = px[p] - cx, py[p] - cy
                    cost[p] = space * (dx * dx + dy * dy)
            if by_depth:
                pa, pb, pc, kw, cap = center[PA], center[PB], center[PC], center[KW], center[CAP]
                for p in range(n):
                    r = pixel[3, p] - (pa * (px[p] - cx) + pb * (py[p] - cy) + pc)
                    term = min(kw * r * r, cap)
                    cost[p] += term if pixel[3, p] > 0 else np.float32(0)
            if by_gradient:
                ga, gb = center[GA], center[GB]
                for p in range(n):
                    dx, dy = pixel[4, p] - ga, pixel[5, p] - gb
                    term = gradient_weight * min(dx * dx + dy * dy, _GRADIENT_CAP)
                    cost[p] += term if pixel[3, p] > 0 else np.float32(0)
            for p in range(n):
                packed = np.int32((np.int32(min(cost[p], _COST_LIMIT) * _COST_STEPS) << 6) | slot)
                best[p] = packed if packed < best[p] else best[p]
        for i in range(rows):
            y = y0 + i * step + phase
            if y < height:
                for j in range(columns):
                    index[y, x0 + j] = lists[t, best[i * TILE_W + j] & 63]
