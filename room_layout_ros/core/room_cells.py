"""What the fit of a room reads: cells of the image with their depth and the probability of each label."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import CELL_PIXELS, CELL_PX, LEAST_MEASURED, MOMENTS, DepthGeometry
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
    camera, moments = geometry.camera, geometry.moments
    rows, cols, _ = moments.shape
    rays, w = _rays(moments, *camera.numbers)
    return _interleave(rays, w, _cell_means(superpixels, probability, rows, cols, CELL_PX), behind, (rows, cols))


def image_cells(
    camera: CameraIntrinsics,
    probability: NDArray[np.float64],
    superpixels: NDArray[np.int32],
    behind: NDArray[np.float64] | None = None,
) -> RoomCells:
    """Cells of an image without depth; parameters as for `room_cells`."""
    rows, cols = camera.height // CELL_PX, camera.width // CELL_PX
    rays, w = _rays(np.zeros((rows, cols, MOMENTS)), *camera.numbers)
    return _interleave(rays, w, _cell_means(superpixels, probability, rows, cols, CELL_PX), behind, (rows, cols))


@njit(cache=True, nogil=True)
def _rays(moments, fx, fy, cx, cy):  # type: ignore[no-untyped-def]
    """(n, 3) rays of the cells and (n,) inverse depth, row by row.

    Where pixels are missing, the mean inverse depth is that of the measured pixels' mean ray; where too many are, 0 and
    that of the cell's centre.
    """
    rows, cols, _ = moments.shape
    rays, w = np.ones((rows * cols, 3)), np.zeros(rows * cols)
    middle = (CELL_PX - 1) / 2
    for row in range(rows):
        for col in range(cols):
            cell, at = moments[row, col], row * cols + col
            count = cell[0]
            if count >= LEAST_MEASURED * CELL_PIXELS and cell[3] > 0.0:
                w[at], rays[at, 0], rays[at, 1] = cell[3] / count, cell[1] / count, cell[2] / count
            else:
                rays[at, 0], rays[at, 1] = (col * CELL_PX + middle - cx) / fx, (row * CELL_PX + middle - cy) / fy
    return rays, w


def _interleave(
    rays: NDArray[np.float64],
    inverse_depth: NDArray[np.float64],
    probability: NDArray[np.float64],
    behind: NDArray[np.float64] | None,
    shape: tuple[int, int],
) -> RoomCells:
    order = _interleaved(inverse_depth.size)
    if behind is None:
        faces = np.zeros((inverse_depth.size, N_FACES))
    else:
        rows, cols = shape
        resized = (
            behind if behind.shape[:2] == shape else cv2.resize(behind, (cols, rows), interpolation=cv2.INTER_LINEAR)
        )
        faces = np.asarray(resized, np.float64).reshape(-1, N_FACES)
    return RoomCells(*_take(order, rays, inverse_depth, probability, faces))


@cache
def _interleaved(count: int) -> NDArray[np.intp]:
    return np.concatenate([np.arange(start, count, INTERLEAVED_PARTS) for start in (3, 0, 5, 1, 6, 2, 4)])


@njit(cache=True, nogil=True)
def _take(order, rays, inverse_depth, probability, faces):  # type: ignore[no-untyped-def]
    """The rows of each array in that order."""
    return rays[order], inverse_depth[order], probability[order], faces[order]


@njit(cache=True, nogil=True)
def _cell_means(index, values, rows, cols, size):  # type: ignore[no-untyped-def]
    """Mean over each cell's pixels (every second one) of the values of the superpixels they are in."""
    means = np.zeros((rows * cols, values.shape[1]))
    share = 1.0 / ((size + 1) // 2) ** 2
    here, met = np.zeros(len(values), np.int64), np.empty(len(values) + 1, np.int64)  # pixels of each, who has any
    for row in range(rows):
        for col in range(cols):
            cell, kinds = means[row * cols + col], 0
            for y in range(row * size, (row + 1) * size, 2):
                for x in range(col * size, (col + 1) * size, 2):
                    one = np.uint32(index[y, x])
                    met[kinds] = one
                    kinds += here[one] == 0
                    here[one] += 1
            for one in met[:kinds]:  # few superpixels meet in a cell: their values are added once each
                for k in range(values.shape[1]):
                    cell[k] += share * here[one] * values[one, k]
                here[one] = 0
    return means
