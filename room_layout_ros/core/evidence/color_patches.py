"""Colour descriptors of patches: gradient, colour, local binary pattern (Bo, Ren, Fox, NIPS 2010; docs/evidence.md)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..color import block_means
from .match_kernels import CompactBasis, Floats, MatchKernel, binary_patterns

PATCH_PX, STEP_PX = 16, 8
"""Side of a patch, and distance between neighbours, both ways."""

_FINE_PX, _COARSE_PX = 2, 4
"""Side of a sample of gradient and pattern, and of colour: means over so many pixels."""

_GRADIENT_FLOOR, _PATTERN_FLOOR = 0.2, 0.05
"""Added to the sum of squared weights of a patch, a quarter of the papers' 0.8 and 0.2: a sample is four pixels."""


def patch_centers(height: int, width: int) -> NDArray[np.int32]:
    """(P, 2) int32 rows and columns of the centres of all whole patches of an image, row by row."""
    rows = np.arange(PATCH_PX // 2, height - PATCH_PX // 2 + 1, STEP_PX, dtype=np.int32)
    columns = np.arange(PATCH_PX // 2, width - PATCH_PX // 2 + 1, STEP_PX, dtype=np.int32)
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)


def compute_color_descriptors(
    color: NDArray[np.uint8], centers: NDArray[np.int32], kernels: dict[str, MatchKernel]
) -> dict[str, Floats]:
    """Describe patches of the colour image.

    Parameters
    ----------
    color : (H, W, 3) uint8 RGB. centers : (P, 2) int32 of `patch_centers`.
    kernels : of `match_kernels.standard_kernels`.

    Returns
    -------
    dict of (P, D) float32
        "gradient", "color", "pattern".
    """
    fine = _reduced(color, _FINE_PX)
    gray = (fine @ np.array([0.299, 0.587, 0.114], np.float32)).astype(np.float32)
    corners = centers - PATCH_PX // 2
    gradient = kernels["gradient"]
    direction, magnitude = gradient_samples(gray)
    codes, contrast = pattern_samples(gray)
    pattern = kernels["pattern"]
    table = pattern.attribute.embed(binary_patterns())
    coarse = _reduced(color, _COARSE_PX)
    even = np.ones(coarse.shape[:2], np.float32)
    return {
        "gradient": _describe(gradient, _spread(gradient.attribute, direction), magnitude, corners, _GRADIENT_FLOOR),
        "color": _describe(
            kernels["color"], _spread(kernels["color"].attribute, coarse), even, corners, 0.0, _COARSE_PX
        ),
        "pattern": _describe(pattern, table[codes], contrast, corners, _PATTERN_FLOOR),
    }


def _reduced(color: NDArray[np.uint8], size_px: int) -> Floats:
    """(H // s, W // s, 3) float32 means over squares, 0..1."""
    return block_means(color, size_px).astype(np.float32) / np.float32(255.0)


def _spread(basis: CompactBasis, image: Floats) -> Floats:
    """(h, w, n) coordinates of each sample of an image of attributes."""
    flat = basis.embed(image.reshape(-1, image.shape[2]))
    return flat.reshape(*image.shape[:2], -1)


def _describe(
    kernel: MatchKernel,
    attributes: Floats,
    weight: Floats,
    corners: NDArray[np.int32],
    floor: float,
    sample_px: int = _FINE_PX,
) -> Floats:
    side = PATCH_PX // sample_px
    place = place_basis(kernel, side)
    sums = sum_patches(np.ascontiguousarray(attributes), weight, corners // sample_px, side, place, floor)
    return np.ascontiguousarray(sums[:, kernel.pairs[:, 0], kernel.pairs[:, 1]])


def place_basis(kernel: MatchKernel, side: int) -> Floats:
    """(side * side, n) coordinates of the places of a patch's samples, in 0..1, row by row."""
    at = (np.arange(side) + 0.5) / side
    return kernel.position.embed(np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2))


@njit(cache=True, nogil=True)
def gradient_samples(gray):  # type: ignore[no-untyped-def]
    """(h, w, 2) unit vector along the gradient, 0 where there is none, and (h, w) its length; one-sided at the rim."""
    height, width = gray.shape
    direction = np.zeros((height, width, 2), np.float32)
    length = np.zeros((height, width), np.float32)
    for y in range(height):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            gx = (gray[y, right] - gray[y, left]) / max(right - left, 1)
            gy = (gray[down, x] - gray[up, x]) / max(down - up, 1)
            m = np.sqrt(gx * gx + gy * gy)
            length[y, x] = m
            if m > 0.0:
                direction[y, x, 0], direction[y, x, 1] = gx / m, gy / m
    return direction, length


@njit(cache=True, nogil=True)
def pattern_samples(gray):  # type: ignore[no-untyped-def]
    """(h, w) uint8 which of the eight neighbours are brighter, and (h, w) standard deviation of the nine.

    Bits go clockwise from top left. Beyond the rim the nearest sample counts.
    """
    height, width = gray.shape
    codes = np.zeros((height, width), np.uint8)
    contrast = np.zeros((height, width), np.float32)
    for y in range(height):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            around = (
                gray[up, left], gray[up, x], gray[up, right], gray[y, right],
                gray[down, right], gray[down, x], gray[down, left], gray[y, left],
            )  # fmt: skip
            own = gray[y, x]
            code, total, squares = 0, 0.0, 0.0
            for k in range(8):
                difference = around[k] - own
                if difference > 0.0:
                    code |= 1 << k
                total += difference
                squares += difference * difference
            mean = total / 9.0
            codes[y, x] = code
            contrast[y, x] = np.sqrt(max(squares / 9.0 - mean * mean, 0.0))
    return codes, contrast


@njit(cache=True, nogil=True, fastmath=True)
def sum_patches(attributes, weight, corners, side, place, floor):  # type: ignore[no-untyped-def]
    """(P, A, B) float32 sum over a patch's samples z of m(z) a(z) b(z), over the root of floor + sum m^2.

    Parameters
    ----------
    attributes : (h, w, A) float32. weight : (h, w) float32. corners : (P, 2) int32 first row and column of each
    patch. side : samples of a patch's side. place : (side * side, B) float32.
    """
    n_a, n_b = attributes.shape[2], place.shape[1]
    sums = np.zeros((len(corners), n_a, n_b), np.float32)
    for p in range(len(corners)):
        squares = np.float32(floor)
        for i in range(side):
            for j in range(side):
                y, x = corners[p, 0] + i, corners[p, 1] + j
                m = weight[y, x]
                squares += m * m
                for a in range(n_a):
                    value = m * attributes[y, x, a]
                    for b in range(n_b):
                        sums[p, a, b] += value * place[i * side + j, b]
        if squares > 0.0:
            scale = np.float32(1.0) / np.sqrt(squares)
            for a in range(n_a):
                for b in range(n_b):
                    sums[p, a, b] *= scale
    return sums
