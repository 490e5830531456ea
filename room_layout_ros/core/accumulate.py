"""The paper's Alg. 2: the mass of any per-pixel feature in each face of every layout (docs/method.md, section 7).

The general form, one pass over the pixels for each feature, bins moved on from the neighbour's. It is here as the
paper's own algorithm, which `python -m benchmarks accumulators` measures ours against; the estimate does not use it.
The joint model has `integral_geometry.pair_tables`, which gives the same numbers from the counts of atoms.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .cell_counts import hidden_cell, histogram_offsets
from .integral_geometry import PairTables, read_tables
from .ray_grid import N_QUADRANTS, RayGrid


def accumulate(grid: RayGrid, feature: NDArray[np.float64]) -> tuple[PairTables, PairTables, PairTables]:
    """Return the mass of a per-pixel feature in the front, side and top part of every quadrant and pair (paper, Alg.
    2).

    Parameters
    ----------
    grid : RayGrid
    feature : (H, W) float64 array

    Returns
    -------
    front, side, top : four tables each; side is left or right, top is ceiling or floor by quadrant.
    """
    if feature.shape != (grid.camera.height, grid.camera.width):
        raise ValueError(
            f"feature has shape {feature.shape}; the camera says {(grid.camera.height, grid.camera.width)}"
        )
    boxes, hidden, sectors, total = _accumulate(
        np.ascontiguousarray(feature, dtype=np.float64), grid.ray_matrix,
        grid.states, grid.state_counts, grid.slopes, grid.bin_counts,
    )  # fmt: skip
    none = np.zeros(N_QUADRANTS)
    front = read_tables(grid, boxes, np.zeros_like(sectors), none)
    side = read_tables(grid, np.zeros_like(boxes), sectors, none)
    whole = read_tables(grid, -boxes - hidden, -sectors, total)
    return front, side, whole


@njit(cache=True, nogil=True, inline="always")
def _move_state(bin_, magnitude, dz, states, count):  # type: ignore[no-untyped-def]
    """Move a bin on until it is the number of finite states that the pixel lies beyond (Alg. 2, lines 3 to 5)."""
    while bin_ < count - 1 and magnitude > states[bin_] * dz:
        bin_ += 1
    while bin_ > 0 and not magnitude > states[bin_ - 1] * dz:
        bin_ -= 1
    return bin_


@njit(cache=True, nogil=True, inline="always")
def _move_angle(bin_, horizontal, vertical, slopes, count):  # type: ignore[no-untyped-def]
    while bin_ < count - 1 and horizontal >= slopes[bin_ + 1] * vertical:
        bin_ += 1
    while bin_ > 0 and not horizontal >= slopes[bin_] * vertical:
        bin_ -= 1
    return bin_


@njit(cache=True, nogil=True)
def _accumulate(feature, m, states, counts, slopes, bins):  # type: ignore[no-untyped-def]
    box_offset, sector_offset = histogram_offsets(counts, bins)
    height, width = feature.shape
    boxes, hidden, sectors = np.zeros(box_offset[4]), np.zeros(box_offset[4]), np.zeros(sector_offset[4])
    total = np.zeros(4)
    vertical_bin = np.zeros(2, np.int64)
    horizontal_bin = np.zeros(2, np.int64)
    angle_bin = np.zeros(4, np.int64)
    for y in range(height):
        bx, by, bz = m[0, 1] * y + m[0, 2], m[1, 1] * y + m[1, 2], m[2, 1] * y + m[2, 2]
        for x in range(width):
            dx, dy, dz = m[0, 0] * x + bx, m[1, 0] * x + by, max(m[2, 0] * x + bz, 0.0)
            right, low = int(dx >= 0), int(dy >= 0)
            horizontal, vertical = abs(dx), abs(dy)
            q = 2 * low + right
            value = feature[y, x]
            total[q] += value
            j = _move_state(horizontal_bin[right], horizontal, dz, states[2 + right], counts[2 + right])
            horizontal_bin[right] = j
            i = _move_state(vertical_bin[low], vertical, dz, states[low], counts[low])
            vertical_bin[low] = i
            if dz > 0:
                boxes[box_offset[q] + i * counts[2 + right] + j] += value
            else:
                rows, columns = counts[low], counts[2 + right]
                hidden[hidden_cell(box_offset[q], rows, columns, int(vertical > 0), int(horizontal > 0))] += value
            if j > 0:
                t = _move_angle(angle_bin[q], horizontal, vertical, slopes[q], bins[q])
                angle_bin[q] = t
                sectors[sector_offset[q] + j * bins[q] + t] += value
    return boxes, hidden, sectors, total
