"""Cells of the depth image with the normals that fit them: gathered once per frame, turned into each naming's axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import CELL_PX, NOISE_FLOOR_M, NOISE_QUADRATIC, DepthGeometry, depth_sigma, fit_cell_planes

_NO_NORMAL = 0.3
_NORMAL_RAD = np.deg2rad(6.0)
_MIN_MEASURED = 0.3
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
        return self.points @ R.T, _agreement(self.normal, self.spread, np.ascontiguousarray(R), _NO_NORMAL)


def gather_depth_cells(geometry: DepthGeometry) -> DepthCells:
    """Collect the cells of a depth image."""
    camera, moments = geometry.camera, geometry.moments
    rows, columns, _ = moments.shape
    x = (np.arange(columns) * CELL_PX + (CELL_PX - 1) / 2 - camera.cx) / camera.fx
    y = (np.arange(rows) * CELL_PX + (CELL_PX - 1) / 2 - camera.cy) / camera.fy
    n = moments[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(n >= CELL_PX * CELL_PX * _MIN_MEASURED, n / moments[..., 3], np.nan)
    points = np.stack([z * x, z * y[:, None], z], axis=-1).reshape(-1, 3)
    normal, spread = np.full((rows * columns, 3), np.nan), np.ones(rows * columns)
    for radius in _RADII:
        planes = fit_cell_planes(geometry, radius)
        cell = planes.cell[:, 0] * columns + planes.cell[:, 1]
        normal[cell], spread[cell] = planes.normal, 2.0 * (_NORMAL_RAD**2 + planes.sigma**2)
    sigma = np.asarray(depth_sigma(np.nan_to_num(points[:, 2], nan=1.0), NOISE_FLOOR_M, NOISE_QUADRATIC))
    return DepthCells(points, normal, spread, sigma)


@njit(cache=True, nogil=True, error_model="numpy")
def _agreement(normal, spread, R, unknown):  # type: ignore[no-untyped-def]
    """exp(-2 (1 - |cos|) / spread), which is exp(-angle^2 / spread) for small angles."""
    result = np.empty((len(normal), 3))
    for c in range(len(normal)):
        for k in range(3):
            cosine = abs(normal[c, 0] * R[k, 0] + normal[c, 1] * R[k, 1] + normal[c, 2] * R[k, 2])
            exponent = 2.0 * (1.0 - cosine) / spread[c]
            if not exponent == exponent:
                result[c, k] = unknown
            else:
                result[c, k] = np.exp(-exponent) if exponent < 50.0 else 0.0
    return result
