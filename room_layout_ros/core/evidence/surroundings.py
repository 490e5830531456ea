"""What is around each superpixel: neighbours in the image, superpixels at fixed offsets, pieces of the same colour."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..superpixels import Superpixels

Columns = dict[str, NDArray[np.floating]]

_ALIKE_COLOR = 12.0
"""Difference in 8-bit Lab at which two colours are half as much alike."""

_AVERAGED = (
    "L",
    "chroma",
    "gradient",
    "L_deviation",
    "om_2",
    "om_4",
    "normal_y",
    "cos_x",
    "cos_z",
    "depth",
    "Y",
    "to_farthest",
    "plane_residual",
    "behind_plane",
    "border_farther",
    "border_convex",
    "segment_area",
)

_NEAR, _FAR = 0.12, 0.3
_VIEWS = {
    "above": (0.0, -_NEAR),
    "below": (0.0, _NEAR),
    "left": (-_NEAR, 0.0),
    "right": (_NEAR, 0.0),
    "far_above": (0.0, -_FAR),
    "far_below": (0.0, _FAR),
    "far_left": (-_FAR, 0.0),
    "far_right": (_FAR, 0.0),
}
"""Offsets in image widths at which `look_around` looks."""

_VIEWED = ("L", "gradient", "om_2", "om_4", "Y", "cos_y", "to_farthest", "border_farther", "depth")
_RELATIVE = ("L", "Y", "depth")


def color_contrast(superpixels: Superpixels, lab: NDArray[np.float64]) -> Columns:
    """Difference in colour (`lab`, (K, 3)) to the neighbours: its mean by border length, and the least one."""
    mean, least = _contrast(superpixels.edges, superpixels.edge_length, lab)
    return {"contrast": mean, "contrast_least": least}


def color_alike(superpixels: Superpixels, lab: NDArray[np.float64]) -> Columns:
    """How much of the image has this colour (`lab`, (K, 3)), and where: walls and floors come in several pieces."""
    height = superpixels.center_px[:, 1] / np.float64(superpixels.index.shape[0])
    share, level = _alike(lab, superpixels.pixels / float(superpixels.pixels.sum()), height)
    return {"alike": share, "alike_y": level}


def average_around(columns: Columns, superpixels: Superpixels) -> Columns:
    """Border-weighted means of some columns over the neighbours."""
    names = [name for name in _AVERAGED if name in columns]
    values = np.ascontiguousarray(np.stack([columns[name] for name in names], axis=1), np.float64)
    mean = _neighbour_means(values, superpixels.edges, superpixels.edge_length)
    return {f"around_{name}": mean[:, k] for k, name in enumerate(names)}


def look_around(columns: Columns, aspect: float) -> Columns:
    """Features of the superpixels at fixed offsets in the image, some relative to the own ones.

    Parameters
    ----------
    columns : with at least x, y, L, a, b of all superpixels of one image.
    aspect : height of the image over its width.

    Returns
    -------
    dict of (K,) arrays
        NaN where the offset leads out of the image.
    """
    names = [name for name in _VIEWED if name in columns]
    relative = np.array([name in _RELATIVE for name in names])
    taken = [*(columns[name] for name in ("x", "y", "L", "a", "b")), *(columns[name] for name in names)]
    seen = _look(np.stack(taken, axis=1).astype(np.float64), relative, np.array(list(_VIEWS.values())), aspect)
    found: Columns = {}
    for v, view in enumerate(_VIEWS):
        found[f"{view}_contrast"] = seen[v, :, 0]
        found |= {f"{view}_{name}": seen[v, :, 1 + k] for k, name in enumerate(names)}
    return found


@njit(cache=True, nogil=True)
def _contrast(edges, length, lab):  # type: ignore[no-untyped-def]
    count = lab.shape[0]
    mean, weight, least = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        difference = np.sqrt((lab[i, 0] - lab[j, 0]) ** 2 + (lab[i, 1] - lab[j, 1]) ** 2 + (lab[i, 2] - lab[j, 2]) ** 2)
        if np.isnan(difference):
            continue
        for k in (i, j):
            mean[k] += length[e] * difference
            weight[k] += length[e]
            least[k] = min(least[k], difference)
    for k in range(count):
        mean[k] = mean[k] / weight[k] if weight[k] > 0.0 else np.nan
        least[k] = least[k] if least[k] < np.inf else np.nan
    return mean, least


@njit(cache=True, nogil=True)
def _alike(lab, area, height):  # type: ignore[no-untyped-def]
    """Area (K,) of superpixels of about the same colour, and its mean height."""
    count = lab.shape[0]
    share, level = np.zeros(count), np.zeros(count)
    for i in range(count):
        for j in range(i + 1):
            far = (lab[i, 0] - lab[j, 0]) ** 2 + (lab[i, 1] - lab[j, 1]) ** 2 + (lab[i, 2] - lab[j, 2]) ** 2
            alike = np.exp(far * (-0.5 / _ALIKE_COLOR**2))
            if np.isnan(alike):
                continue
            share[i] += alike * area[j]
            level[i] += alike * area[j] * height[j]
            if j < i:
                share[j] += alike * area[i]
                level[j] += alike * area[i] * height[i]
    for i in range(count):
        share[i] = np.nan if np.isnan(lab[i, 0]) else share[i]
        level[i] = level[i] / share[i]
    return share, level


@njit(cache=True, nogil=True)
def _neighbour_means(values, edges, length):  # type: ignore[no-untyped-def]
    """(K, c) means over the neighbours that know the value, weighted by the common border; NaN where none does."""
    total = np.zeros_like(values)
    weight = np.zeros_like(values)
    for e in range(edges.shape[0]):
        for side in range(2):
            here, there = edges[e, side], edges[e, 1 - side]
            for k in range(values.shape[1]):
                value = values[there, k]
                if value == value:
                    total[here, k] += length[e] * value
                    weight[here, k] += length[e]
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            total[i, k] = total[i, k] / weight[i, k] if weight[i, k] > 0.0 else np.nan
    return total


@njit(cache=True, nogil=True)
def _look(values, relative, offsets, aspect):  # type: ignore[no-untyped-def]
    """(views, K, 1 + c) contrast in colour and the columns from the fifth on, of the superpixel at each offset."""
    count, n = values.shape[0], values.shape[1] - 5
    seen = np.full((offsets.shape[0], count, 1 + n), np.nan)
    x, y = values[:, 0].astype(np.float32), (values[:, 1] * aspect).astype(np.float32)
    apart = np.empty(count, np.float32)
    for v in range(offsets.shape[0]):
        for i in range(count):
            px, py = values[i, 0] + offsets[v, 0], values[i, 1] * aspect + offsets[v, 1]
            if px < 0.0 or px > 1.0 or py < 0.0 or py > aspect:
                continue
            there = _nearest(x, y, np.float32(px), np.float32(py), apart)
            contrast = 0.0
            for c in range(2, 5):
                contrast += (values[there, c] - values[i, c]) ** 2
            seen[v, i, 0] = np.sqrt(contrast)
            for k in range(n):
                own = values[i, 5 + k] if relative[k] else 0.0
                seen[v, i, 1 + k] = values[there, 5 + k] - own
    return seen


@njit(cache=True, nogil=True)
def _nearest(x, y, px, py, apart):  # type: ignore[no-untyped-def]
    """Index of the first of the nearest of the points (x, y): distances in vector registers first, into `apart`.

    The least one is sought by their bits, which are in the order of the numbers where none is below 0: minima of whole
    numbers run in vector registers, those of float32 do not (NaN).
    """
    for j in range(len(x)):
        dx, dy = x[j] - px, y[j] - py
        apart[j] = dx * dx + dy * dy
    bits = apart.view(np.int32)
    least = bits[0]
    for j in range(len(bits)):
        least = min(least, bits[j])
    nearest = 0
    while bits[nearest] != least:
        nearest += 1
    return nearest
