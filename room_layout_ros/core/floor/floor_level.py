"""On which level the camera stands, where the picture shows more than one.

A plane that fits is not the floor yet. It may be the top of a bed, with the floor below it in view; or the camera
stands before a step down, and most of the floor that is seen lies below the one under it. Then what is nearest, at the
lower edge of the picture, tells; and where it cannot tell a drop from a table, there is no floor: no output beats a
wrong one. A height by TF or parameters tells all of that better.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..labels import FLOOR

_STRIDE = 2
_LOWEST_PART, _LAST_PART = 6, 48
"""The lowest sixth of the picture is looked at; its last rows are a forty-eighth, and one of `_STRIDE` at least."""

_LAYER_M, _FARTHEST_M = 0.05, 2.0
_LAYERS = int(2 * _FARTHEST_M / _LAYER_M)

_LOWER_FROM_M, _LOWER_SHARE, _LEVEL_SHARE = 0.25, 0.003, 0.4
"""A layer so far below the plane, in the lowest sixth and of the first share of the picture, is the floor; if it holds
the second share of all that lies so far below: a wall that is mirrored in a glossy floor spreads over many. So does the
front of what the camera stands before; that fills the last rows, too."""

_UPPER_FROM_M, _UPPER_SHARE = 0.10, 0.6
"""Two layers that begin so far above it, or farther, and fill this share of the last rows may be it."""

_LEAST_FLOOR_SHARE = 0.3
"""A plane with a smaller share of pixels labelled floor is no floor: so were seven of the 223 NYU frames looked at, and
on none of them lay any floor; the other planes are at 0.4 and above, nearly all above 0.7."""

_ON_PLANE_M = 0.05
_ALIKE_SHARES, _ALIKE_BRIGHTNESS = 0.015, 0.25
"""Two surfaces look alike whose mean shares of red and green differ by less, and whose brightness by this part."""

(_COUNT, _FLOOR, _RED, _GREEN, _SUM) = range(5)


def level_of_camera(
    inverse_depth: NDArray[np.float32],
    labels: NDArray[np.uint8],
    color: NDArray[np.uint8] | None,
    intrinsics: tuple[float, ...],
    plane: NDArray[np.float64],
) -> float:
    """Return the height in m over a plane that fits of the level the camera stands on; NaN where there is no telling.

    Parameters
    ----------
    inverse_depth : (H, W) float32, 1/m. labels : (H, W) uint8 of the estimate. color : (H, W, 3) uint8 RGB.
    intrinsics : fx, fy, cx, cy. plane : (3,) float64 n / d.
    """
    colors = np.zeros((*labels.shape, 3), np.uint8) if color is None else np.ascontiguousarray(color)
    on_plane, layers, last = _layers(inverse_depth, labels, colors, intrinsics, plane)
    two = layers[1:] + layers[:-1]
    middle = _LAYERS // 2
    lower = middle - int(_LOWER_FROM_M / _LAYER_M)
    below, all_below = two[1:lower, _COUNT].max(), layers[:lower, _COUNT].sum()
    if on_plane[_FLOOR] < _LEAST_FLOOR_SHARE * on_plane[_COUNT]:
        return float("nan")
    mirrored = below < _LEVEL_SHARE * all_below and last[:lower].sum() <= 0.5 * last.sum()
    if below * _STRIDE**2 >= _LOWER_SHARE * labels.size and not mirrored:
        return float("nan")
    first = middle + round(_UPPER_FROM_M / _LAYER_M)
    best = first + int(np.argmax(last[first:-1] + last[first + 1 :]))
    layer = two[best]
    if last[best : best + 2].sum() <= _UPPER_SHARE * last.sum():
        return 0.0
    if layer[_FLOOR] >= 0.5 * layer[_COUNT]:
        return (best + 1 - middle) * _LAYER_M
    return float("nan") if _alike(layer, on_plane) else 0.0  # a drop, or a table


def _alike(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether two surfaces have the same colour, from the sums over their pixels."""
    shares = one[_RED:_SUM] / max(one[_SUM], 1.0), other[_RED:_SUM] / max(other[_SUM], 1.0)
    bright = one[_SUM] / max(one[_COUNT], 1.0), other[_SUM] / max(other[_COUNT], 1.0)
    same = np.abs(shares[0] - shares[1]).max() < _ALIKE_SHARES
    return bool(same and abs(bright[0] - bright[1]) <= _ALIKE_BRIGHTNESS * max(bright))


@njit(cache=True, nogil=True)
def _layers(inverse, labels, color, intrinsics, plane):  # type: ignore[no-untyped-def]
    """Sums over the pixels on the plane, over those of each layer of the lowest part; and how many of the last rows."""
    fx, fy, cx, cy = intrinsics
    height, width = inverse.shape
    on_plane, layers, last = np.zeros(5, np.int64), np.zeros((_LAYERS, 5), np.int64), np.zeros(_LAYERS)
    d = 1.0 / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    lowest, last_rows = height - max(height // _LOWEST_PART, _STRIDE), height - max(height // _LAST_PART, _STRIDE)
    rays, high = (np.arange(0.0, width, _STRIDE) - cx) / fx, np.empty((width + _STRIDE - 1) // _STRIDE)
    for v in range(0, height, _STRIDE):
        _row_heights(inverse[v, ::_STRIDE], rays, (v - cy) / fy, plane, d, high)
        for k in range(len(high)):
            h, u = high[k], k * _STRIDE
            if abs(h) < _ON_PLANE_M:
                _add(on_plane, labels[v, u], color[v, u])
            if v >= lowest and inverse[v, u] > 0.0:
                layer = min(max(int(np.floor((h + _FARTHEST_M) / _LAYER_M)), 0), _LAYERS - 1)
                _add(layers[layer], labels[v, u], color[v, u])
                last[layer] += v >= last_rows
    return on_plane.astype(np.float64), layers.astype(np.float64), last


@njit(cache=True, nogil=True, error_model="numpy")
def _row_heights(inverse, rx, ry, plane, d, high):  # type: ignore[no-untyped-def]
    """Write the heights of a row of pixels over the plane, inf without depth; by itself, so that it runs on vectors."""
    a, b, c = plane[0], plane[1] * ry, plane[2]
    for k in range(len(rx)):
        w = np.float64(inverse[k])
        h = d * (1.0 - (a * rx[k] + b + c) * (1.0 / (w if w > 0.0 else 1.0)))
        high[k] = h if w > 0.0 else np.inf


@njit(cache=True, nogil=True)
def _add(sums, label, color):  # type: ignore[no-untyped-def]
    red, green, blue = np.int64(color[0]), np.int64(color[1]), np.int64(color[2])
    sums[_COUNT] += 1
    sums[_FLOOR] += 1 if label == FLOOR else 0
    sums[_RED] += red
    sums[_GREEN] += green
    sums[_SUM] += red + green + blue


@njit(cache=True, nogil=True)
def height_over(plane, d, rx, ry, z):  # type: ignore[no-untyped-def]
    """Height in m of the point at depth z on the ray (rx, ry, 1) over the plane n / d, of which d is the distance."""
    return d * (1.0 - (plane[0] * rx + plane[1] * ry + plane[2]) * z)
