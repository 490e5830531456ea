"""Runs a convolutional network that is written down as a table of layers, in one kernel."""

from __future__ import annotations

import numpy as np
from numba import njit

from .convolution import filter_rows, multiply

STEM, BLOCK, POINT, ENLARGE, WHOLE = range(5)
"""Kinds of layers: full convolution of the picture; widen, filter, narrow; product per pixel; add the source twice as
large to the target; add a product of the mean of the source, and what each place has of its own, to the target."""

LAYER = np.dtype([
    (name, np.int64)
    for name in (
        "kind", "source", "rows", "columns", "channels", "target", "out", "kernel", "stride", "wide", "bounded",
        "residual", "expand", "expand_bias", "taps", "taps_bias", "project", "project_bias",
    )
])  # fmt: skip
"""What a layer does. source, target: where its images begin; rows, columns, channels: of the source; out: channels of
the target; wide: channels of the widened image; bounded: 1 for ReLU6 inside and none at the end, 0 for none inside and
ReLU at the end; residual: 1 where the source is added; the others: where its weights begin (-1: it has none; taps of
`WHOLE`: what each place has of its own).
"""

_BAND = 1 << 15
"""Numbers of the widened image that are made before they are filtered: they are still in the cache then."""
_ZERO, _RELU6, _NONE = np.float32(0.0), np.float32(6.0), np.float32(np.inf)


@njit(cache=True, nogil=True)
def run_layers(color, layers, weights, images, wide, filtered):  # type: ignore[no-untyped-def]
    """Fill `images` with what the layers make of a (rows, columns, 3) float32 image.

    Parameters
    ----------
    layers : (n,) LAYER. weights : float32, all of them. images, wide, filtered : float32 workspace.
    """
    for k in range(len(layers)):
        layer = layers[k]
        if layer.kind == STEM:
            _run_stem(layer, color, weights, images, filtered)
        elif layer.kind == BLOCK:
            _run_block(layer, weights, images, wide, filtered)
        elif layer.kind == POINT:
            _run_point(layer, weights, images)
        elif layer.kind == ENLARGE:
            _add_enlarged(layer, images)
        elif layer.kind == WHOLE:
            _add_whole(layer, weights, images)


@njit(cache=True, nogil=True)
def pad_before(kernel, stride):  # type: ignore[no-untyped-def]
    """Zero pixels before the first: half of what is missing, and the smaller half, as TensorFlow does."""
    return (kernel - stride) // 2


@njit(cache=True, nogil=True)
def _run_stem(layer, color, weights, images, patches):  # type: ignore[no-untyped-def]
    """Convolve the picture: the pixels under the kernel are laid side by side, row by row, and multiplied."""
    kernel, stride, columns = layer.kernel, layer.stride, layer.columns // layer.stride
    before, depth, out = pad_before(kernel, stride), kernel * kernel * 3, layer.out
    for row in range(layer.rows // stride):
        for column in range(columns):
            at = column * depth
            for y in range(row * stride - before, row * stride - before + kernel):
                for x in range(column * stride - before, column * stride - before + kernel):
                    inside = 0 <= y < layer.rows and 0 <= x < layer.columns
                    for c in range(3):
                        patches[at] = color[y, x, c] if inside else _ZERO
                        at += 1
        panels, bias, target = weights[layer.project :], weights[layer.project_bias :], images[layer.target :]
        multiply(patches, 1, columns, depth, panels, bias, out, target[row * columns * out :], 0, _ZERO, _RELU6)


@njit(cache=True, nogil=True)
def _run_block(layer, weights, images, wide, filtered):  # type: ignore[no-untyped-def]
    """Widen (where there are weights for it), filter each channel, narrow; a band of rows after the other.

    The widened image is kept whole: filters of neighbouring bands see some of the same rows.
    """
    rows, columns, kernel, stride, width = layer.rows, layer.columns, layer.kernel, layer.stride, layer.wide
    before, out_rows, out_step = pad_before(kernel, stride), rows // stride, columns // stride * layer.out
    taps, taps_bias = weights[layer.taps :], weights[layer.taps_bias :]
    panels, bias = weights[layer.project :], weights[layer.project_bias :]
    inner_least, inner_most, least = (_ZERO, _RELU6, -_NONE) if layer.bounded else (-_NONE, _NONE, _ZERO)
    band, made = max(1, _BAND // (stride * columns * width)), 0
    for start in range(0, out_rows, band):
        stop = min(start + band, out_rows)
        needed = min(rows, (stop - 1) * stride - before + kernel)
        if needed > made:
            _widen(layer, weights, images, wide, made, needed, before)
            made = needed
        filter_rows(
            wide, rows, columns, width, kernel, stride, before, taps, taps_bias, start, stop, filtered, inner_least,
            inner_most,
        )  # fmt: skip
        target = images[layer.target + start * out_step : layer.target + stop * out_step]
        multiply(
            filtered, stop - start, columns // stride, width, panels, bias, layer.out, target, out_step, least, _NONE
        )
        if layer.residual:
            source = images[layer.source + start * out_step : layer.source + stop * out_step]
            for k in range(len(target)):
                target[k] += source[k]


@njit(cache=True, nogil=True)
def _widen(layer, weights, images, wide, first, stop, before):  # type: ignore[no-untyped-def]
    """Make rows first..stop-1 of the widened image, with zeros left and right of them."""
    columns, width = layer.columns, layer.wide
    step, size = (columns + layer.kernel - 1) * width, columns * layer.channels
    source = images[layer.source + first * size :]
    for row in range(first, stop):
        wide[row * step : row * step + before * width] = _ZERO
        wide[row * step + (before + columns) * width : (row + 1) * step] = _ZERO
    if layer.expand >= 0:
        panels, bias = weights[layer.expand :], weights[layer.expand_bias :]
        target = wide[first * step + before * width :]
        multiply(source, stop - first, columns, layer.channels, panels, bias, width, target, step, _ZERO, _RELU6)
    else:
        for row in range(first, stop):
            begin, origin = row * step + before * width, (row - first) * size
            wide[begin : begin + size] = source[origin : origin + size]


@njit(cache=True, nogil=True)
def _run_point(layer, weights, images):  # type: ignore[no-untyped-def]
    panels, bias = weights[layer.project :], weights[layer.project_bias :]
    source, target, step = images[layer.source :], images[layer.target :], layer.columns * layer.out
    multiply(source, layer.rows, layer.columns, layer.channels, panels, bias, layer.out, target, step, -_NONE, _NONE)


@njit(cache=True, nogil=True)
def _add_enlarged(layer, images):  # type: ignore[no-untyped-def]
    """Add the source, twice as large by bilinear interpolation, to the target.

    A pixel of the larger image lies a quarter of the way from the source's pixel to the next, beyond the side to none.
    """
    rows, columns, channels = layer.rows, layer.columns, layer.channels
    source = images[layer.source : layer.source + rows * columns * channels]
    row = np.empty(columns * channels, np.float32)
    for y in range(2 * rows):
        near_y, far_y = y // 2, min(max(y // 2 - 1 + 2 * (y % 2), 0), rows - 1)
        _mix(source, near_y * len(row), far_y * len(row), row)
        target = images[layer.target + y * 2 * len(row) :]
        for x in range(2 * columns):
            near_x, far_x = x // 2, min(max(x // 2 - 1 + 2 * (x % 2), 0), columns - 1)
            _add_mix(row, near_x * channels, far_x * channels, target[x * channels : (x + 1) * channels])


@njit(cache=True, nogil=True)
def _mix(source, near, far, out):  # type: ignore[no-untyped-def]
    for k in range(len(out)):
        out[k] = np.float32(0.75) * source[near + k] + np.float32(0.25) * source[far + k]


@njit(cache=True, nogil=True)
def _add_mix(source, near, far, out):  # type: ignore[no-untyped-def]
    for k in range(len(out)):
        out[k] += np.float32(0.75) * source[near + k] + np.float32(0.25) * source[far + k]


@njit(cache=True, nogil=True)
def _add_whole(layer, weights, images):  # type: ignore[no-untyped-def]
    """Add a product of the mean of the source, and what each place has of its own, to the target."""
    pixels, channels, out = layer.rows * layer.columns, layer.channels, layer.out
    whole = weights[layer.project_bias : layer.project_bias + out].copy()
    for c in range(channels):
        mean = _ZERO
        for p in range(pixels):
            mean += images[layer.source + p * channels + c]
        mean /= np.float32(pixels)
        for k in range(out):
            whole[k] += mean * weights[layer.project + c * out + k]
    for p in range(pixels):
        for k in range(out):
            images[layer.target + p * out + k] += weights[layer.taps + p * out + k] + whole[k]
