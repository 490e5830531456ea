"""Kernels of depth-aware SLIC: tiles, assignment of pixels to centres, means of the centres (paper 3.1)."""

from __future__ import annotations

import numpy as np
from numba import njit

TILE_H, TILE_W = 8, 16
"""A tile's pixels lie together (one cache line a row and channel), so the loops over them run in vector registers."""

MAX_CANDIDATES = 64
"""Centres compared per tile; six bits of the packed cost."""

# channels of the tiled image
L, A, B, W, M, GX, GY = range(7)
N_CHANNELS = 7
"""Lab, inverse depth and whether it was measured; gradient of inverse depth (0 where not measured)."""

# columns of a centre
X, Y, CL, CA, CB, PA, PB, PC, KW, CAP, GA, GB = range(12)
N_CENTER = 12
"""Position; mean Lab; plane w = PA (x - X) + PB (y - Y) + PC, weight and cap of its residual; mean gradient."""

N_SUMS = 18
"""n, x, y, L, a, b; measured, gradient (2); plane's inliers m, x, y, xx, xy, yy, w, xw, yw."""

_COST_STEPS = np.float32(2.0**14)
_COST_LIMIT = np.float32(2.0**10 - 1.0)
_NEUTRAL = 1.0
"""Cost of a measured pixel at a centre without plane: that of a usual residual, so that neither is preferred."""

_MIN_PLANE_PIXELS = 6.0


@njit(cache=True, nogil=True)
def tile_image(lab, inverse_depth, gradient, has_color, has_depth, has_gradient, height, width):  # type: ignore[no-untyped-def]
    """Return (tiles down, tiles across, channels, pixels of a tile) float32; the last rows and columns repeated."""
    down, across = (height + TILE_H - 1) // TILE_H, (width + TILE_W - 1) // TILE_W
    tiles = np.zeros((down, across, N_CHANNELS, TILE_H * TILE_W), np.float32)
    for ty in range(down):
        for i in range(TILE_H):
            y = min(ty * TILE_H + i, height - 1)
            for tx in range(across):
                tile = tiles[ty, tx]
                x0 = tx * TILE_W
                for j in range(TILE_W):
                    x = min(x0 + j, width - 1)
                    p = i * TILE_W + j
                    if has_color:
                        tile[0, p] = lab[y, x, 0] * np.float32(100.0 / 255.0)
                        tile[1, p] = lab[y, x, 1]
                        tile[2, p] = lab[y, x, 2]
                    if has_depth:
                        w = inverse_depth[y, x]
                        tile[3, p] = w
                        tile[4, p] = np.float32(1.0) if w > 0 else np.float32(0.0)
                    if has_gradient:
                        tile[5, p] = gradient[y, x, 0]
                        tile[6, p] = gradient[y, x, 1]
    return tiles


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
        if count[t] == 0:  # nobody near: take the nearest centre
            cx, cy = (t % across + 0.5) * TILE_W, (t // across + 0.5) * TILE_H
            nearest, best = 0, np.inf
            for k in range(len(centers)):
                far = (centers[k, X] - cx) ** 2 + (centers[k, Y] - cy) ** 2
                if far < best:
                    best, nearest = far, k
            lists[t, 0], count[t] = nearest, 1
    return lists, count


@njit(cache=True, nogil=True, fastmath={"contract"})
def assign(tiles, centers, lists, count, step, phase, space, color, gradient, depth, index):  # type: ignore[no-untyped-def]
    """Write into `index` (H, W) the centre of least energy, for every `step`-th row of each tile from `phase` on.

    Energy of pixel p at centre s (paper 3.1, eq. 1, with the residual to the plane as depth term):
    space |p - mu|^2 + color |I - c|^2 + gradient |g - g_s|^2 + m min(KW (w - plane(p))^2, CAP)
    """
    height, width = index.shape
    across = tiles.shape[1]
    rows = TILE_H // step
    n = rows * TILE_W
    px, py = np.empty(n, np.float32), np.empty(n, np.float32)
    for i in range(rows):
        for j in range(TILE_W):
            px[i * TILE_W + j] = j
            py[i * TILE_W + j] = i * step + phase
    pixel = np.empty((N_CHANNELS, n), np.float32)
    cost, best = np.empty(n, np.float32), np.empty(n, np.int32)
    space, color, gradient = np.float32(space), np.float32(color), np.float32(gradient)
    for t in range(len(lists)):
        ty, tx = t // across, t % across
        if step == 1:
            source = tiles[ty, tx]
        else:
            source = pixel
            for c in range(N_CHANNELS):
                for i in range(rows):
                    for j in range(TILE_W):
                        pixel[c, i * TILE_W + j] = tiles[ty, tx, c, (i * step + phase) * TILE_W + j]
        best[:] = 2**31 - 1
        for slot in range(count[t]):
            center = centers[lists[t, slot]]
            cx, cy = center[X] - np.float32(tx * TILE_W), center[Y] - np.float32(ty * TILE_H)
            cl, ca, cb = center[CL], center[CA], center[CB]
            for p in range(n):
                dx, dy = px[p] - cx, py[p] - cy
                dl, da, db = source[0, p] - cl, source[1, p] - ca, source[2, p] - cb
                cost[p] = space * (dx * dx + dy * dy) + color * (dl * dl + da * da + db * db)
            if depth:
                pa, pb, pc, kw, cap = center[PA], center[PB], center[PC], center[KW], center[CAP]
                for p in range(n):
                    r = source[3, p] - (pa * (px[p] - cx) + pb * (py[p] - cy) + pc)
                    cost[p] += source[4, p] * min(kw * r * r, cap)
            if gradient > 0:
                ga, gb = center[GA], center[GB]
                for p in range(n):
                    dx, dy = source[5, p] - ga, source[6, p] - gb
                    cost[p] += source[4, p] * min(gradient * (dx * dx + dy * dy), np.float32(16.0))
            for p in range(n):
                packed = np.int32((np.int32(min(cost[p], _COST_LIMIT) * _COST_STEPS) << 6) | slot)
                best[p] = packed if packed < best[p] else best[p]
        for i in range(rows):
            y = ty * TILE_H + i * step + phase
            if y < height:
                for j in range(min(TILE_W, width - tx * TILE_W)):
                    index[y, tx * TILE_W + j] = lists[t, best[i * TILE_W + j] & 63]


@njit(cache=True, nogil=True)
def accumulate(tiles, centers, step, phase, index, sums):  # type: ignore[no-untyped-def]
    """Add the pixels of every `step`-th row of each tile to the sums (K, N_SUMS) of their centres.

    A pixel whose residual is capped at its centre is no part of the centre's plane: that makes the fit the exact
    minimiser of the capped energy for fixed inliers.
    """
    height, width = index.shape
    across = tiles.shape[1]
    for y in range(phase, height, step):
        ty, row = y // TILE_H, (y % TILE_H) * TILE_W
        for tx in range(across):
            tile = tiles[ty, tx]
            x, last = tx * TILE_W, min(width, (tx + 1) * TILE_W)
            while x < last:
                k = index[y, x]
                first = x
                cx, cy, pa, pb, pc = centers[k, X], centers[k, Y], centers[k, PA], centers[k, PB], centers[k, PC]
                kw, cap = centers[k, KW], centers[k, CAP]
                sl, sa, sb = np.float32(0), np.float32(0), np.float32(0)
                m, mx, mxx, mw, mxw = 0.0, 0.0, 0.0, 0.0, 0.0
                seen, gx, gy = np.float32(0), np.float32(0), np.float32(0)
                while x < last and index[y, x] == k:
                    p = row + x - tx * TILE_W
                    sl += tile[0, p]
                    sa += tile[1, p]
                    sb += tile[2, p]
                    if tile[4, p] > 0:
                        w = tile[3, p]
                        seen += np.float32(1)
                        gx += tile[5, p]
                        gy += tile[6, p]
                        r = w - (pa * (x - cx) + pb * (y - cy) + pc)
                        if kw * r * r <= cap:
                            m += 1.0
                            mx += x
                            mxx += x * x
                            mw += w
                            mxw += x * w
                    x += 1
                n = x - first
                s = sums[k]
                s[0] += n
                s[1] += n * (first + x - 1) * 0.5
                s[2] += n * y
                s[3] += sl
                s[4] += sa
                s[5] += sb
                s[6] += seen
                s[7] += gx
                s[8] += gy
                s[9] += m
                s[10] += mx
                s[11] += m * y
                s[12] += mxx
                s[13] += mx * y
                s[14] += m * y * y
                s[15] += mw
                s[16] += mxw
                s[17] += mw * y


@njit(cache=True, nogil=True)
def move_centers(sums, centers, noise, noise_quantum, weight, cap):  # type: ignore[no-untyped-def]
    """Set each centre to the means and the least-squares plane of its pixels; a centre without pixels stays.

    The residual of inverse depth is weighed by 1 / (noise^2 + (noise_quantum w^2)^2): a structured-light sensor's
    error is constant in w, that of depth rounded to steps of Z is constant in Z.
    """
    for k in range(len(centers)):
        s, c = sums[k], centers[k]
        n = s[0]
        if n == 0:
            continue
        c[X], c[Y] = s[1] / n, s[2] / n
        c[CL], c[CA], c[CB] = s[3] / n, s[4] / n, s[5] / n
        if s[6] > 0:
            c[GA], c[GB] = s[7] / s[6], s[8] / s[6]
        a, b, w, m = plane_of_sums(s, c[X], c[Y])
        if m >= _MIN_PLANE_PIXELS:
            c[PA], c[PB], c[PC] = a, b, w
            c[KW] = weight / (noise * noise + (noise_quantum * w * w) ** 2)
            c[CAP] = weight * cap
        else:
            c[PA], c[PB], c[PC] = 0.0, 0.0, 0.0
            c[KW], c[CAP] = np.inf, weight * _NEUTRAL


@njit(cache=True, nogil=True)
def plane_of_sums(s, x0, y0):  # type: ignore[no-untyped-def]
    """Return the least-squares plane w = a (x - x0) + b (y - y0) + w0 of the sums, and its number of pixels.

    Where the pixels do not span a plane (a line of them), the slopes they cannot tell are 0.
    """
    m = s[9]
    if m < _MIN_PLANE_PIXELS:
        return 0.0, 0.0, 0.0, 0.0
    mx, my, mw = s[10] / m, s[11] / m, s[15] / m
    xx, xy, yy = s[12] / m - mx * mx, s[13] / m - mx * my, s[14] / m - my * my
    xw, yw = s[16] / m - mx * mw, s[17] / m - my * mw
    xx, yy = xx + 0.05, yy + 0.05  # a ridge of a twentieth of a pixel's variance
    det = xx * yy - xy * xy
    a, b = (yy * xw - xy * yw) / det, (xx * yw - xy * xw) / det
    return a, b, mw + a * (x0 - mx) + b * (y0 - my), m
