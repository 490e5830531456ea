"""The six RGB-D kernel descriptors of superpixels (paper 4; docs/evidence.md).

Patches on a grid are described by gradient, colour, local binary pattern, gradient of depth, spin/normal and kernel
PCA; efficient match kernels (Bo, Sminchisescu, NIPS 2009) compare each descriptor with learned words and take the
mean over the patches of a superpixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..depth import DepthGeometry
from ..superpixels import Superpixels
from .color_patches import compute_color_descriptors, patch_centers
from .depth_patches import compute_depth_descriptors
from .match_kernels import CompactBasis, Floats, MatchKernel

COLOR = ("gradient", "color", "pattern")
DEPTH = ("depth_gradient", "spin", "self_similarity")
DESCRIPTORS = (*COLOR, *DEPTH)
"""Names, in the order of the columns."""


@dataclass(frozen=True, slots=True)
class DescriptorModel:
    """What the descriptors of superpixels are computed with.

    Attributes
    ----------
    kernels : match kernel of each descriptor but "self_similarity", which is none.
    words : visual words of each descriptor, with their projection.

    Raises
    ------
    ValueError
        When a descriptor is missing, or its words are of another length than it.
    """

    kernels: dict[str, MatchKernel]
    words: dict[str, CompactBasis]

    def __post_init__(self) -> None:
        if set(self.words) != set(DESCRIPTORS) or set(self.kernels) != set(DESCRIPTORS) - {"self_similarity"}:
            raise ValueError(f"descriptor model has words of {sorted(self.words)}; those of {DESCRIPTORS} are needed")
        for name, kernel in self.kernels.items():
            if self.words[name].points.shape[1] != len(kernel.pairs):
                raise ValueError(
                    f"words of {name} have {self.words[name].points.shape[1]} components; "
                    f"the descriptor has {len(kernel.pairs)}"
                )

    def columns(self, names: tuple[str, ...]) -> NDArray[np.intp]:
        """Return the columns of these descriptors in the rows of `describe_superpixels`."""
        ends = np.cumsum([self.words[name].projection.shape[1] for name in DESCRIPTORS])
        starts = dict(zip(DESCRIPTORS, [0, *ends[:-1]], strict=True))
        return np.concatenate(
            [starts[name] + np.arange(self.words[name].projection.shape[1], dtype=np.intp) for name in names]
        )


def describe_patches(
    color: NDArray[np.uint8] | None,
    geometry: DepthGeometry | None,
    centers: NDArray[np.int32],
    kernels: dict[str, MatchKernel],
) -> dict[str, Floats]:
    """Describe patches by what there is: (P, D) float32 by name, rows of NaN where a patch has no depth; none of none.

    Parameters
    ----------
    color : (H, W, 3) uint8 RGB, or None. geometry : DepthGeometry or None.
    centers : (P, 2) int32 of `color_patches.patch_centers`.
    """
    found: dict[str, Floats] = {}
    if len(centers) == 0:
        return found
    if color is not None:
        found |= compute_color_descriptors(color, centers, kernels)
    if geometry is not None:
        found |= compute_depth_descriptors(geometry.inverse_depth, geometry.camera, centers, kernels)
    return found


def describe_superpixels(
    color: NDArray[np.uint8] | None,
    geometry: DepthGeometry | None,
    superpixels: Superpixels,
    wanted: NDArray[np.bool_],
    model: DescriptorModel,
) -> Floats:
    """Describe superpixels by the mean of their patches, those whose centre they contain.

    Parameters
    ----------
    color : (H, W, 3) uint8 RGB, or None. geometry : DepthGeometry or None.
    wanted : (K,) bool; the others are not looked at.

    Returns
    -------
    (K, D) float32
        Columns in the order of `DESCRIPTORS`. NaN where nothing is known: all of a superpixel that is not wanted or
        has no patch; the columns of depth, or of colour, where none of its patches has any.
    """
    centers = patch_centers(*superpixels.index.shape)
    owner = superpixels.index[centers[:, 0], centers[:, 1]]
    kept = wanted[owner]
    centers, owner = np.ascontiguousarray(centers[kept]), np.ascontiguousarray(owner[kept])
    patches = describe_patches(color, geometry, centers, model.kernels)
    blocks = []
    for name in DESCRIPTORS:
        words = model.words[name]
        if name in patches:
            likeness = words.compare(patches[name])
            blocks.append(pool_means(likeness, owner, superpixels.count) @ words.projection)
        else:
            blocks.append(np.full((superpixels.count, words.projection.shape[1]), np.nan, np.float32))
    return np.concatenate(blocks, axis=1)


@njit(cache=True, nogil=True)
def pool_means(rows, owner, count):  # type: ignore[no-untyped-def]
    """(count, n) float32 mean of the (P, n) rows of each owner; those of NaN do not count; NaN is the mean of none."""
    total = np.zeros((count, rows.shape[1]), np.float32)
    number = np.zeros(count, np.int64)
    for p in range(len(rows)):
        if rows[p, 0] == rows[p, 0]:
            number[owner[p]] += 1
            for k in range(rows.shape[1]):
                total[owner[p], k] += rows[p, k]
    for i in range(count):
        for k in range(rows.shape[1]):
            total[i, k] = total[i, k] / number[i] if number[i] else np.nan
    return total
