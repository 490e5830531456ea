"""The edges of a room in the picture: where near each edge of a cuboid the grey values change, and what that tells.

As model-based tracking does: along the projection of each edge between two faces, piece by piece, the picture is
averaged along the edge and searched across it. Each place of steepest change is a candidate; baseboards, planks and the
seams of carpets make some too. A piece weighs each of its candidates by how near it is, the other edges and the depth
being part of the fit, so that the consistent ones decide. Pieces beside clutter are not asked: what is steep there is
the outline of a thing.
"""

from __future__ import annotations

import numpy as np
from numba import njit

PIECE_PX = 8
"""Length of the pieces of an edge. At 1 degree of error its ends are 0.1 px off."""

_SAMPLE_PX = 2
"""Along a piece, every second place is looked at."""

_SIGMA_PX = 1.5
"""Of one candidate about the edge: rounded corners, lens, sealing."""

_LEAST_STEP = 4.0
"""Grey levels between one side and the other; noise of 3 levels a pixel makes 1."""

_NOTHING = 0.3
"""Weight of "none of the candidates is the edge", that of one on the edge being 1."""

_BORDER = 0.016
"""Share of the image's width: registered pictures have a white border."""

_ASIDE_PX = 5.0
"""Of the two places on either side of a piece that must not be clutter, the nearer one."""

_WING = 2
"""Pixels on either side of a step."""


@njit(cache=True, nogil=True)
def edge_candidates(gray, index, clutter, intrinsics, m, reach):  # type: ignore[no-untyped-def]
    """(n, 5) candidates: piece, the two faces, ray x and y; those of a piece one after the other.

    Parameters
    ----------
    gray : (H, W) uint8. index : (H, W) int32 superpixels. clutter : (K,) bool.
    intrinsics : fx, fy, cx, cy. m : (5, 3) rows n_k / d_k. reach : px, how far off the edge to look.
    """
    height, width = gray.shape
    found = np.empty((10 * ((width + height) // PIECE_PX + 1) * (reach + 1), 5))
    count, piece = 0, 0
    profile = np.empty(2 * (reach + _WING) + 1)
    for a in range(5):
        for b in range(a + 1, 5):
            line = _edge_line(m, a, b, intrinsics, (width, height))
            start, end = _seen_part(m, a, b, line, intrinsics, (width, height))
            for k in range(int((end - start) / PIECE_PX)):
                at = start + k * PIECE_PX
                if not _is_open(index, clutter, line, at + 0.5 * PIECE_PX):
                    continue
                _average_along(gray, line, at, profile)
                before = count
                for offset in _steps(profile, reach):
                    found[count, 0], found[count, 1], found[count, 2] = piece, a, b
                    x, y = _point(line, at + 0.5 * PIECE_PX, offset)
                    found[count, 3], found[count, 4] = (
                        (x - intrinsics[2]) / intrinsics[0],
                        (y - intrinsics[3]) / intrinsics[1],
                    )
                    count += 1
                piece += count > before
    return found[:count]


@njit(cache=True, nogil=True)
def _edge_line(m, a, b, intrinsics, size):  # type: ignore[no-untyped-def]
    """(x, y, nx, ny) of the line in which faces a and b meet: its point next to the image's centre, unit normal."""
    fx, fy, cx, cy = intrinsics
    across, down, rest = m[a, 0] - m[b, 0], m[a, 1] - m[b, 1], m[a, 2] - m[b, 2]
    nx, ny = across / fx, down / fy
    length = np.sqrt(nx * nx + ny * ny)
    if length < 1e-12:
        return 0.0, 0.0, 0.0, 0.0
    x, y = 0.5 * size[0], 0.5 * size[1]
    off = (nx * (x - cx) + ny * (y - cy) + rest) / length
    nx, ny = nx / length, ny / length
    return x - off * nx, y - off * ny, nx, ny


@njit(cache=True, nogil=True, inline="always")
def _point(line, along, offset):  # type: ignore[no-untyped-def]
    """(x, y) px of the place so far along the line and so far off it."""
    x, y, nx, ny = line
    return x - ny * along + nx * offset, y + nx * along + ny * offset


@njit(cache=True, nogil=True)
def _seen_part(m, a, b, line, intrinsics, size):  # type: ignore[no-untyped-def]
    """(Start, end) along the line where it is in the image and no third face is before it; end <= start for none."""
    fx, fy, cx, cy = intrinsics
    x, y, nx, ny = line
    low, high = -1e5, 1e5
    if (nx == 0.0 and ny == 0.0) or (m[a] == 0.0).all() or (m[b] == 0.0).all():
        return 0.0, 0.0
    border = _BORDER * size[0]
    for c in range(5):
        if c == b:
            continue
        u, v, w = m[a, 0], m[a, 1], m[a, 2]  # of face a itself: in front of the camera
        if c != a:
            u, v, w = u - m[c, 0], v - m[c, 1], w - m[c, 2]
        low, high = _cut(u / fx * (x - cx) + v / fy * (y - cy) + w, v / fy * nx - u / fx * ny, low, high)
    low, high = _cut(x - border, -ny, low, high)
    low, high = _cut(size[0] - 1.0 - border - x, ny, low, high)
    low, high = _cut(y - border, nx, low, high)
    return _cut(size[1] - 1.0 - border - y, -nx, low, high)


@njit(cache=True, nogil=True, inline="always")
def _cut(value, slope, low, high):  # type: ignore[no-untyped-def]
    """The part of (low, high) where value + slope t >= 0."""
    if slope > 1e-12:
        low = max(low, -value / slope)
    elif slope < -1e-12:
        high = min(high, -value / slope)
    elif value < 0.0:
        high = low
    return low, high


@njit(cache=True, nogil=True)
def _is_open(index, clutter, line, along):  # type: ignore[no-untyped-def]
    """Whether there is structure on both sides of a piece."""
    for aside in (-2.0 * _ASIDE_PX, -_ASIDE_PX, _ASIDE_PX, 2.0 * _ASIDE_PX):
        x, y = _point(line, along, aside)
        column, row = int(x + 0.5), int(y + 0.5)
        if x < 0 or y < 0 or column >= index.shape[1] or row >= index.shape[0] or clutter[index[row, column]]:
            return False
    return True


@njit(cache=True, nogil=True)
def _average_along(gray, line, at, profile):  # type: ignore[no-untyped-def]
    """Fill the mean grey value of a piece by pixels off the edge, side to side; -1 beyond the image."""
    height, width = gray.shape
    border, half = _BORDER * width, len(profile) // 2
    for k in range(len(profile)):
        total = 0.0
        for along in range(0, PIECE_PX, _SAMPLE_PX):
            x, y = _point(line, at + along + 0.5 * _SAMPLE_PX, float(k - half))
            if x < border or y < border or x >= width - 1 - border or y >= height - 1 - border:
                total = -1e9
                break
            column, row = int(x), int(y)
            right, down = x - column, y - row
            above = gray[row, column] * (1.0 - right) + gray[row, column + 1] * right
            below = gray[row + 1, column] * (1.0 - right) + gray[row + 1, column + 1] * right
            total += above * (1.0 - down) + below * down
        profile[k] = total * _SAMPLE_PX / PIECE_PX if total >= 0.0 else -1.0


@njit(cache=True, nogil=True)
def _steps(profile, reach):  # type: ignore[no-untyped-def]
    """Offsets, to a part of a pixel, of the steepest places of a profile."""
    steep, offsets, n = np.zeros(2 * reach + 1), np.empty(reach + 1), 0
    for k in range(2 * reach + 1):
        p, q, r, s = profile[k], profile[k + 1], profile[k + _WING + 1], profile[k + 2 * _WING]
        if min(min(p, q), min(r, s)) >= 0.0:
            steep[k] = abs(r + s - p - q) / _WING
    for k in range(1, 2 * reach):
        before, here, after = steep[k - 1], steep[k], steep[k + 1]
        if here > _LEAST_STEP and here > before and here >= after:
            offsets[n] = k - reach + 0.5 * (before - after) / (before + after - 2.0 * here)
            n += 1
    return offsets[:n]


@njit(cache=True, nogil=True)
def add_edges(candidates, m, focal, sigma_px, A, g):  # type: ignore[no-untyped-def]
    """Add what the candidates say to the equations (A (8, 8), g (8,)) of turn and logarithms of the distances.

    A candidate at the ray r is off the edge of faces a and b by l . r / |l|, l = m_a - m_b, |l| by pixels. It counts by
    exp(-off^2 / 2 sigma_px^2), together with the others of its piece not more than once.
    """
    J = np.zeros(8)
    first = 0
    while first < len(candidates):
        last, total = first, _NOTHING
        while last < len(candidates) and candidates[last, 0] == candidates[first, 0]:
            total += _nearness(_off_edge(candidates[last], m, focal)[0], sigma_px)
            last += 1
        for k in range(first, last):
            off, scale = _off_edge(candidates[k], m, focal)
            weight = _nearness(off, sigma_px) / (total * _SIGMA_PX * _SIGMA_PX)
            a, b = int(candidates[k, 1]), int(candidates[k, 2])
            x, y = candidates[k, 3], candidates[k, 4]
            p, q, r = m[a, 0] - m[b, 0], m[a, 1] - m[b, 1], m[a, 2] - m[b, 2]
            J[:] = 0.0
            J[0], J[1], J[2] = (q - r * y) * scale, (r * x - p) * scale, (p * y - q * x) * scale
            J[3 + a] = -(m[a, 0] * x + m[a, 1] * y + m[a, 2]) * scale
            J[3 + b] = (m[b, 0] * x + m[b, 1] * y + m[b, 2]) * scale
            for i in range(8):
                g[i] -= weight * J[i] * off
                for j in range(8):
                    A[i, j] += weight * J[i] * J[j]
        first = last


@njit(cache=True, nogil=True, inline="always")
def _nearness(off, sigma_px):  # type: ignore[no-untyped-def]
    return np.exp(-0.5 * off * off / (sigma_px * sigma_px))


@njit(cache=True, nogil=True, inline="always")
def _off_edge(candidate, m, focal):  # type: ignore[no-untyped-def]
    """(Pixels by which a candidate is off its edge, pixels per unit of l . r)."""
    a, b = int(candidate[1]), int(candidate[2])
    p, q, r = m[a, 0] - m[b, 0], m[a, 1] - m[b, 1], m[a, 2] - m[b, 2]
    slope = np.sqrt((p / focal[0]) ** 2 + (q / focal[1]) ** 2)
    scale = 1.0 / max(slope, 1e-12)
    return (p * candidate[3] + q * candidate[4] + r) * scale, scale
