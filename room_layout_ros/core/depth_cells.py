"""Cells of the depth image with the normals that fit them: gathered once per frame, turned into each naming's axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import CELL_PIXELS, CELL_PX, LEAST_MEASURED, DepthGeometry, depth_sigma, fit_cell_planes

_NO_NORMAL = 0.3
_NORMAL_RAD = np.deg2rad(6.0)
_RADII = (1, 2)
"""Half sizes of the windows that normals are fitted over; the wider window has the last word."""


@dataclass(frozen=True, slots=True)
class DepthCells:
    """Cells in the camera frame; n = rows x columns, row by row.

    Attributes
    ----------
    points : (n, 3) float64 mean points in m; NaN where too little was measured.
    normal : (n, 3) float64 unit normals; NaN where no plane fits.
    spread : (n,) float64, twice the variance of a normal's angle to its wall's, rad^2.
    sigma : (n,) float64 depth noise in m.
    """

    points: NDArray[np.float64]
    normal: NDArray[np.float64]
    spread: NDArray[np.float64]
    sigma: NDArray[np.float64]

    def turned(self, R: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the points in room axes R, (n, 3), and how well the normals agree with each axis, (n, 3) 0..1."""
        points, agreement = _turn(self.points, self.normal, self.spread, np.ascontiguousarray(R), _NO_NORMAL)
        return points, agreement


def gather_depth_cells(geometry: DepthGeometry) -> DepthCells:
    """Collect the cells of a depth image."""
    camera, moments = geometry.camera, geometry.moments
    rows, columns, _ = moments.shape
    points, sigma = _mean_points(moments, *camera.numbers)
    normal, spread = np.full((rows * columns, 3), np.nan), np.ones(rows * columns)
    for radius in _RADII:
        planes = fit_cell_planes(geometry, radius)
        _write_normals(planes.cell, planes.normal, planes.sigma, columns, normal, spread)
    return DepthCells(points, normal, spread, sigma)


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_points(moments, fx, fy, cx, cy):  # type: ignore[no-untyped-def]
    """(n, 3) points in m on the rays of the cells' centres, NaN where too little was measured, and (n,) depth noise."""
    rows, columns, _ = moments.shape
    points, sigma = np.full((rows * columns, 3), np.nan), np.empty(rows * columns)
    middle = (CELL_PX - 1) / 2
    for row in range(rows):
        for column in range(columns):
            cell, count = row * columns + column, moments[row, column, 0]
            z = 1.0  # for the noise, where nothing is known
            if count >= CELL_PIXELS * LEAST_MEASURED:
                z = count / moments[row, column, 3]
                points[cell, 0] = z * ((column * CELL_PX + middle - cx) / fx)
                points[cell, 1], points[cell, 2] = z * ((row * CELL_PX + middle - cy) / fy), z
            sigma[cell] = depth_sigma(z)
    return points, sigma


@njit(cache=True, nogil=True)
def _write_normals(cells, normals, sigma, columns, normal, spread):  # type: ignore[no-untyped-def]
    for i in range(len(cells)):
        cell = cells[i, 0] * columns + cells[i, 1]
        normal[cell] = normals[i]
        spread[cell] = 2.0 * (_NORMAL_RAD**2 + sigma[i] ** 2)


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(points, normal, spread, R, unknown):  # type: ignore[no-untyped-def]
    """Points in room axes, and exp(-2 (1 - |cos|) / spread), which is exp(-angle^2 / spread) for small angles."""
    turned, agreement = np.empty((len(points), 3)), np.empty((len(points), 3))
    for c in range(len(normal)):
        for k in range(3):
            turned[c, k] = points[c, 0] * R[k, 0] + points[c, 1] * R[k, 1] + points[c, 2] * R[k, 2]
            cosine = abs(normal[c, 0] * R[k, 0] + normal[c, 1] * R[k, 1] + normal[c, 2] * R[k, 2])
            exponent = 2.0 * (1.0 - cosine) / spread[c]
            if not exponent == exponent:
                agreement[c, k] = unknown
            else:
                agreement[c, k] = np.exp(-exponent) if exponent < 50.0 else 0.0
    return turned, agreement
