"""Geometry of the depth image: inverse depth, and planes of square cells (docs/method.md, section 3 and 4).

Everything is done in inverse depth w = 1/Z: on a plane it is affine in the pixel, w = m . K^-1 (x, y, 1), where
m = n / d is the plane's unit normal over its distance. A plane fit is therefore a linear least-squares problem whose
sums (`MOMENTS` numbers per cell) add up over any set of cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .config import EstimatorConfig
from .frame import CameraIntrinsics, RgbdFrame

CELL_PX = 10
MOMENTS = 10
"""Sums kept per cell over its rays (x, y, 1) and inverse depths w: 1, x, y, w, xx, xy, yy, xw, yw, ww."""

NOISE_FLOOR_M = 0.01
"""Standard deviation that any depth measurement has, whatever the sensor says."""

NOISE_QUADRATIC = 0.0019
"""Kinect-like growth of the noise: sigma_Z = floor + quadratic Z^2 (Z in m). Structured light and stereo alike."""

LEAST_MEASURED = 0.3
"""Share of a cell's pixels that must have depth for the cell to have one."""

CELL_PIXELS = CELL_PX * CELL_PX

MAD_TO_SIGMA = 1.4826
"""Standard deviation of normal noise over its median absolute deviation."""


@dataclass(frozen=True)  # without slots, in which nothing could be kept: `moments` are made once, when asked for
class DepthGeometry:
    """What the depth image says, before any room is assumed.

    Attributes
    ----------
    inverse_depth : (H, W) float32, 1/m; 0 where nothing was measured.
    measured : share of pixels with depth, 0..1.
    """

    camera: CameraIntrinsics
    inverse_depth: NDArray[np.float32]
    measured: float

    @cached_property
    def moments(self) -> NDArray[np.float64]:
        """(rows, cols, 10) float64 sums per cell of `CELL_PX` pixels, see `MOMENTS`."""
        return np.asarray(_cell_moments(self.inverse_depth, CELL_PX, *self.camera.numbers), np.float64)

    def points(self, stride: int = 1) -> NDArray[np.float32]:
        """Return (h, w, 3) float32 points in the camera frame in metres, NaN where nothing was measured."""
        w = self.inverse_depth[::stride, ::stride]
        with np.errstate(divide="ignore"):
            z = np.where(w > 0, 1.0 / w, np.nan).astype(np.float32)
        return self.camera.rays()[::stride, ::stride] * z[..., None]


def compute_depth_geometry(frame: RgbdFrame, config: EstimatorConfig) -> DepthGeometry | None:
    """Return the geometry of a frame, or None where it has no depth or too little (`config.min_valid_depth`)."""
    if frame.depth_m is None or not config.use_depth:
        return None
    depth = np.ascontiguousarray(frame.depth_m)
    inverse, count = _inverse(depth, config.min_depth_m, config.max_depth_m)
    measured = count / depth.size
    if count == 0 or measured < config.min_valid_depth:
        return None
    return DepthGeometry(frame.camera, inverse, measured)


@dataclass(frozen=True, slots=True)
class CellPlanes:
    """Planes fitted over windows of cells; flat arrays over the cells that have one.

    Attributes
    ----------
    cell : (n, 2) int32 row and column of the window's centre cell.
    normal : (n, 3) float64 unit normals away from the camera (n . P = distance > 0), camera frame.
    distance : (n,) float64, m. centroid : (n, 3) mean point, m.
    sigma : (n,) float64 standard deviation of the normal's direction in radians.
    """

    cell: NDArray[np.int32]
    normal: NDArray[np.float64]
    distance: NDArray[np.float64]
    centroid: NDArray[np.float64]
    sigma: NDArray[np.float64]


def fit_cell_planes(geometry: DepthGeometry, radius: int = 1, max_residual: float = 2.5) -> CellPlanes:
    """Fit a plane over each window of (2 radius + 1)^2 cells, where one plane explains it.

    Parameters
    ----------
    radius : int
        Half size of the window in cells. A window of 30 px at 3 m is 17 cm wide: enough for a Kinect; 8-bit depth
        needs 50 px and more.
    max_residual : float
        Largest accepted r.m.s. residual in units of the depth noise.
    """
    return CellPlanes(*_fit_windows(geometry.moments, radius, max_residual))


@njit(cache=True, nogil=True)
def depth_sigma(z, floor=NOISE_FLOOR_M, quadratic=NOISE_QUADRATIC):  # type: ignore[no-untyped-def]
    """Standard deviation in m of a depth measurement at z m."""
    return floor + quadratic * z * z


@njit(cache=True, nogil=True)
def _inverse(depth, near, far):  # type: ignore[no-untyped-def]
    height, width = depth.shape
    inverse = np.zeros((height, width), np.float32)
    count = 0
    for y in range(height):
        for x in range(width):
            z = depth[y, x]
            if z > 0.0 and near <= z <= far:
                inverse[y, x] = 1.0 / z
                count += 1
    return inverse, count


@njit(cache=True, nogil=True)
def _cell_moments(inverse, size, fx, fy, cx, cy):  # type: ignore[no-untyped-def]
    height, width = inverse.shape
    rows, cols = height // size, width // size
    moments = np.zeros((rows, cols, MOMENTS))
    rays = (np.arange(width) - cx) / fx
    for y in range(rows * size):
        ry = (y - cy) / fy
        for col in range(cols):
            n = 0
            sx = sw = sxx = sxw = sww = 0.0
            for x in range(col * size, (col + 1) * size):
                w = inverse[y, x]
                if w > 0:
                    rx = rays[x]
                    n += 1
                    sx += rx
                    sw += w
                    sxx += rx * rx
                    sxw += rx * w
                    sww += w * w
            cell = moments[y // size, col]
            cell[0] += n
            cell[1] += sx
            cell[2] += n * ry
            cell[3] += sw
            cell[4] += sxx
            cell[5] += ry * sx
            cell[6] += n * ry * ry
            cell[7] += sxw
            cell[8] += ry * sw
            cell[9] += sww
    return moments


@njit(cache=True, nogil=True, error_model="numpy")
def plane_of_moments(s):  # type: ignore[no-untyped-def]
    """Least-squares plane w = a x + b y + c of summed `MOMENTS`.

    Returns (a, b, c), the mean (x, y, w), the determinant of the rays' variance (where it is next to 0, the rays span
    no plane), its diagonal (xx, yy), and the mean squared residual.
    """
    n = s[0]
    x, y, w = s[1] / n, s[2] / n, s[3] / n
    xx, xy, yy = s[4] / n - x * x, s[5] / n - x * y, s[6] / n - y * y
    xw, yw, ww = s[7] / n - x * w, s[8] / n - y * w, s[9] / n - w * w
    det = xx * yy - xy * xy
    a = (yy * xw - xy * yw) / det
    b = (xx * yw - xy * xw) / det
    return (a, b, w - a * x - b * y), (x, y, w), det, (xx, yy), max(ww - a * xw - b * yw, 0.0)


@njit(cache=True, nogil=True)
def _fit_windows(moments, radius, max_residual):  # type: ignore[no-untyped-def]
    rows, cols, _ = moments.shape
    capacity = rows * cols
    cells = np.empty((capacity, 2), np.int32)
    normals = np.empty((capacity, 3))
    distances = np.empty(capacity)
    centroids = np.empty((capacity, 3))
    sigmas = np.empty(capacity)
    full = (2 * radius + 1) ** 2 * float(CELL_PIXELS)
    count = 0
    s = np.empty(MOMENTS)
    for row in range(radius, rows - radius):
        for col in range(radius, cols - radius):
            s[:] = 0.0
            for i in range(row - radius, row + radius + 1):
                for j in range(col - radius, col + radius + 1):
                    for k in range(MOMENTS):
                        s[k] += moments[i, j, k]
            n = s[0]
            if n < 0.5 * full:
                continue
            (a, b, c), (x, y, w), det, (xx, yy), residual = plane_of_moments(s)
            if det < 1e-14:
                continue
            z = 1.0 / w
            sigma_w = depth_sigma(z) * w * w
            if residual > (max_residual * sigma_w) ** 2:
                continue
            length = np.sqrt(a * a + b * b + c * c)
            if length < 1e-6:
                continue
            cells[count, 0], cells[count, 1] = row, col
            normals[count, 0], normals[count, 1], normals[count, 2] = a / length, b / length, c / length
            distances[count] = 1.0 / length
            centroids[count, 0], centroids[count, 1], centroids[count, 2] = x * z, y * z, z
            # One cell counts as one measurement: neighbouring depth errors are far from independent.
            cells_in_window = n / CELL_PIXELS
            sigmas[count] = sigma_w / np.sqrt(cells_in_window * min(xx, yy)) / length
            count += 1
    return cells[:count], normals[:count], distances[:count], centroids[:count], sigmas[:count]
