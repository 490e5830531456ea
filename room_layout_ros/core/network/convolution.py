"""Layers of a convolutional network on images with the channels last: products per pixel, filters per channel.

Images are flat float32 arrays, or parts of one that begin where the image does; pixels follow each other row by row.
Widths are multiples of 8, channels too.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .vector_tiles import (
    FILTER_PIXELS,
    HALF_LANES,
    LANES,
    PRODUCT_PIXELS,
    filter_half_tile,
    filter_tile,
    product_half_tile,
    product_tile,
)


def pack_panels(matrix: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n,) the weights of `multiply` for a (channels in, channels out) matrix: `LANES` columns after each other, the
    rest in panels of `HALF_LANES`.
    """
    channels = matrix.shape[1]
    whole = channels // LANES * LANES
    starts = [*range(0, whole, LANES), *range(whole, channels, HALF_LANES)]
    ends = [*starts[1:], channels]
    return np.concatenate([matrix[:, a:b].ravel() for a, b in zip(starts, ends, strict=True)])


@njit(cache=True, nogil=True)
def multiply(source, rows, columns, depth, panels, bias, channels, target, row_step, least, most):  # type: ignore[no-untyped-def]
    """Write channels of each pixel: bias + the `depth` numbers of its own by the weights, between `least` and `most`.

    Parameters
    ----------
    panels, bias : of `pack_panels`; (channels,).
    row_step : from one row of the target to the next; within it pixels follow each other.
    """
    whole = channels // LANES * LANES
    for first in range(0, channels, HALF_LANES):
        if first < whole and first % LANES:
            continue
        panel, start = panels[first * depth :], bias[first:]
        for row in range(rows):
            for column in range(0, columns, PRODUCT_PIXELS):
                pixels = source[(row * columns + column) * depth :]
                out = target[row * row_step + column * channels + first :]
                if first < whole:
                    product_tile(pixels, panel, depth, start, out, channels, least, most)
                else:
                    product_half_tile(pixels, panel, depth, start, out, channels, least, most)


@njit(cache=True, nogil=True)
def filter_rows(source, height, columns, channels, size, stride, before, taps, bias, start, stop, target, least, most):  # type: ignore[no-untyped-def]  # fmt: skip
    """Write rows start..stop-1 of the filtered image to the beginning of the target.

    Parameters
    ----------
    source : image with `before` zero pixels left of each row and `size - 1 - before` right of it; `columns` without.
    taps : (size, size, channels), flat.
    """
    row_step, out_columns, whole = (columns + size - 1) * channels, columns // stride, channels // LANES * LANES
    for row in range(start, stop):
        top = row * stride - before
        skipped = max(0, -top)
        rows = min(size, height - top) - skipped
        weights = taps[skipped * size * channels :]
        for column in range(0, out_columns, FILTER_PIXELS):
            corner = source[(top + skipped) * row_step + column * stride * channels :]
            out = target[((row - start) * out_columns + column) * channels :]
            for c in range(0, whole, LANES):
                filter_tile(
                    corner[c:], row_step, channels, weights[c:], rows, bias[c:], out[c:], least, most, size, stride
                )
            for c in range(whole, channels, HALF_LANES):
                filter_half_tile(
                    corner[c:], row_step, channels, weights[c:], rows, bias[c:], out[c:], least, most, size, stride
                )
