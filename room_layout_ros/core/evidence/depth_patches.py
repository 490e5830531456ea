"""Depth descriptors of patches: gradient, spin/normal, kernel PCA (Bo, Ren, Fox, IROS 2011; docs/evidence.md).

A patch with too few samples (`depth_samples.py`) has no descriptor, and what is not measured has no part in the
others': nothing is filled in.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from .color_patches import place_basis
from .depth_samples import SAMPLE_PX, plane_samples, slope_samples
from .match_kernels import Floats, MatchKernel

REACH = 4
"""A patch has the samples up to so many to each side of its centre: 9 x 9, 33 pixels wide."""

SPIN_REACH_M = 0.15
"""Unit of the coordinates of `spin`."""

EIGENVALUES = 10
"""Of the kernel matrix that are kept."""

_LEAST_SHARE = 0.5
"""Of a patch's samples that must be measured."""

_SLOPE_FLOOR = 1.0
"""Added to a patch's sum of squared slopes: below about 0.1 (6 degrees) a slope is the sensor's noise."""

_SELF_GAMMA = 50.0
"""Of the kernel between points, 1/m^2: 10 cm standard deviation."""

_SIDE = 2 * REACH + 1


def compute_depth_descriptors(
    inverse_depth: Floats, camera: CameraIntrinsics, centers: NDArray[np.int32], kernels: dict[str, MatchKernel]
) -> dict[str, Floats]:
    """Describe patches of the depth image.

    Parameters
    ----------
    inverse_depth : (H, W) float32, 1/m; 0 where nothing was measured.
    centers : (P, 2) int32 of `color_patches.patch_centers`.
    kernels : of `match_kernels.standard_kernels`.

    Returns
    -------
    dict of (P, D) float32
        "depth_gradient", "spin", "self_similarity"; rows of NaN where the patch has no descriptor.
    """
    points, normals = plane_samples(inverse_depth, *camera.numbers)
    middles = (centers // SAMPLE_PX).astype(np.int32)
    known = measured_patches(points, middles, REACH, _LEAST_SHARE)
    here = middles[known]
    return {
        "depth_gradient": _scatter(_gradient(kernels["depth_gradient"], normals, here), known),
        "spin": _scatter(_spin(kernels["spin"], points, normals, here), known),
        "self_similarity": _scatter(self_similarity(points, here), known),
    }


def _scatter(rows: Floats, known: NDArray[np.bool_]) -> Floats:
    """Put the rows of known patches among rows of NaN."""
    all_rows = np.full((len(known), rows.shape[1]), np.nan, np.float32)
    all_rows[known] = rows
    return all_rows


def _gradient(kernel: MatchKernel, normals: Floats, middles: NDArray[np.int32]) -> Floats:
    direction, slope = slope_samples(normals)
    attributes = kernel.attribute.embed(direction.reshape(-1, 2)).reshape(*slope.shape, -1)
    sums = sum_measured(attributes, slope, middles, REACH, place_basis(kernel, _SIDE), _SLOPE_FLOOR)
    return np.ascontiguousarray(sums[:, kernel.pairs[:, 0], kernel.pairs[:, 1]])


def _spin(kernel: MatchKernel, points: Floats, normals: Floats, middles: NDArray[np.int32]) -> Floats:
    a, b = kernel.attribute, kernel.position
    sums = sum_spin(
        points, normals, middles, REACH, SPIN_REACH_M,
        a.points, a.projection, a.gamma, b.points, b.projection, b.gamma,
    )  # fmt: skip
    return np.ascontiguousarray(sums[:, kernel.pairs[:, 0], kernel.pairs[:, 1]])


def self_similarity(points: Floats, middles: NDArray[np.int32]) -> Floats:
    """(P, 10) float32 largest eigenvalues of each patch's kernel matrix over its number of points (every second one).

    A point that was not measured has a row and a column of zeros, which adds an eigenvalue 0 and changes no other.
    """
    offsets = np.arange(-REACH, REACH + 1, 2)
    rows = middles[:, 0, None, None] + offsets[:, None]
    columns = middles[:, 1, None, None] + offsets
    height, width = points.shape[:2]
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    patch = points[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    patch = np.where(inside[..., None], patch, np.nan).reshape(len(middles), -1, 3)
    if len(patch) == 0:
        return np.zeros((0, EIGENVALUES), np.float32)
    measured = np.isfinite(patch[..., 0])
    matrix = kernel_matrices(np.ascontiguousarray(patch), _SELF_GAMMA)
    values = np.linalg.eigvalsh(matrix)[:, ::-1][:, :EIGENVALUES]
    return np.asarray(np.maximum(values, 0.0) / measured.sum(axis=1)[:, None], np.float32)


@njit(cache=True, nogil=True)
def kernel_matrices(patch, gamma):  # type: ignore[no-untyped-def]
    """(P, N, N) float32 kernel between the points of each patch, (P, N, 3) with NaN; 0 where one is not measured."""
    count, n, _ = patch.shape
    matrix = np.zeros((count, n, n), np.float32)
    for p in range(count):
        for i in range(n):
            for j in range(i + 1):
                squared = np.float32(0.0)
                for k in range(3):
                    squared += (patch[p, i, k] - patch[p, j, k]) ** 2
                if squared == squared:
                    matrix[p, i, j] = matrix[p, j, i] = np.exp(-gamma * squared)
    return matrix


@njit(cache=True, nogil=True)
def measured_patches(points, middles, reach, share):  # type: ignore[no-untyped-def]
    """(P,) bool: the centre and at least this share of the samples of a patch are measured."""
    height, width = points.shape[:2]
    known = np.zeros(len(middles), np.bool_)
    for p in range(len(middles)):
        y, x = middles[p]
        if not (y < height and x < width and points[y, x, 2] > 0.0):
            continue
        count = 0
        for i in range(max(y - reach, 0), min(y + reach + 1, height)):
            for j in range(max(x - reach, 0), min(x + reach + 1, width)):
                count += points[i, j, 2] > 0.0
        known[p] = count >= share * (2 * reach + 1) ** 2
    return known


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def sum_measured(attributes, weight, middles, reach, place, floor):  # type: ignore[no-untyped-def]
    """(P, A, B) float32 as `color_patches.sum_patches`, over the samples with a weight; NaN has none.

    Parameters
    ----------
    middles : (P, 2) int32 row and column of the centre sample of each patch, which may reach beyond the image.
    """
    n_a, n_b = attributes.shape[2], place.shape[1]
    height, width = weight.shape
    side = 2 * reach + 1
    sums = np.zeros((len(middles), n_a, n_b), np.float32)
    for p in range(len(middles)):
        squares = np.float32(floor)
        for i in range(side):
            for j in range(side):
                y, x = middles[p, 0] + i - reach, middles[p, 1] + j - reach
                if not (0 <= y < height and 0 <= x < width):
                    continue
                m = weight[y, x]
                if m == m:
                    squares += m * m
                    for a in range(n_a):
                        value = m * attributes[y, x, a]
                        for b in range(n_b):
                            sums[p, a, b] += value * place[i * side + j, b]
        scale = np.float32(1.0) / np.sqrt(squares)
        for a in range(n_a):
            for b in range(n_b):
                sums[p, a, b] *= scale
    return sums


@njit(cache=True, nogil=True)
def sum_spin(points, normals, middles, reach, unit, a_points, a_map, a_gamma, b_points, b_map, b_gamma):  # type: ignore[no-untyped-def]
    """(P, A, B) float32 mean over the measured ones of every second sample of a(angle) b(height, distance).

    Angle is that between the sample's normal and the centre's; height and distance are those from the centre's
    tangent plane and from the line along its normal, over `unit`. All three stay as they are when the scene is moved.
    """
    height, width, _ = points.shape
    n_a, n_b = a_map.shape[1], b_map.shape[1]
    sums = np.zeros((len(middles), n_a, n_b), np.float32)
    own_a, own_b = np.zeros(n_a, np.float32), np.zeros(n_b, np.float32)
    for p in range(len(middles)):
        row, column = middles[p]
        n0, p0 = normals[row, column], points[row, column]
        count = 0
        for y in range(row - reach, row + reach + 1, 2):
            for x in range(column - reach, column + reach + 1, 2):
                if not (0 <= y < height and 0 <= x < width and points[y, x, 2] > 0.0):
                    continue
                count += 1
                cosine, above, squared = np.float32(0.0), np.float32(0.0), np.float32(0.0)
                for k in range(3):
                    step = (points[y, x, k] - p0[k]) / unit
                    cosine += n0[k] * normals[y, x, k]
                    above += n0[k] * step
                    squared += step * step
                cosine = min(max(cosine, np.float32(-1.0)), np.float32(1.0))
                sine = np.sqrt(np.float32(1.0) - cosine * cosine)
                aside = np.sqrt(max(squared - above * above, np.float32(0.0)))
                own_a[:] = 0.0
                for i in range(len(a_points)):
                    k_a = np.exp(-a_gamma * ((cosine - a_points[i, 0]) ** 2 + (sine - a_points[i, 1]) ** 2))
                    for a in range(n_a):
                        own_a[a] += k_a * a_map[i, a]
                own_b[:] = 0.0
                for i in range(len(b_points)):
                    k_b = np.exp(-b_gamma * ((above - b_points[i, 0]) ** 2 + (aside - b_points[i, 1]) ** 2))
                    for b in range(n_b):
                        own_b[b] += k_b * b_map[i, b]
                for a in range(n_a):
                    for b in range(n_b):
                        sums[p, a, b] += own_a[a] * own_b[b]
        for a in range(n_a):
            for b in range(n_b):
                sums[p, a, b] /= max(count, 1)
    return sums
