"""Compact bases of match kernels (Bo, Ren, Fox, NIPS 2010, 2.3 and IROS 2011; docs/evidence.md).

A match kernel compares two patches by every pair of their samples: sum m m' k_a(x, x') k_p(p, p'), Gaussian kernels of
attribute and position. On a finite basis it is a scalar product. The basis is a grid of attributes times a grid of
positions, compressed by kernel PCA: as the kernel is a product, so are its eigenvectors, and the best components of
the joint basis are pairs of components of the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

DIMENSIONS = 50
"""Components kept of the joint basis of a descriptor."""


@dataclass(frozen=True, slots=True)
class CompactBasis:
    """One factor of a match kernel: k(x, y) = exp(-gamma |x - y|^2) is about embed(x) . embed(y).

    Attributes
    ----------
    points : (B, d) float32 basis vectors. projection : (B, n) float32, n <= B. gamma : float.

    Raises
    ------
    ValueError
        When the shapes do not agree.
    """

    points: Floats
    projection: Floats
    gamma: float

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.projection.ndim != 2 or len(self.points) != len(self.projection):
            raise ValueError(
                f"points of a basis are {self.points.shape} and its projection {self.projection.shape}; "
                "both must be 2-D with as many rows"
            )

    def compare(self, values: NDArray[np.floating]) -> Floats:
        """(N, B) float32 kernel of (N, d) values and the basis vectors."""
        x = np.asarray(values, np.float32)
        gamma, points = np.float32(self.gamma), self.points
        power = x @ (points.T * (2 * gamma))  # -gamma |x - p|^2, in place: there are many values
        power -= gamma * (x * x).sum(axis=1)[:, None]
        power -= gamma * (points * points).sum(axis=1)
        np.minimum(power, 0.0, out=power)
        return np.asarray(np.exp(power, out=power), np.float32)

    def embed(self, values: NDArray[np.floating]) -> Floats:
        """(N, n) float32 coordinates of (N, d) values."""
        return np.asarray(self.compare(values) @ self.projection, np.float32)


@dataclass(frozen=True, slots=True)
class MatchKernel:
    """A match kernel on its compact basis.

    Attributes
    ----------
    attribute, position : CompactBasis of the two factors.
    pairs : (D, 2) int16 which component of each makes a component of the descriptor.

    Raises
    ------
    ValueError
        When a pair names a component that there is not.
    """

    attribute: CompactBasis
    position: CompactBasis
    pairs: NDArray[np.int16]

    def __post_init__(self) -> None:
        sizes = self.attribute.projection.shape[1], self.position.projection.shape[1]
        if self.pairs.ndim != 2 or self.pairs.shape[1] != 2 or (self.pairs < 0).any() or (self.pairs >= sizes).any():
            raise ValueError(f"pairs of a match kernel are not (D, 2) of components below {sizes}")


def make_match_kernel(
    attributes: NDArray[np.floating],
    attribute_gamma: float,
    positions: NDArray[np.floating],
    position_gamma: float,
    dimensions: int = DIMENSIONS,
) -> MatchKernel:
    """Find the compact basis of a match kernel.

    Parameters
    ----------
    attributes : (A, d) and positions : (B, e), grids of basis vectors.
    dimensions : components to keep, those with the largest eigenvalues over the joint basis.
    """
    joint = np.outer(_eigen(attributes, attribute_gamma)[0], _eigen(positions, position_gamma)[0])
    best = np.argsort(-joint, axis=None, kind="stable")[:dimensions]
    pairs = np.stack(np.unravel_index(best, joint.shape), axis=1)
    n_a, n_b = pairs.max(axis=0) + 1
    return MatchKernel(
        compact_basis(attributes, attribute_gamma, n_a),
        compact_basis(positions, position_gamma, n_b),
        pairs.astype(np.int16),
    )


def compact_basis(points: NDArray[np.floating], gamma: float, dimensions: int) -> CompactBasis:
    """Kernel PCA on a set of basis vectors: the components of the `dimensions` largest eigenvalues, or all."""
    values, vectors = _eigen(points, gamma)
    projection = vectors[:, :dimensions] / np.sqrt(values[:dimensions])
    return CompactBasis(np.ascontiguousarray(points, np.float32), np.ascontiguousarray(projection, np.float32), gamma)


def _eigen(points: NDArray[np.floating], gamma: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues, falling, and eigenvectors of the kernel matrix; those below 1e-6 of the first are left out."""
    x = np.asarray(points, np.float64)
    values, vectors = np.linalg.eigh(np.exp(-gamma * ((x[:, None] - x[None]) ** 2).sum(axis=2)))
    values, vectors = values[::-1], vectors[:, ::-1]
    kept = values > 1e-6 * values[0]
    return values[kept], vectors[:, kept]


def circle(angles: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, 2) cosine and sine: a Gaussian of their difference is a kernel of the angle."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def lattice(*axes: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, d) every combination of the values of d axes."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def binary_patterns() -> NDArray[np.float64]:
    """(256, 8) the bits of 0..255."""
    return ((np.arange(256)[:, None] >> np.arange(8)) & 1).astype(np.float64)


_FIVE = np.linspace(0.0, 1.0, 5)


def standard_kernels() -> dict[str, MatchKernel]:
    """The five descriptors that are match kernels, by name; widths as in the papers' own programs, for `spin` chosen.

    Attributes: direction of the gradient (and of depth's), colour (RGB, 0..1), binary pattern, angle between normals;
    positions: in the patch (0..1), for `spin` height over the tangent plane and distance from the normal's line, in
    units of `depth_patches.SPIN_REACH_M`.
    """
    places = lattice(_FIVE, _FIVE)
    directions = circle(np.arange(25) * (2.0 * np.pi / 25))
    around = lattice(np.linspace(-1.0, 1.0, 7), np.linspace(0.0, 1.0, 5))
    return {
        "gradient": make_match_kernel(directions, 5.0, places, 3.0),
        "color": make_match_kernel(lattice(_FIVE, _FIVE, _FIVE), 4.0, places, 3.0),
        "pattern": make_match_kernel(binary_patterns(), 2.0, places, 3.0),
        "depth_gradient": make_match_kernel(directions, 5.0, places, 3.0),
        "spin": make_match_kernel(circle(np.linspace(0.0, np.pi, 13)), 5.0, around, 3.0),
    }
