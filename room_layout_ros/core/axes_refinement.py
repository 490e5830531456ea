"""Refinement of Manhattan axes on whole planes (docs/method.md, section 4).

A cell's normal is good to some degrees, a whole wall's to a tenth: cells that agree with an axis are grown into
connected planes, their summed moments give one least-squares plane each, and the rotation that fits these planes'
normals best (robustly, weighted by their precision) follows by Gauss-Newton. Repeated, as better axes grow better
planes.

Where there is colour, line segments help: the plane through the camera and a segment along an axis contains that axis.
They carry the precision that a coarse depth image lacks (docs/results.md has the ablation).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import MOMENTS, CellPlanes, DepthGeometry, depth_sigma, fit_cell_planes, plane_of_moments
from .room_axes import cross, nearest_rotation, rotate_rows

_FIRST_TOLERANCE_RAD = np.deg2rad(15.0)
_TOLERANCE_RAD = np.deg2rad(8.0)
_MIN_CELLS = 30
_BEST_SIGMA_RAD = np.deg2rad(0.3)
"""No plane's normal is trusted beyond this: walls are not flat and lenses not perfect."""
_CAUCHY_RAD = np.deg2rad(1.5)
_LINE_SIGMA_RAD = np.deg2rad(0.5)
_LINE_TOLERANCE_RAD = np.deg2rad(3.0)
_LINE_REFERENCE_PX = 60.0
"""A segment of this length weighs as one measurement of `_LINE_SIGMA_RAD`."""


def refine_on_planes(
    geometry: DepthGeometry,
    R: NDArray[np.float64],
    line_normals: NDArray[np.float64] | None = None,
    line_lengths: NDArray[np.float64] | None = None,
    rounds: int = 3,
    cells: CellPlanes | None = None,
) -> NDArray[np.float64]:
    """Turn the axes `R` (rows, camera frame) onto the planes and lines that are nearly aligned with them.

    Parameters
    ----------
    geometry : DepthGeometry
    R : (3, 3) float64 rotation, within about 15 degrees of the truth
    line_normals, line_lengths : (l, 3) unit normals of the segments' interpretation planes, (l,) px; optional
    rounds : int
    cells : CellPlanes, optional
        `fit_cell_planes(geometry, radius=1)`, where several axes are refined.

    Returns
    -------
    (3, 3) float64 rotation; `R` itself where no plane is large enough.
    """
    cells = cells or fit_cell_planes(geometry, radius=1)
    if line_normals is None or line_lengths is None:
        line_normals, line_lengths = np.empty((0, 3)), np.empty(0)
    line_weights = line_lengths / _LINE_REFERENCE_PX / _LINE_SIGMA_RAD**2
    planes = cells.cell, cells.normal, cells.centroid, cells.sigma
    return np.asarray(_refine(geometry.moments, planes, line_normals, line_weights, np.ascontiguousarray(R), rounds))


@njit(cache=True, nogil=True)
def _refine(moments, cells, line_normals, line_weights, R, rounds):  # type: ignore[no-untyped-def]
    """Grow planes and turn the axes onto them, `rounds` times."""
    cell, normal, centroid, sigma = cells
    rows, cols, _ = moments.shape
    for round_ in range(rounds):
        tolerance = _FIRST_TOLERANCE_RAD if round_ == 0 else _TOLERANCE_RAD
        plane, n_planes = _grow(rows, cols, cell, normal, centroid, sigma, R, tolerance)
        normals, axes, weights = _plane_normals(moments, cell, plane, n_planes, R, _MIN_CELLS)
        if len(axes) == 0 and len(line_normals) == 0:
            return R
        R = _turn(normals, axes, weights, line_normals, line_weights, R)
    return nearest_rotation(R)


@njit(cache=True, nogil=True)
def _plane_normals(moments, cell, plane, n_planes, R, min_cells):  # type: ignore[no-untyped-def]
    """Normals (p, 3), nearest axes (p,) and weights (p,) of the planes of at least `min_cells` cells."""
    sums = np.zeros((n_planes, MOMENTS))
    cells = np.zeros(n_planes, np.int32)
    for i in range(len(plane)):
        if plane[i] >= 0:
            cells[plane[i]] += 1
            for k in range(MOMENTS):
                sums[plane[i], k] += moments[cell[i, 0], cell[i, 1], k]
    normals = np.empty((n_planes, 3))
    axes = np.empty(n_planes, np.int64)
    weights = np.empty(n_planes)
    count = 0
    for p in range(n_planes):
        if cells[p] < min_cells:
            continue
        (a, b, c), (_, _, w), det, (xx, yy), _ = plane_of_moments(sums[p])
        if det < 1e-12:
            continue
        length = np.sqrt(a * a + b * b + c * c)
        best = 0.0
        for k in range(3):
            cosine = (R[k, 0] * a + R[k, 1] * b + R[k, 2] * c) / length
            if abs(cosine) > abs(best):
                best = cosine
                axes[count] = k
        sign = 1.0 if best >= 0 else -1.0
        normals[count, 0], normals[count, 1] = sign * a / length, sign * b / length
        normals[count, 2] = sign * c / length
        # Neighbouring errors go together: a cell counts as one measurement, not its `CELL_PIXELS`.
        sigma_w = depth_sigma(1.0 / w) * w * w
        spread = sigma_w * np.sqrt((xx + yy) / det / cells[p]) / length
        weights[count] = np.sqrt(cells[p]) / (spread**2 + _BEST_SIGMA_RAD**2)
        count += 1
    return normals[:count], axes[:count], weights[:count]


@njit(cache=True, nogil=True)
def _turn(normals, axes, weights, line_normals, line_weights, R):  # type: ignore[no-untyped-def]
    """Small robust rotation of R's rows onto normals of their axes and into planes of lines (Gauss-Newton, Cauchy)."""
    for _ in range(10):
        A = np.zeros((3, 3))
        g = np.zeros(3)
        total = 0.0
        for i in range(len(axes)):
            t = R[axes[i]]
            rx, ry, rz = cross(t, normals[i])  # rotation vector that takes the axis to the normal
            w = weights[i] / (1.0 + (rx * rx + ry * ry + rz * rz) / _CAUCHY_RAD**2)
            total += weights[i]
            g[0] += w * rx
            g[1] += w * ry
            g[2] += w * rz
            for j in range(3):
                A[j, j] += w
                for k in range(3):
                    A[j, k] -= w * t[j] * t[k]  # a normal says nothing about the rotation around itself
        for i in range(len(line_normals)):
            n = line_normals[i]
            axis, signed = -1, _LINE_TOLERANCE_RAD
            for k in range(3):
                off = R[k, 0] * n[0] + R[k, 1] * n[1] + R[k, 2] * n[2]
                if abs(off) < abs(signed):
                    axis, signed = k, off
            if axis < 0:
                continue
            gx, gy, gz = cross(R[axis], n)  # gradient of `signed` by the rotation vector
            w = line_weights[i] / (1.0 + signed**2 / _LINE_SIGMA_RAD**2)
            total += w
            g[0] -= w * signed * gx
            g[1] -= w * signed * gy
            g[2] -= w * signed * gz
            A[0, 0] += w * gx * gx
            A[1, 1] += w * gy * gy
            A[2, 2] += w * gz * gz
            A[0, 1] += w * gx * gy
            A[0, 2] += w * gx * gz
            A[1, 2] += w * gy * gz
            A[1, 0] += w * gx * gy
            A[2, 0] += w * gx * gz
            A[2, 1] += w * gy * gz
        for j in range(3):
            A[j, j] += 1e-3 * total + 1e-9
        step = np.linalg.solve(A, g)
        R = rotate_rows(R, step)
        if (step**2).sum() < 1e-12:
            break
    return R


@njit(cache=True, nogil=True)
def _grow(rows, cols, cell, normal, centroid, sigma, R, tolerance):  # type: ignore[no-untyped-def]
    """Connected cells on one plane along an axis: (plane index per cell or -1, number of planes)."""
    n = len(cell)
    at = -np.ones((rows, cols), np.int32)
    axis = -np.ones(n, np.int8)
    for i in range(n):
        at[cell[i, 0], cell[i, 1]] = i
        best = 0.0
        for k in range(3):
            c = abs(R[k, 0] * normal[i, 0] + R[k, 1] * normal[i, 1] + R[k, 2] * normal[i, 2])
            if c > best:
                best = c
                if c > np.cos(min(tolerance + 1.5 * sigma[i], 0.6)):
                    axis[i] = k
    plane = -np.ones(n, np.int32)
    stack = np.empty(n, np.int32)
    count = 0
    for seed in range(n):
        if axis[seed] < 0 or plane[seed] >= 0:
            continue
        plane[seed] = count
        stack[0] = seed
        top = 1
        k = axis[seed]
        while top > 0:
            top -= 1
            i = stack[top]
            for move in range(4):
                r = cell[i, 0] + (1 if move == 0 else -1 if move == 1 else 0)
                c = cell[i, 1] + (1 if move == 2 else -1 if move == 3 else 0)
                if r < 0 or r >= rows or c < 0 or c >= cols:
                    continue
                j = at[r, c]
                if j < 0 or plane[j] >= 0 or axis[j] != k:
                    continue
                dx = centroid[j, 0] - centroid[i, 0]
                dy = centroid[j, 1] - centroid[i, 1]
                dz = centroid[j, 2] - centroid[i, 2]
                off = abs(R[k, 0] * dx + R[k, 1] * dy + R[k, 2] * dz)
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                if off < length * tolerance + 2.0 * depth_sigma(centroid[i, 2]):
                    plane[j] = count
                    stack[top] = j
                    top += 1
        count += 1
    return plane, count
