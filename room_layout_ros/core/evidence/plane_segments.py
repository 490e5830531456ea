"""Relations between touching superpixels in depth, and the plane segments that coplanar ones make up together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..superpixels import Superpixels

_JUMP_M = 0.08
_JUMP_QUADRATIC = 0.02
_SAME_NORMAL_COS = float(np.cos(np.deg2rad(14.0)))
_CREASE_COS = float(np.cos(np.deg2rad(25.0)))


@dataclass(frozen=True, slots=True)
class PlaneSegments:
    """Superpixels grouped into planes, and what their borders look like.

    Attributes
    ----------
    segment : (K,) int32
        Segment of each superpixel, 0..S-1; one without a plane is alone.
    count : S.
    border : (K, 5) float32
        Share of the border (by length) where the neighbour is farther away, nearer, coplanar, meets in a concave
        crease (as walls do) or in a convex one (as a box's sides do); the rest has no depth.
    """

    segment: NDArray[np.int32]
    count: int
    border: NDArray[np.float32]


def compute_plane_segments(
    superpixels: Superpixels, normal: NDArray[np.float64], distance: NDArray[np.float64], point: NDArray[np.float64]
) -> PlaneSegments:
    """Join touching superpixels that lie on one plane.

    Parameters
    ----------
    normal : (K, 3) float64 unit normals away from the camera; NaN without plane.
    distance : (K,) float64 of the planes to the camera, m.
    point : (K, 3) float64 centroids in the same frame, m; NaN without depth.
    """
    kind, cost = _relate(superpixels.edges, normal, distance, point)
    border = _border_shares(superpixels.count, superpixels.edges, superpixels.edge_length, kind)
    segment, count = _join(superpixels.count, superpixels.edges, kind, np.argsort(cost, kind="stable"))
    return PlaneSegments(segment, count, border)


@njit(cache=True, nogil=True)
def _relate(edges, normal, distance, point):  # type: ignore[no-untyped-def]
    """Kind of each edge seen from its first superpixel (-1 unknown) and its deviation from coplanarity."""
    kind = np.full(edges.shape[0], -1, np.int64)
    cost = np.full(edges.shape[0], np.inf)
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        if np.isnan(distance[i]) or np.isnan(distance[j]) or np.isnan(point[i, 0]) or np.isnan(point[j, 0]):
            continue
        cosine = 0.0
        off_i = -distance[i]  # of j's centroid from i's plane, positive beyond it
        off_j = -distance[j]
        range_i = range_j = 0.0
        for k in range(3):
            cosine += normal[i, k] * normal[j, k]
            off_i += normal[i, k] * point[j, k]
            off_j += normal[j, k] * point[i, k]
            range_i += point[i, k] ** 2
            range_j += point[j, k] ** 2
        range_i, range_j = np.sqrt(range_i), np.sqrt(range_j)
        tolerance = _JUMP_M + _JUMP_QUADRATIC * max(range_i, range_j) ** 2
        # depth of both planes along the ray through the middle of the two centroids
        m0 = point[i, 0] / range_i + point[j, 0] / range_j
        m1 = point[i, 1] / range_i + point[j, 1] / range_j
        m2 = point[i, 2] / range_i + point[j, 2] / range_j
        length = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
        along_i = (normal[i, 0] * m0 + normal[i, 1] * m1 + normal[i, 2] * m2) / length
        along_j = (normal[j, 0] * m0 + normal[j, 1] * m1 + normal[j, 2] * m2) / length
        at_i = distance[i] / max(along_i, 0.1)
        at_j = distance[j] / max(along_j, 0.1)
        if cosine > _SAME_NORMAL_COS and abs(off_i) < tolerance and abs(off_j) < tolerance:
            kind[e] = 2
            cost[e] = max(abs(off_i), abs(off_j)) / tolerance
        elif at_j - at_i > 1.5 * tolerance:
            kind[e] = 0
        elif at_i - at_j > 1.5 * tolerance:
            kind[e] = 1
        elif cosine < _CREASE_COS:
            kind[e] = 3 if off_i + off_j < 0.0 else 4
    return kind, cost


@njit(cache=True, nogil=True)
def _border_shares(count, edges, length, kind):  # type: ignore[no-untyped-def]
    border = np.zeros((count, 5), np.float32)
    total = np.zeros(count, np.float32)
    for e in range(edges.shape[0]):
        for side in range(2):
            i = edges[e, side]
            total[i] += length[e]
            if kind[e] >= 0:
                seen = kind[e] ^ side if kind[e] < 2 else kind[e]  # farther and nearer swap with the side
                border[i, seen] += length[e]
    for i in range(count):
        border[i] /= max(total[i], np.float32(1.0))
    return border


@njit(cache=True, nogil=True)
def _join(count, edges, kind, order):  # type: ignore[no-untyped-def]
    parent = np.arange(count)
    for e in order:
        if kind[e] != 2:
            continue
        i, j = edges[e, 0], edges[e, 1]
        while parent[i] != i:
            i = parent[i]
        while parent[j] != j:
            j = parent[j]
        if i != j:
            parent[max(i, j)] = min(i, j)
    segment = np.empty(count, np.int32)
    n = 0
    for i in range(count):
        root = i
        while parent[root] != root:
            root = parent[root]
        if root == i:
            segment[i] = n
            n += 1
        else:
            segment[i] = segment[root]
    return segment, n
