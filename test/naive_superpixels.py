"""The slow, obvious twins of the superpixel kernels."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage


def energies(
    lab: NDArray[np.float64],
    w: NDArray[np.float64],
    centers: NDArray[np.float64],
    weights: tuple[float, ...],
    row_px: int,
) -> NDArray[np.float64]:
    """Return the energy (K, H, W) of each pixel at each centre; lab is (3, H, W) in Lab units (paper 3.1)."""
    space, color, depth, _ = weights
    height, width = w.shape
    y, x = np.mgrid[:height, :width]
    y *= row_px
    table = np.empty((len(centers), height, width))
    for k, (cx, cy, cl, ca, cb, pa, pb, pc, kw, cap, _ga, _gb) in enumerate(centers):
        energy = space * ((x - cx) ** 2 + (y - cy) ** 2)
        energy += color * ((lab[0] - cl) ** 2 + (lab[1] - ca) ** 2 + (lab[2] - cb) ** 2)
        residual = w - (pa * (x - cx) + pb * (y - cy) + pc)
        energy += np.where(w > 0, np.minimum(depth * kw * residual**2, cap), 0)
        table[k] = energy
    return table


def plane(w: NDArray[np.float32], mask: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float]:
    """Return (a, b, c) of the least-squares plane w = a x + b y + c over the measured pixels of a mask, and its SSE."""
    y, x = np.nonzero(mask & (w > 0))
    design = np.column_stack([x, y, np.ones(len(x))]).astype(float)
    values = w[y, x].astype(float)
    solution = np.linalg.lstsq(design, values, rcond=None)[0]
    return solution, float(((design @ solution - values) ** 2).sum())


def connected_pieces(index: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the 4-connected pieces of equal label, numbered in raster order of their first pixels."""
    pieces = np.zeros(index.shape, np.int64)
    n = 0
    for label in np.unique(index):
        found, count = ndimage.label(index == label)
        pieces[found > 0] = found[found > 0] + n
        n += count
    _, first, inverse = np.unique(pieces, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(rank[inverse].reshape(index.shape), np.int32)


def join_small(index: NDArray[np.int32], min_pixels: int) -> NDArray[np.int32]:
    """Join, piece by piece in raster order, those below `min_pixels` to the neighbour of the longest border."""
    group = np.arange(index.max() + 1)
    for piece in range(len(group)):
        while (group[index] == group[piece]).sum() < min_pixels:
            lengths: dict[int, int] = {}
            for (a, b), length in borders(group[index]).items():
                if group[piece] in (a, b):
                    lengths[a + b - group[piece]] = length
            if not lengths:
                break
            longest = max(lengths.values())
            group[group == group[piece]] = min(k for k, v in lengths.items() if v == longest)
    return group[index]


def borders(index: NDArray[np.integer]) -> dict[tuple[int, int], int]:
    """Return the length of the border of each pair i < j of touching labels, in pairs of 4-neighbouring pixels."""
    found: dict[tuple[int, int], int] = {}
    height, width = index.shape
    for y, x in itertools.product(range(height), range(width)):
        for v, u in ((y + 1, x), (y, x + 1)):
            if v < height and u < width and index[y, x] != index[v, u]:
                pair = (int(min(index[y, x], index[v, u])), int(max(index[y, x], index[v, u])))
                found[pair] = found.get(pair, 0) + 1
    return dict(sorted(found.items()))


def variation_of_information(segments: NDArray[np.integer], truth: NDArray[np.integer]) -> float:
    """Return H(S) + H(S') - 2 I in nats, from the definition, label by label."""
    total = 0.0
    for a, b in itertools.product(np.unique(segments), np.unique(truth)):
        joint = ((segments == a) & (truth == b)).mean()
        if joint > 0:
            total -= joint * (np.log(joint / (segments == a).mean()) + np.log(joint / (truth == b).mean()))
    return total


def covering(segments: NDArray[np.integer], truth: NDArray[np.integer]) -> float:
    """Return 1/N sum over true regions of their size times the best overlap (intersection over union)."""
    total = 0.0
    for b in np.unique(truth):
        region = truth == b
        overlaps = [((segments == a) & region).sum() / ((segments == a) | region).sum() for a in np.unique(segments)]
        total += region.sum() * max(overlaps)
    return total / truth.size
