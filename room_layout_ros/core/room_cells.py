"""What the fit of a room reads: cells of the image with their depth and the probability of each label."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import CELL_PX, DepthGeometry
from .frame import CameraIntrinsics
from .labels import N_FACES

INTERLEAVED_PARTS = 7
"""The cells lie in so many interleaved parts, each spread over the whole image."""


@dataclass(frozen=True, slots=True)
class RoomCells:
    """Cells of an image, flat, in an interleaved order: any first part of them is spread over the whole image.

    Attributes
    ----------
    rays : (n, 3) float64, K^-1 (x, y, 1) of their centres. inverse_depth : (n,) float64, 1/m, 0 not measured.
    probability : (n, 6) float64 of the labels; rows may sum to less than 1 (nothing known).
    behind : (n, 5) float64 of the face of the empty room, by the scene network; 0 where it was not asked.
    """

    rays: NDArray[np.float64]
    inverse_depth: NDArray[np.float64]
    probability: NDArray[np.float64]
    behind: NDArray[np.float64]


def room_cells(
    geometry: DepthGeometry,
    probability: NDArray[np.float64],
    superpixels: NDArray[np.int32],
    behind: NDArray[np.float64] | None = None,
) -> RoomCells:
    """Cells of the depth image with the probabilities of the superpixels under them.

    Parameters
    ----------
    probability : (K, 6) of the six labels. superpixels : (H, W) int32 index.
    behind : (rows, columns, 5) of the scene network's layout over the image, in any resolution, or None.
    """
    moments = geometry.moments
    rows, cols, _ = moments.shape
    count = moments[..., 0]
    w = np.where(count >= 0.3 * CELL_PX**2, moments[..., 3] / np.maximum(count, 1.0), 0.0)
    # Where pixels are missing, the mean inverse depth is that of the measured pixels' mean ray.
    mean_ray = moments[..., [1, 2, 0]] / np.maximum(count, 1.0)[..., None]
    rays = np.where((w > 0)[..., None], mean_ray, _centre_rays(geometry.camera, rows, cols))
    return _interleave(rays, w, _cell_means(superpixels, probability, rows, cols, CELL_PX), behind)


def image_cells(
    camera: CameraIntrinsics,
    probability: NDArray[np.float64],
    superpixels: NDArray[np.int32],
    behind: NDArray[np.float64] | None = None,
) -> RoomCells:
    """Cells of an image without depth; parameters as for `room_cells`."""
    rows, cols = camera.height // CELL_PX, camera.width // CELL_PX
    means = _cell_means(superpixels, probability, rows, cols, CELL_PX)
    return _interleave(_centre_rays(camera, rows, cols), np.zeros((rows, cols)), means, behind)


def _centre_rays(camera: CameraIntrinsics, rows: int, cols: int) -> NDArray[np.float64]:
    """(rows, cols, 3) rays of the cells' centres, z = 1."""
    x = (np.arange(cols) * CELL_PX + (CELL_PX - 1) / 2 - camera.cx) / camera.fx
    y = (np.arange(rows) * CELL_PX + (CELL_PX - 1) / 2 - camera.cy) / camera.fy
    return np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), -1)


def _interleave(
    rays: NDArray[np.float64],
    inverse_depth: NDArray[np.float64],
    probability: NDArray[np.float64],
    behind: NDArray[np.float64] | None,
) -> RoomCells:
    order = _interleaved(inverse_depth.size)
    if behind is None:
        faces = np.zeros((inverse_depth.size, N_FACES))
    else:
        rows, cols = inverse_depth.shape
        resized = cv2.resize(behind, (cols, rows), interpolation=cv2.INTER_LINEAR)
        faces = np.asarray(resized, np.float64).reshape(-1, N_FACES)
    return RoomCells(rays.reshape(-1, 3)[order], inverse_depth.ravel()[order], probability[order], faces[order])


@cache
def _interleaved(count: int) -> NDArray[np.intp]:
    return np.concatenate([np.arange(start, count, INTERLEAVED_PARTS) for start in (3, 0, 5, 1, 6, 2, 4)])


@njit(cache=True, nogil=True)
def _cell_means(index, values, rows, cols, size):  # type: ignore[no-untyped-def]
    """Mean over each cell's pixels (every second one) of the values of the superpixels they are in."""
    means = np.zeros((rows * cols, values.shape[1]))
    share = 1.0 / ((size + 1) // 2) ** 2
    for row in range(rows):
        for col in range(cols):
            cell = means[row * cols + col]
            for y in range(row * size, (row + 1) * size, 2):
                for x in range(col * size, (col + 1) * size, 2):
                    value = values[index[y, x]]
                    for k in range(values.shape[1]):
                        cell[k] += share * value[k]
    return means
