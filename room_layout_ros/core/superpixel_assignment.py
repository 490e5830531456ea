"""Kernels of depth-aware SLIC: which centre each pixel belongs to (paper 3.1)."""

from __future__ import annotations

import numpy as np
from numba import njit

TILE_H, TILE_W = 8, 16
"""Rows and columns of a tile. Its pixels share a list of candidates and are copied together, so that the loops over
them run in vector registers; where rows are left out, a tile has as many rows and is as much higher."""

_N = TILE_H * TILE_W

_SLOT_BITS = 6
MAX_CANDIDATES = 1 << _SLOT_BITS
"""Centres compared per tile; the lowest bits of the packed cost tell which."""

# columns of a centre
X, Y, CL, CA, CB, PA, PB, PC, KW, CAP, GA, GB = range(12)
N_CENTER = 12
"""Position; mean Lab; plane w = PA (x - X) + PB (y - Y) + PC, weight and cap of its residual; mean gradient."""

L_SCALE, AB_OFFSET = np.float32(100.0 / 255.0), np.float32(128.0)

_COST_STEPS = np.float32(2.0**14)
"""Per unit of energy: a power of two, so that weights times it round as without."""
_COST_LIMIT = np.float32(2.0**10 - 1.0) * _COST_STEPS
_WORST = 2**31 - 1
"""Above every packed cost."""

_GRADIENT_CAP = np.float32(16.0) * _COST_STEPS


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
        first_x, last_x = max(0, int((x - reach) / TILE_W)), min(across - 1, int((x + reach) / TILE_W))
        first_y, last_y = max(0, int((y - reach) / tile_h)), min(down - 1, int((y + reach) / tile_h))
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
def first_row(step, rows):  # type: ignore[no-untyped-def]
    """Return the first of every `step`-th row: in the middle of the rows that it stands for, if there is such a row."""
    return step // 2 if rows > step // 2 else 0


@njit(cache=True, nogil=True)
def _read_tiles(lab, w, first, step, row, tiles):  # type: ignore[no-untyped-def]
    """Write L, a, b and inverse depth of a strip's pixels into `tiles` (n, 6, _N); rows beyond the image stay.

    A row is converted as a whole, into `row` (4, n TILE_W), in vector registers, and then copied two float32 at a time,
    as one int64. Beyond the image's width `row` is 0.
    """
    pairs, pairs_of_tiles = row.view(np.int64), tiles.view(np.int64)
    for i in range(TILE_H):
        if first + i * step < len(w):
            _read_row(lab, w, first + i * step, row)
            _copy_row(pairs, i * TILE_W // 2, pairs_of_tiles)


@njit(cache=True, nogil=True)
def _read_row(lab, w, y, row):  # type: ignore[no-untyped-def]
    for x in range(w.shape[1]):
        row[0, x] = np.float32(lab[0, y, x]) * L_SCALE
    for x in range(w.shape[1]):
        row[1, x] = np.float32(lab[1, y, x]) - AB_OFFSET
    for x in range(w.shape[1]):
        row[2, x] = np.float32(lab[2, y, x]) - AB_OFFSET
    for x in range(w.shape[1]):
        row[3, x] = w[y, x]


@njit(cache=True, nogil=True)
def _copy_row(pairs, at, tiles):  # type: ignore[no-untyped-def]
    for c in range(4):
        for t in range(len(tiles)):
            for j in range(TILE_W // 2):
                tiles[t, c, at + j] = pairs[c, t * (TILE_W // 2) + j]


@njit(cache=True, nogil=True)
def _read_gradient(gradient, first, step, tiles):  # type: ignore[no-untyped-def]
    """Write the gradient of a strip's pixels into `tiles` (n, 6, _N), behind the four that `_read_tiles` writes."""
    _, rows, width = gradient.shape
    for i in range(TILE_H):
        y = first + i * step
        if y < rows:
            for t in range(len(tiles)):
                for j in range(min(TILE_W, width - t * TILE_W)):
                    tiles[t, 4, i * TILE_W + j] = gradient[0, y, t * TILE_W + j]
                    tiles[t, 5, i * TILE_W + j] = gradient[1, y, t * TILE_W + j]


@njit(cache=True, nogil=True)
def _add_gradient(pixel, center, weight, plain, cost):  # type: ignore[no-untyped-def]
    """Write the costs `plain` of a tile's pixels and that of their gradients at a centre into `cost`."""
    for p in range(_N):
        dx, dy = pixel[4, p] - center[GA], pixel[5, p] - center[GB]
        term = min(weight * (dx * dx + dy * dy), _GRADIENT_CAP)
        cost[p] = plain[p] + (term if pixel[3, p] > np.float32(0) else np.float32(0))


@njit(cache=True, nogil=True, fastmath={"contract"})
def assign(lab, w, gradient, centers, lists, count, step, row_px, weights, index):  # type: ignore[no-untyped-def]
    """Write into `index` (rows, W) the centre of least energy, for every `step`-th row from `first_row(step, rows)` on.

    Row i of the images is at y = row_px i of the frame.

    Energy of pixel p at centre s, weights = (space, color, depth?, gradient):
    space |p - mu|^2 + color |I - c|^2 + [measured] (min(KW (w - plane(p))^2, CAP) + gradient |g - g_s|^2)
    (the energy of paper 3.1, with the residual to the plane beside the gradient). Cost, in steps, and place in the
    candidate list are packed in one integer, so that the search is a minimum; of equal costs the first candidate wins.
    """
    height, width = index.shape
    phase = first_row(step, height)
    across = (width + TILE_W - 1) // TILE_W
    px, py = np.empty(_N, np.float32), np.empty(_N, np.float32)
    for p in range(_N):
        px[p], py[p] = p % TILE_W, (p // TILE_W * step + phase) * row_px
    row, tiles = np.zeros((4, across * TILE_W), np.float32), np.zeros((across, 6, _N), np.float32)
    own, plain, best = np.empty(_N, np.float32), np.empty(_N, np.float32), np.empty(_N, np.int32)
    zero, two = np.float32(0), np.float32(2)
    space, color = np.float32(weights[0]) * _COST_STEPS, np.float32(weights[1]) * _COST_STEPS
    depth, gradient_weight = np.float32(weights[2]) * _COST_STEPS, np.float32(weights[3]) * _COST_STEPS
    by_gradient = weights[3] > 0
    for strip in range(len(lists) // across):
        first = strip * TILE_H * step
        _read_tiles(lab, w, first + phase, step, row, tiles)
        if by_gradient:
            _read_gradient(gradient, first + phase, step, tiles)
        for tx in range(across):
            t, x0 = strip * across + tx, tx * TILE_W
            pixel = tiles[tx]
            for p in range(_N):
                best[p] = _WORST
                lab2 = pixel[0, p] * pixel[0, p] + pixel[1, p] * pixel[1, p] + pixel[2, p] * pixel[2, p]
                own[p] = space * (px[p] * px[p] + py[p] * py[p]) + color * lab2
            if by_gradient:
                plain[:] = own
            for slot in range(count[t]):
                # |p - s|^2 multiplied out: |p|^2 is the tile's, |s|^2 the centre's, and the rest is linear in the pixel
                center = centers[lists[t, slot]]
                cx, cy = center[X] - np.float32(x0), center[Y] - np.float32(first * row_px)
                cl, ca, cb = center[CL], center[CA], center[CB]
                k0 = space * (cx * cx + cy * cy) + color * (cl * cl + ca * ca + cb * cb)
                kx, ky = two * space * cx, two * space * cy
                kl, ka, kb = two * color * cl, two * color * ca, two * color * cb
                pa, pb, kw, cap = center[PA], center[PB], center[KW] * depth, center[CAP] * _COST_STEPS
                pc = center[PC] - pa * cx - pb * cy
                if by_gradient:
                    _add_gradient(pixel, center, gradient_weight, plain, own)
                for p in range(_N):
                    w_p = pixel[3, p]
                    r = w_p - (pa * px[p] + pb * py[p] + pc)
                    fit = kw * r * r
                    fit = cap if fit > cap else fit
                    fit = fit if w_p > zero else zero
                    linear = kx * px[p] + ky * py[p] + kl * pixel[0, p] + ka * pixel[1, p] + kb * pixel[2, p]
                    cost = own[p] + k0 - linear + fit
                    cost = _COST_LIMIT if cost > _COST_LIMIT else cost
                    packed = np.int32((np.int32(cost) << _SLOT_BITS) | slot)
                    best[p] = packed if packed < best[p] else best[p]
            for i in range(min(TILE_H, (height - first - phase + step - 1) // step)):
                y = first + phase + i * step
                for j in range(min(TILE_W, width - x0)):
                    index[y, x0 + j] = lists[t, best[i * TILE_W + j] & (MAX_CANDIDATES - 1)]
