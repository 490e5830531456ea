"""Slow, obvious twins of the kernels behind `evidence.kernel_descriptors`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


def gaussian(x: Array, y: Array, gamma: float) -> float:
    return float(np.exp(-gamma * ((x - y) ** 2).sum()))


def embed(value: Array, points: Array, projection: Array, gamma: float) -> Array:
    return np.array([gaussian(value, point, gamma) for point in points]) @ projection


def gradient_samples(gray: Array) -> tuple[Array, Array]:
    height, width = gray.shape
    direction, length = np.zeros((height, width, 2)), np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            gx, gy = _slope(gray[y], x), _slope(gray[:, x], y)
            length[y, x] = np.hypot(gx, gy)
            if length[y, x] > 0:
                direction[y, x] = gx / length[y, x], gy / length[y, x]
    return direction, length


def _slope(line: Array, at: int) -> float:
    """Central difference, one-sided at the ends."""
    there = [k for k in (at - 1, at, at + 1) if 0 <= k < len(line)]
    first, last = there[0], there[-1]
    return float(line[last] - line[first]) / (last - first) if last > first else 0.0


AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))


def pattern_samples(gray: Array) -> tuple[NDArray[np.uint8], Array]:
    padded = np.pad(gray, 1, mode="edge").astype(np.float64)
    codes, contrast = np.zeros(gray.shape, np.uint8), np.zeros(gray.shape)
    for y in range(gray.shape[0]):
        for x in range(gray.shape[1]):
            neighbours = [padded[y + 1 + dy, x + 1 + dx] for dy, dx in AROUND]
            codes[y, x] = sum(1 << k for k, value in enumerate(neighbours) if value > padded[y + 1, x + 1])
            contrast[y, x] = padded[y : y + 3, x : x + 3].std()
    return codes, contrast


def sum_patch(attributes: Array, weight: Array, place: Array, floor: float) -> Array:
    """(A, B) of one patch: (side, side, A), (side, side) with NaN where there is no sample, (side * side, B)."""
    side = len(weight)
    total = np.zeros((attributes.shape[2], place.shape[1]))
    squares = floor
    for i in range(side):
        for j in range(side):
            if np.isfinite(weight[i, j]):
                squares += weight[i, j] ** 2
                total += weight[i, j] * np.outer(attributes[i, j], place[i * side + j])
    return total / np.sqrt(squares) if squares > 0 else total


def plane_sample(
    inverse_depth: Array, y0: int, x0: int, camera: Any, window: int = 10, stride: int = 2
) -> tuple[Array, Array]:
    """Point and normal of the plane fitted around a pixel, NaN where less than half is measured."""
    height, width = inverse_depth.shape
    rows, values, full = [], [], 0
    for dy in range(-window, window + 1, stride):
        for dx in range(-window, window + 1, stride):
            full += 1
            y, x = y0 + dy, x0 + dx
            if 0 <= y < height and 0 <= x < width and inverse_depth[y, x] > 0:
                rows.append(((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0))
                values.append(float(inverse_depth[y, x]))
    if len(rows) < 0.5 * full:
        return np.full(3, np.nan), np.full(3, np.nan)
    m = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]  # w = m . ray, m = n / d
    ray = np.array([(x0 - camera.cx) / camera.fx, (y0 - camera.cy) / camera.fy, 1.0])
    return ray / (m @ ray), m / np.linalg.norm(m)


def spin_coordinates(point: Array, normal: Array, other: Array, other_normal: Array) -> tuple[Array, Array]:
    """(cosine, sine) of the angle between normals; height over the tangent plane, distance from the normal's line."""
    cosine = float(normal @ other_normal)
    step = other - point
    above = float(normal @ step)
    aside = float(np.linalg.norm(step - above * normal))
    return np.array([cosine, np.sqrt(max(1.0 - cosine**2, 0.0))]), np.array([above, aside])


def self_similarity(points: Array, gamma: float, count: int) -> Array:
    """Largest eigenvalues of the kernel matrix of the measured (N, 3) points alone, over their number; 0 beyond."""
    there = points[np.isfinite(points[:, 0])]
    matrix = np.array([[gaussian(a, b, gamma) for b in there] for a in there])
    values = np.sort(np.linalg.eigvalsh(matrix))[::-1][:count] / len(there)
    return np.pad(values, (0, count - len(values)))


def pool_means(rows: Array, owner: NDArray[np.integer[Any]], count: int) -> Array:
    means = np.full((count, rows.shape[1]), np.nan)
    for k in range(count):
        own = [row for row, of in zip(rows, owner, strict=True) if of == k and np.isfinite(row).all()]
        if own:
            means[k] = np.mean(own, axis=0)
    return means


def region_mean(
    k: int, edges: NDArray[np.integer[Any]], wanted: NDArray[np.bool_], area: Array, features: Array, reach: int
) -> Array:
    """Mean over all wanted nodes that are at most `reach` borders from k, by area, of what is known."""
    region = {k}
    for _ in range(reach):
        region |= {int(b) for a, b in [*edges, *edges[:, ::-1]] if a in region and wanted[b]}
    rows, weight = features[sorted(region)], area[sorted(region)]
    means = np.full(features.shape[1], np.nan)
    for c in range(features.shape[1]):
        known = np.isfinite(rows[:, c])
        if known.any():
            means[c] = np.average(rows[known, c], weights=weight[known])
    return means
