"""Integral geometry: what lies in each face of every layout, by pair tables (docs/method.md, section 7).

In a quadrant (`ray_grid.py`) a pixel with ray (dx, dy, dz) belongs, for the layout pair (i, j), to
  front  where |dy| <= a_i dz and |dx| <= a_j dz,
  side   where |dx| >  a_j dz and t >= t(i, j),      t = |dx| / (|dx| + |dy|),  t(i, j) = a_j / (a_i + a_j),
  top    (ceiling or floor) else.
Two histograms hold that for every pair: *boxes* over (vertical bin, horizontal bin), read by prefix sums, and
*sectors* over (horizontal bin, angle bin), read by suffix sums with the bin that the corner falls into shared
linearly. The three parts always add up to the quadrant. A bin is the number of states that the pixel lies beyond.
A pixel with dz <= 0 hits nothing where the faces are absent that it could hit; it is then in none of the parts.

The histograms are filled from the counts of `cell_counts.py`, so a further accumulator is one pass over the counts.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .cell_counts import CellCounts, histogram_offsets
from .labels import CEILING_FACE, FLOOR_FACE, FRONT_FACE, LEFT_FACE, N_FACES, RIGHT_FACE
from .ray_grid import QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid

PairTables = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Costs of (y1, y3), (y1, y4), (y2, y3), (y2, y4); the cost of a layout is their sum."""

_TOP = np.array([CEILING_FACE, CEILING_FACE, FLOOR_FACE, FLOOR_FACE])
_SIDE = np.array([LEFT_FACE, RIGHT_FACE, LEFT_FACE, RIGHT_FACE])
_VERTICAL = np.array(QUADRANT_VERTICAL)
_HORIZONTAL = np.array(QUADRANT_HORIZONTAL)
_LANES = 4
"""Rows summed at a time: a running sum waits for its last addition, four of them wait together."""


def pair_tables(
    counts: CellCounts, face_cost: NDArray[np.float64], faceless_cost: NDArray[np.float64] | None = None
) -> PairTables:
    """Return the cost of every layout for costs per pixel of each atom in each face.

    Parameters
    ----------
    counts : CellCounts
    face_cost : (A, 5) float64 array
        Cost of one pixel of atom a in face k + 1; contract all channels and labels into it first.
    faceless_cost : (A,) float64 array, optional
        Cost of one that hits no face (0): behind the front plane, and the other faces in its way are absent.
    """
    if face_cost.shape != (len(counts.pixels), N_FACES):
        raise ValueError(f"face costs have shape {face_cost.shape}; {(len(counts.pixels), N_FACES)} is needed")
    grid = counts.grid
    cost = np.ascontiguousarray(face_cost, dtype=np.float64)
    boxes, sectors, total = _scatter(
        cost,
        np.zeros(len(cost)) if faceless_cost is None else faceless_cost,
        counts.quadrant_pixels,
        counts.boxes,
        counts.hidden,
        counts.sectors,
        grid.state_counts,
        grid.bin_counts,
    )
    return _read_all(grid, boxes, sectors, total)


def read_tables(
    grid: RayGrid,
    boxes: NDArray[np.float64],
    sectors: NDArray[np.float64],
    total: NDArray[np.float64],
) -> PairTables:
    """Return `total + front part of boxes + side part of sectors` for every pair of each quadrant.

    Parameters
    ----------
    boxes, sectors : flat float64 histograms of the four quadrants (`cell_counts.histogram_offsets`).
    total : (4,) float64, mass of each quadrant.
    """
    return _read_all(grid, boxes.copy(), sectors.copy(), total)


def _read_all(
    grid: RayGrid,
    boxes: NDArray[np.float64],
    sectors: NDArray[np.float64],
    total: NDArray[np.float64],
) -> PairTables:
    """Turn the histograms, in place, into tables."""
    _read(boxes, sectors, grid.corner_bin, grid.corner_share, total, grid.state_counts, grid.bin_counts)
    tables, start = [], 0
    for shares in grid.corner_share:
        tables.append(boxes[start : start + shares.size].reshape(shares.shape))
        start += shares.size
    return tables[0], tables[1], tables[2], tables[3]


def face_counts(counts: CellCounts, layout: tuple[int, int, int, int]) -> NDArray[np.float64]:
    """Return how many pixels of each atom lie in each face of one layout: (A, 5) float64.

    The pixels of the angle bin in which a corner falls are shared, so counts are not integers; they add up per atom.
    """
    grid = counts.grid
    return np.asarray(
        _face_counts(
            counts.quadrant_pixels, counts.boxes, counts.hidden, counts.sectors,
            grid.state_counts, grid.bin_counts, grid.corner_bin, grid.corner_share, layout,
        )
    )  # fmt: skip


@njit(cache=True, nogil=True, inline="always")
def _quadrant(cell, offset):  # type: ignore[no-untyped-def]
    return np.uint32(cell >= offset[1]) + np.uint32(cell >= offset[2]) + np.uint32(cell >= offset[3])


@njit(cache=True, nogil=True)
def _scatter(cost, faceless, quadrant_pixels, box_entries, hidden_entries, sector_entries, counts, bins):  # type: ignore[no-untyped-def]
    """Histograms of (front - top) costs over the boxes, of pixels with dz <= 0 (faceless - top), and of (side - top)
    costs over the sectors, and what all pixels of a quadrant cost as top.
    """
    box_offset, sector_offset = histogram_offsets(counts, bins)
    boxes, sectors = np.zeros(box_offset[4]), np.zeros(sector_offset[4])
    total = np.zeros(4)
    front_over, side_over = np.empty((len(cost), 4)), np.empty((len(cost), 4))
    for a in range(len(cost)):
        for q in range(4):
            of_top = cost[a, _TOP[q]]
            front_over[a, q], side_over[a, q] = cost[a, FRONT_FACE] - of_top, cost[a, _SIDE[q]] - of_top
            total[q] += quadrant_pixels[a, q] * of_top
    for e in range(len(box_entries)):
        cell = box_entries[e, 1]
        boxes[cell] += box_entries[e, 2] * front_over[box_entries[e, 0], _quadrant(cell, box_offset)]
    for e in range(len(hidden_entries)):
        a, cell = hidden_entries[e, 0], hidden_entries[e, 1]
        boxes[cell] += hidden_entries[e, 2] * (faceless[a] - cost[a, _TOP[_quadrant(cell, box_offset)]])
    for e in range(len(sector_entries)):
        cell = sector_entries[e, 1]
        sectors[cell] += sector_entries[e, 2] * side_over[sector_entries[e, 0], _quadrant(cell, sector_offset)]
    return boxes, sectors, total


@njit(cache=True, nogil=True)
def _running_sums(table):  # type: ignore[no-untyped-def]
    """Sum along the rows, in place, from their first to their last."""
    rows, columns = table.shape
    whole = rows - rows % _LANES
    for r in range(0, whole, _LANES):
        a = b = c = d = 0.0
        for k in range(columns):
            a += table[r, k]
            b += table[r + 1, k]
            c += table[r + 2, k]
            d += table[r + 3, k]
            table[r, k], table[r + 1, k], table[r + 2, k], table[r + 3, k] = a, b, c, d
    for r in range(whole, rows):
        for k in range(1, columns):
            table[r, k] += table[r, k - 1]


@njit(cache=True, nogil=True)
def _read_quadrant(table, sectors, corner_bin, corner_share, total):  # type: ignore[no-untyped-def]
    """Turn a box histogram into the table, and a sector histogram into its suffix sums, both in place."""
    rows, columns = table.shape
    last = sectors.shape[1] - 1
    for i in range(1, rows):  # prefix sums: front holds the bins <= (i, j)
        for j in range(columns):
            table[i, j] += table[i - 1, j]
    _running_sums(table)
    for j in range(columns - 2, 0, -1):  # suffix sums: side holds the bins > j, from the corner's angle on
        for t in range(last + 1):
            sectors[j, t] += sectors[j + 1, t]
    _running_sums(sectors[:, ::-1])
    for i in range(rows):
        for j in range(columns):
            value = total + table[i, j]
            if j + 1 < columns:
                t = corner_bin[i, j]
                after = sectors[j + 1, t + 1] if t < last else 0.0
                value += after + corner_share[i, j] * (sectors[j + 1, t] - after)
            table[i, j] = value


@njit(cache=True, nogil=True)
def _read(boxes, sectors, corner_bin, corner_share, total, counts, bins):  # type: ignore[no-untyped-def]
    box_offset, sector_offset = histogram_offsets(counts, bins)
    for q in range(4):
        rows, columns = counts[_VERTICAL[q]], counts[_HORIZONTAL[q]]
        _read_quadrant(
            boxes[box_offset[q] : box_offset[q + 1]].reshape((rows, columns)),
            sectors[sector_offset[q] : sector_offset[q + 1]].reshape((columns, bins[q])),
            corner_bin[q], corner_share[q], total[q],
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _parts(box_offset, sector_offset, counts, bins, corner_bin, corner_share, layout):  # type: ignore[no-untyped-def]
    """What share of each box is front, and of each sector side, in one layout."""
    front, side = np.zeros(box_offset[4]), np.zeros(sector_offset[4])
    for q in range(4):
        i, j, columns = layout[_VERTICAL[q]], layout[_HORIZONTAL[q]], counts[_HORIZONTAL[q]]
        corner, share = corner_bin[q][i, j], corner_share[q][i, j]
        for row in range(i + 1):
            start = box_offset[q] + row * columns
            front[start : start + j + 1] = 1.0
        for column in range(j + 1, columns):
            start = sector_offset[q] + column * bins[q]
            side[start + corner] = share
            side[start + corner + 1 : start + bins[q]] = 1.0
    return front, side


@njit(cache=True, nogil=True)
def _add_shares(entries, share, offset, result):  # type: ignore[no-untyped-def]
    """Add the share of its pixels that each entry has, per atom and quadrant."""
    for e in range(len(entries)):
        cell = entries[e, 1]
        if share[cell] > 0.0:
            result[entries[e, 0], _quadrant(cell, offset)] += share[cell] * entries[e, 2]


@njit(cache=True, nogil=True)
def _face_counts(  # type: ignore[no-untyped-def]
    quadrant_pixels, box_entries, hidden_entries, sector_entries, counts, bins, corner_bin, corner_share, layout,
):  # fmt: skip
    box_offset, sector_offset = histogram_offsets(counts, bins)
    front_share, side_share = _parts(box_offset, sector_offset, counts, bins, corner_bin, corner_share, layout)
    front, side = np.zeros_like(quadrant_pixels), np.zeros_like(quadrant_pixels)
    nothing = np.zeros_like(quadrant_pixels)
    _add_shares(box_entries, front_share, box_offset, front)
    _add_shares(hidden_entries, front_share, box_offset, nothing)
    _add_shares(sector_entries, side_share, sector_offset, side)
    result = np.zeros((len(quadrant_pixels), 5))
    for q in range(4):
        for a in range(len(result)):
            result[a, FRONT_FACE] += front[a, q]
            result[a, _SIDE[q]] += side[a, q]
            result[a, _TOP[q]] += quadrant_pixels[a, q] - nothing[a, q] - front[a, q] - side[a, q]
    return result
