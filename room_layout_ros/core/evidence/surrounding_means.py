"""Descriptors of what lies around a superpixel: means over growing regions of clutter (docs/evidence.md).

The work that the paper takes its descriptors from (Ren, Bo, Fox, CVPR 2012, 4) puts together a superpixel's features
and those of the larger segments of a segmentation tree that it lies in. Here the larger segments are the superpixel
with all that is reached over so many borders.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..superpixels import Superpixels
from .match_kernels import Floats

REACHES = (3,)
"""Borders that may be crossed, a region each (docs/learning.md has the comparison)."""


def with_surroundings(superpixels: Superpixels, wanted: NDArray[np.bool_], features: Floats) -> Floats:
    """Put the means over a superpixel's surroundings beside its own features.

    Parameters
    ----------
    wanted : (K,) bool; only these are walked over and get surroundings. features : (K, D) float32, NaN not known.

    Returns
    -------
    (K, D (1 + len(REACHES))) float32
        A mean is weighted by area and over those of which the column is known; NaN where that is none.
    """
    first, neighbours = _adjacency(superpixels.edges, wanted)
    area = superpixels.pixels.astype(np.float32)
    return np.concatenate([features, *(region_means(first, neighbours, wanted, area, features, r) for r in REACHES)], 1)


@njit(cache=True, nogil=True)
def _adjacency(edges, wanted):  # type: ignore[no-untyped-def]
    """Neighbours of i that are wanted: those at first[i] to first[i + 1] of a list."""
    count = len(wanted)
    first = np.zeros(count + 1, np.int64)
    for e in range(len(edges)):
        if wanted[edges[e, 0]] and wanted[edges[e, 1]]:
            first[edges[e, 0] + 1] += 1
            first[edges[e, 1] + 1] += 1
    first = np.cumsum(first)
    place, neighbours = first[:-1].copy(), np.zeros(first[-1], np.int64)
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        if wanted[i] and wanted[j]:
            neighbours[place[i]], neighbours[place[j]] = j, i
            place[i] += 1
            place[j] += 1
    return first, neighbours


@njit(cache=True, nogil=True)
def region_means(first, neighbours, wanted, area, features, reach):  # type: ignore[no-untyped-def]
    """(K, D) float32 mean, weighted by area, over each wanted node and those up to `reach` steps from it; else NaN."""
    count, columns = features.shape
    means = np.full((count, columns), np.nan, np.float32)
    total, weight = np.zeros(columns, np.float32), np.zeros(columns, np.float32)
    queue, seen = np.zeros(count, np.int64), np.full(count, -1)
    for k in range(count):
        if not wanted[k]:
            continue
        queue[0], seen[k] = k, k
        start, end = 0, 1
        for _ in range(reach):
            layer = end
            for q in range(start, layer):
                for at in range(first[queue[q]], first[queue[q] + 1]):
                    other = neighbours[at]
                    if seen[other] != k:
                        seen[other] = k
                        queue[end] = other
                        end += 1
            start = layer
        total[:], weight[:] = 0.0, 0.0
        for q in range(end):
            own = area[queue[q]]
            for c in range(columns):
                value = features[queue[q], c]
                if value == value:
                    total[c] += own * value
                    weight[c] += own
        for c in range(columns):
            if weight[c] > 0.0:
                means[k, c] = total[c] / weight[c]
    return means
