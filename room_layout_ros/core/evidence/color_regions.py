"""Regions of one colour at several scales: a wall is a large region, however many superpixels it is cut into."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..superpixels import Superpixels

SCALES = {"fine": 60, "mid": 25, "coarse": 10}
"""Regions left at each scale."""

_POWER = 0.6
"""Of the area in the cost of merging: 1 is Ward's criterion, 0 is the nearest colour."""

_MEANS = ("gradient", "L_deviation", "contrast", "om_2", "om_4", "lines_x", "lines_y", "lines_z", "edges")


def compute_color_regions(
    superpixels: Superpixels,
    columns: Mapping[str, NDArray[np.floating]],
    bounds: NDArray[np.float32],
    camera: CameraIntrinsics,
) -> dict[str, NDArray[np.floating]]:
    """Describe the region each superpixel belongs to, at every scale.

    Parameters
    ----------
    columns : at least L, a, b (K,) 8-bit Lab and those of `_MEANS`; NaN without colour.
    bounds : (K, 4+) float32 x low, x high, y low, y high in pixels.

    Returns
    -------
    dict of (K,) float64
        By scale: area, box, how much of the box is filled, spread of colour, contrast to the region, texture.
    """
    lab = np.stack([columns[name] for name in ("L", "a", "b")], axis=1).astype(np.float64)
    found: dict[str, NDArray[np.floating]] = {}
    known = np.nan_to_num(lab)
    area = superpixels.pixels.astype(np.float64)
    order = np.array(sorted(SCALES.values(), reverse=True))
    regions = _merge(known, area, superpixels.edges, order)
    for scale, wanted in SCALES.items():
        region = regions[int(np.flatnonzero(order == wanted)[0])]
        found |= {f"{scale}_{k}": v for k, v in _describe(region, lab, area, columns, bounds, camera).items()}
    return found


def _describe(
    region: NDArray[np.int32],
    lab: NDArray[np.float64],
    area: NDArray[np.float64],
    columns: Mapping[str, NDArray[np.floating]],
    bounds: NDArray[np.float32],
    camera: CameraIntrinsics,
) -> dict[str, NDArray[np.floating]]:
    count = int(region.max()) + 1
    total = np.bincount(region, area, count)

    def mean(value: NDArray[np.floating]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(region, area * value, count) / total)[region]

    box = np.empty((count, 4))
    box[:, 0::2], box[:, 1::2] = np.inf, -np.inf
    for k in range(4):
        (np.fmax if k % 2 else np.fmin).at(box[:, k], region, bounds[:, k].astype(np.float64))
    scale = np.array([camera.width, camera.width, camera.height, camera.height], np.float64)
    left, right, top, bottom = (box / scale).T
    centre = np.stack([mean(lab[:, k]) for k in range(3)], axis=1)
    off = np.sqrt(((lab - centre) ** 2).sum(axis=1))
    image = float(camera.width * camera.height)
    found: dict[str, NDArray[np.floating]] = {
        "area": (total / image)[region],
        "left": left[region],
        "right": right[region],
        "top": top[region],
        "bottom": bottom[region],
        "filled": (total / np.maximum((right - left) * (bottom - top) * image, 1.0))[region],
        "off": off,
        "spread": mean(off),
        "L": centre[:, 0],
        "chroma": np.hypot(centre[:, 1] - 128.0, centre[:, 2] - 128.0),
    }
    found |= {name: mean(columns[name]) for name in _MEANS}
    return found


@njit(cache=True, nogil=True)
def _merge(lab, area, edges, wanted):  # type: ignore[no-untyped-def]
    """(len(wanted), K) region ids: neighbours whose union costs least are joined until `wanted` (falling) are left."""
    count = lab.shape[0]
    lab, area = lab.copy(), area.copy()
    parent = np.arange(count)
    a, b = edges[:, 0].copy(), edges[:, 1].copy()
    m, left = len(a), count
    cost = np.empty(m)
    for e in range(m):
        cost[e] = _cost(lab, area, a[e], b[e])
    regions = np.empty((len(wanted), count), np.int32)
    for level in range(len(wanted)):
        while left > wanted[level] and m > 0:
            best = int(np.argmin(cost[:m]))
            keep, gone = min(a[best], b[best]), max(a[best], b[best])
            parent[gone] = keep
            lab[keep] = (lab[keep] * area[keep] + lab[gone] * area[gone]) / (area[keep] + area[gone])
            area[keep] += area[gone]
            left -= 1
            e = 0
            while e < m:
                i, j = a[e], b[e]
                if i in (keep, gone) or j in (keep, gone):
                    i, j = keep if i == gone else i, keep if j == gone else j
                    if i == j:
                        m -= 1
                        a[e], b[e], cost[e] = a[m], b[m], cost[m]
                        continue
                    a[e], b[e] = i, j
                    cost[e] = _cost(lab, area, i, j)
                e += 1
        n = 0
        for k in range(count):  # parents come before their children
            if parent[k] == k:
                regions[level, k] = n
                n += 1
            else:
                root = parent[k]
                while parent[root] != root:
                    root = parent[root]
                regions[level, k] = regions[level, root]
    return regions


@njit(cache=True, nogil=True)
def _cost(lab, area, i, j):  # type: ignore[no-untyped-def]
    difference = 0.0
    for k in range(3):
        difference += (lab[i, k] - lab[j, k]) ** 2
    return (area[i] * area[j] / (area[i] + area[j])) ** _POWER * difference
