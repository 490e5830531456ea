"""Merge neighbouring superpixels until a wanted number is left (Ward's criterion on colour and plane)."""

from __future__ import annotations

import numpy as np
from numba import njit

from .superpixel_sums import plane_sse, plane_variance


@njit(cache=True, nogil=True)
def merge_superpixels(sums, edges, wanted, color, depth, noise, noise_quantum, power):  # type: ignore[no-untyped-def]
    """Return the new id (K,) int32 of each superpixel, ascending in the lowest of its members, and their sums.

    Greedy: the pair of neighbours whose union costs least is joined, until `wanted` are left. The cost of a pair is
    the growth of its squared errors, color per unit of Lab and depth per variance of inverse depth, that is
    n_a n_b / (n_a + n_b) color |c_a - c_b|^2 + depth (SSE_ab - SSE_a - SSE_b) / noise^2 of the planes' residuals.
    """
    count = len(sums)
    sums = sums.copy()
    parent = np.arange(count)
    sse = np.empty(count)
    for k in range(count):
        sse[k] = plane_sse(sums[k])
    a, b = edges[:, 0].copy(), edges[:, 1].copy()
    m = len(a)
    cost = np.empty(m)
    best = 0
    for e in range(m):
        cost[e] = _pair_cost(sums, sse, a[e], b[e], color, depth, noise, noise_quantum, power)
        if cost[e] < cost[best]:
            best = e
    left = count
    while left > wanted and m > 0:
        keep, gone = min(a[best], b[best]), max(a[best], b[best])
        parent[gone] = keep
        sums[keep] += sums[gone]
        sse[keep] = plane_sse(sums[keep])
        left -= 1
        e, best = 0, 0
        while e < m:
            i, j = a[e], b[e]
            if i in (keep, gone) or j in (keep, gone):
                i, j = keep if i == gone else i, keep if j == gone else j
                if i == j:
                    m -= 1
                    a[e], b[e], cost[e] = a[m], b[m], cost[m]
                    continue
                a[e], b[e] = i, j
                cost[e] = _pair_cost(sums, sse, i, j, color, depth, noise, noise_quantum, power)
            if cost[e] < cost[best]:
                best = e
            e += 1
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


@njit(cache=True, nogil=True)
def _pair_cost(sums, sse, a, b, color, depth, noise, noise_quantum, power):  # type: ignore[no-untyped-def]
    s, t = sums[a], sums[b]
    n, m = s[0], t[0]
    weight = (n * m / (n + m)) ** power
    difference = 0.0
    for c in range(3, 6):
        difference += (s[c] / n - t[c] / m) ** 2
    cost = weight * color * difference
    if depth > 0 and s[9] > 0 and t[9] > 0:
        joint = s + t
        growth = max(0.0, plane_sse(joint) - sse[a] - sse[b])
        w = joint[15] / joint[9]
        variance = plane_variance(w, noise, noise_quantum)
        pairs = s[9] * t[9] / (s[9] + t[9])
        cost += weight * depth * min(growth / (variance * pairs), 100.0)
    return cost + 1e-9 * (n + m)
