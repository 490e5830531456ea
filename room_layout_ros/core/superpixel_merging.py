"""Merge neighbouring superpixels until a wanted number is left (Ward's criterion on colour and plane)."""

from __future__ import annotations

import numpy as np
from numba import njit

from .superpixel_sums import plane_sse, plane_sse_of_both, plane_variance

_BLOCK = 32
"""Costs of which the least is kept, so that after a change few have to be looked at."""

_DEPTH_CAP = 100.0
"""In variances of the depth: a step between two superpixels costs no more for being larger."""

_AREA_COST = 1e-9
"""Per pixel: of pairs that are all alike the smallest are joined first, and no cost is 0."""

_FIRST_COLOR, _AFTER_COLOR = 3, 6
"""Columns of the mean Lab in the sums."""


@njit(cache=True, nogil=True, error_model="numpy")
def merge_superpixels(sums, edges, wanted, color, depth, noise, noise_quantum, power):  # type: ignore[no-untyped-def]
    """Return the new id (K,) int32 of each superpixel, ascending in the lowest of its members, and their sums.

    Greedy: the pair of neighbours whose union costs least is joined, until `wanted` are left. The cost of a pair is
    the growth of its squared errors, color per unit of Lab and depth per variance of inverse depth, that is
    n_a n_b / (n_a + n_b) color |c_a - c_b|^2 + depth (SSE_ab - SSE_a - SSE_b) / noise^2 of the planes' residuals.
    """
    count, n_edges = len(sums), len(edges)
    sums, ends = sums.copy(), edges.copy()
    parent = np.arange(count)
    sse = np.empty(count)
    for k in range(count):
        sse[k] = plane_sse(sums[k])
    head, tail, following = _edges_of_nodes(ends, count)
    cost = np.empty(n_edges)
    for e in range(n_edges):
        cost[e] = _pair_cost(sums, sse, ends[e, 0], ends[e, 1], color, depth, noise, noise_quantum, power)
    bits = cost.view(np.int64)
    low = np.empty((n_edges + _BLOCK - 1) // _BLOCK, np.int64)
    for block in range(len(low)):
        low[block] = _least(bits, block)
    left = count
    while left > wanted and n_edges > 0:
        best = _first_least(bits, low)
        if cost[best] == np.inf:
            break
        keep, gone = min(ends[best]), max(ends[best])
        parent[gone] = keep
        sums[keep] += sums[gone]
        sse[keep] = plane_sse(sums[keep])
        left -= 1
        following[tail[keep]], tail[keep] = head[gone], tail[gone]
        place = head[keep]
        while place >= 0:  # the edges of both
            e = place // 2
            if e < n_edges:
                ends[e, place % 2] = keep
                i, j = ends[e]
                if i == j:
                    cost[e] = np.inf
                else:
                    cost[e] = _pair_cost(sums, sse, i, j, color, depth, noise, noise_quantum, power)
                low[e // _BLOCK] = _least(bits, e // _BLOCK)
            place = following[place]
    ids = np.empty(count, np.int32)
    n = 0
    for k in range(count):
        if parent[k] == k:
            ids[k] = n
            n += 1
        else:
            parent[k] = parent[parent[k]]
            ids[k] = ids[parent[k]]
    merged = np.empty((n, sums.shape[1]))
    for k in range(count):
        if parent[k] == k:
            merged[ids[k]] = sums[k]
    return ids, merged


@njit(cache=True, nogil=True, error_model="numpy")
def _edges_of_nodes(ends, count):  # type: ignore[no-untyped-def]
    """Linked lists of the edges of each node: first and last place per node, next place; place 2 e + side, -1 ends.

    Each list begins with a place of its own behind those of the edges, so that none is empty.
    """
    n = 2 * len(ends)
    following = np.full(n + count, -1)
    head, tail = np.arange(n, n + count), np.arange(n, n + count)
    for place in range(n):
        node = ends[place // 2, place % 2]
        following[tail[node]], tail[node] = place, place
    return head, tail, following


@njit(cache=True, nogil=True, error_model="numpy")
def _least(bits, block):  # type: ignore[no-untyped-def]
    """Bits of the least cost of a block: they are in the order of the costs, of which none is below 0.

    Minima of whole numbers run in vector registers, those of float64 do not (NaN).
    """
    least = bits[block * _BLOCK]
    for e in range(block * _BLOCK, min((block + 1) * _BLOCK, len(bits))):
        least = min(least, bits[e])
    return least


@njit(cache=True, nogil=True, error_model="numpy")
def _first_least(bits, low):  # type: ignore[no-untyped-def]
    """Place of the first of the least costs, given the bits of the least of each block."""
    least, block = low[0], 0
    for k in range(len(low)):
        least = min(least, low[k])
    while low[block] != least:
        block += 1
    e = block * _BLOCK
    while bits[e] != least:
        e += 1
    return e


@njit(cache=True, nogil=True, error_model="numpy")
def _pair_cost(sums, sse, a, b, color, depth, noise, noise_quantum, power):  # type: ignore[no-untyped-def]
    """Cost of joining two superpixels, see `merge_superpixels`; the area counts with a power of its own."""
    n, m = sums[a, 0], sums[b, 0]
    weight = (n * m / (n + m)) ** power
    difference = 0.0
    for c in range(_FIRST_COLOR, _AFTER_COLOR):
        difference += (sums[a, c] / n - sums[b, c] / m) ** 2
    cost = weight * color * difference
    in_a, in_b = sums[a, 9], sums[b, 9]
    if depth > 0 and in_a > 0 and in_b > 0:
        growth = max(0.0, plane_sse_of_both(sums, a, b) - sse[a] - sse[b])
        w = (sums[a, 15] + sums[b, 15]) / (in_a + in_b)
        variance = plane_variance(w, noise, noise_quantum)
        pairs = in_a * in_b / (in_a + in_b)
        cost += weight * depth * min(growth / (variance * pairs), _DEPTH_CAP)
    return cost + _AREA_COST * (n + m)
