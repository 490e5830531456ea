"""Integral geometry: what lies in each face of every layout, by pair tables (docs/method.md, section 7).

In a quadrant (`ray_grid.py`) a pixel with ray (dx, dy, dz) belongs, for the layout pair (i, j), to
  front  where |dy| <= a_i dz and |dx| <= a_j dz,
  side   where |dx| >  a_j dz and t >= t(i, j),      t = |dx| / (|dx| + |dy|),  t(i, j) = a_j / (a_i + a_j),
  top    (ceiling or floor) else.
Two histograms hold that for every pair: *boxes* over (vertical bin, horizontal bin), read by prefix sums, and
*sectors* over (horizontal bin, angle bin), read by suffix sums with the bin that the corner falls into shared
linearly. The three parts always add up to the quadrant. A bin is the number of states that the pixel lies beyond.

Bins are found as in the paper's Alg. 2, moving on from the neighbour's; pixels of one *atom* (a region on which every
feature is constant: superpixel x orientation) that share a cell are counted once, so a further accumulator is one pass
over the counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .labels import CEILING, FLOOR, FRONT_WALL, LEFT_WALL, N_FACES, RIGHT_WALL
from .ray_grid import N_QUADRANTS, QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid

PairTables = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Costs of (y1, y3), (y1, y4), (y2, y3), (y2, y4); the cost of a layout is their sum."""

_FRONT = FRONT_WALL - 1
_TOP = np.array([CEILING - 1, CEILING - 1, FLOOR - 1, FLOOR - 1])
_SIDE = np.array([LEFT_WALL - 1, RIGHT_WALL - 1, LEFT_WALL - 1, RIGHT_WALL - 1])
_VERTICAL = np.array(QUADRANT_VERTICAL)
_HORIZONTAL = np.array(QUADRANT_HORIZONTAL)


@dataclass(frozen=True, slots=True)
class CellCounts:
    """Pixels per (atom, cell), counted once per frame and pose.

    Attributes
    ----------
    grid : RayGrid
    pixels : (A,) float64 pixels per atom.
    quadrant_pixels : (A, 4) float64 pixels per atom and quadrant.
    behind_pixels : (A, 4) float64 those of them with dz <= 0, which the front wall can never cover.
    boxes : (B, 3) int32 entries (atom, cell, pixels) of the box histograms.
    sectors : (S, 3) int32 entries of the sector histograms.
    """

    grid: RayGrid
    pixels: NDArray[np.float64]
    quadrant_pixels: NDArray[np.float64]
    behind_pixels: NDArray[np.float64]
    boxes: NDArray[np.int32]
    sectors: NDArray[np.int32]


def count_cells(grid: RayGrid, atoms: NDArray[np.int32], atom_count: int, pixel_step: int = 1) -> CellCounts:
    """Count pixels per (atom, cell).

    Parameters
    ----------
    grid : RayGrid
    atoms : (H, W) int32 array
        Atom of each pixel, 0 to `atom_count` - 1; a negative one leaves the pixel out.
    atom_count : int
    pixel_step : int
        1 takes every pixel; n takes one in n on a sheared lattice, so that every row and column has its share.
        Counts are of the pixels taken.

    Raises
    ------
    ValueError
        When the image does not fit the camera, or an atom is beyond `atom_count`.
    """
    camera = grid.camera
    if atoms.shape != (camera.height, camera.width) or atoms.dtype != np.int32:
        raise ValueError(f"atoms are {atoms.dtype} {atoms.shape}; int32 {(camera.height, camera.width)} is needed")
    if pixel_step < 1 or atom_count < 1:
        raise ValueError(f"pixel_step is {pixel_step} and atom_count {atom_count}; both must be 1 or more")
    if int(atoms.max()) >= atom_count:
        raise ValueError(f"an atom has number {int(atoms.max())}; below {atom_count} was announced")
    quadrants, behind, boxes, sectors = _count(
        np.ascontiguousarray(atoms), atom_count, pixel_step, lattice_shear(pixel_step), grid.ray_matrix,
        grid.states, grid.state_counts, grid.slopes, grid.bin_counts, *_offsets(grid),
    )  # fmt: skip
    return CellCounts(grid, quadrants.sum(axis=1), quadrants, behind, boxes, sectors)


@lru_cache(maxsize=64)
def lattice_shear(step: int) -> int:
    """Return c such that the pixels with (x + c y) mod step = 0 lie farthest from each other."""

    def nearest(c: int) -> int:
        return min(
            ((-c * dy + k * step) ** 2 + dy * dy) for dy in range(step) for k in range(-step, step + 1) if dy or k
        )

    return max(range(step), key=nearest)


def pair_tables(counts: CellCounts, face_cost: NDArray[np.float64]) -> PairTables:
    """Return the cost of every layout for costs per pixel of each atom in each face.

    Parameters
    ----------
    counts : CellCounts
    face_cost : (A, 5) float64 array
        Cost of one pixel of atom a in face k + 1; contract all channels and labels into it first.
    """
    if face_cost.shape != (len(counts.pixels), N_FACES):
        raise ValueError(f"face costs have shape {face_cost.shape}; {(len(counts.pixels), N_FACES)} is needed")
    grid = counts.grid
    cost = np.ascontiguousarray(face_cost, dtype=np.float64)
    boxes, sectors = _scatter(cost, _TOP, _SIDE, counts.boxes, counts.sectors, *_offsets(grid))
    of_top = cost[:, _TOP]
    total = (counts.quadrant_pixels * of_top).sum(axis=0)
    behind = (counts.behind_pixels * of_top).sum(axis=0)
    return read_tables(grid, boxes, sectors, total, behind)


def read_tables(
    grid: RayGrid,
    boxes: NDArray[np.float64],
    sectors: NDArray[np.float64],
    total: NDArray[np.float64],
    behind: NDArray[np.float64],
) -> PairTables:
    """Return `total + front part of boxes + side part of sectors` for every pair of each quadrant.

    Parameters
    ----------
    boxes, sectors : flat float64 histograms of the four quadrants (`histogram_sizes`).
    total, behind : (4,) float64, mass of each quadrant, and of its pixels that only the side and top faces can hold.
    """
    box_offset, sector_offset = _offsets(grid)
    tables = []
    for q in range(N_QUADRANTS):
        i, j, bins = histogram_shape(grid, q)
        table = _read(
            boxes[box_offset[q] : box_offset[q + 1]].reshape(i, j),
            sectors[sector_offset[q] : sector_offset[q + 1]].reshape(j, bins),
            grid.corner_bin[q], grid.corner_share[q], total[q], behind[q],
        )  # fmt: skip
        tables.append(table)
    return tables[0], tables[1], tables[2], tables[3]


def face_counts(counts: CellCounts, layout: tuple[int, int, int, int]) -> NDArray[np.float64]:
    """Return how many pixels of each atom lie in each face of one layout: (A, 5) float64.

    The pixels of the angle bin in which a corner falls are shared, so counts are not integers; they add up per atom.
    """
    grid = counts.grid
    return _face_counts(
        counts.quadrant_pixels, counts.behind_pixels, _TOP, _SIDE, _VERTICAL, _HORIZONTAL,
        counts.boxes, counts.sectors, *_offsets(grid), grid.state_counts, grid.bin_counts,
        *_corners_of(grid, layout), np.array(layout, dtype=np.int64),
    )  # fmt: skip


def accumulate(grid: RayGrid, feature: NDArray[np.float64]) -> tuple[PairTables, PairTables, PairTables]:
    """Return the mass of a per-pixel feature in the front, side and top part of every quadrant and pair (paper, Alg.
    2).

    The general form for any feature image, one pass over the pixels each; the joint model uses `pair_tables`, which
    gives the same numbers from the counts of atoms.

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
    boxes, sectors, total, behind = _accumulate(
        np.ascontiguousarray(feature, dtype=np.float64), grid.ray_matrix,
        grid.states, grid.state_counts, grid.slopes, grid.bin_counts, *_offsets(grid),
    )  # fmt: skip
    none = np.zeros(N_QUADRANTS)
    front = read_tables(grid, boxes, np.zeros_like(sectors), none, none)
    side = read_tables(grid, np.zeros_like(boxes), sectors, none, none)
    whole = read_tables(grid, -boxes, -sectors, total, behind)
    return front, side, whole


def keep_atoms(counts: CellCounts, keep: NDArray[np.bool_]) -> CellCounts:
    """Return the counts of some atoms only, numbered anew in their order; the others must have no pixels."""
    number = (np.cumsum(keep) - 1).astype(np.int32)
    boxes, sectors = counts.boxes.copy(), counts.sectors.copy()
    boxes[:, 0], sectors[:, 0] = number[boxes[:, 0]], number[sectors[:, 0]]
    return CellCounts(
        counts.grid, counts.pixels[keep], counts.quadrant_pixels[keep], counts.behind_pixels[keep], boxes, sectors
    )


def _corners_of(grid: RayGrid, layout: tuple[int, int, int, int]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(4,) angle bin and share of a layout's corner in each quadrant."""
    at = [(layout[QUADRANT_VERTICAL[q]], layout[QUADRANT_HORIZONTAL[q]]) for q in range(N_QUADRANTS)]
    bins = np.array([grid.corner_bin[q][corner] for q, corner in enumerate(at)], dtype=np.int64)
    return bins, np.array([grid.corner_share[q][corner] for q, corner in enumerate(at)])


def histogram_shape(grid: RayGrid, quadrant: int) -> tuple[int, int, int]:
    """Return (vertical bins, horizontal bins, angle bins) of a quadrant."""
    i = int(grid.state_counts[QUADRANT_VERTICAL[quadrant]])
    j = int(grid.state_counts[QUADRANT_HORIZONTAL[quadrant]])
    return i, j, int(grid.bin_counts[quadrant])


def _offsets(grid: RayGrid) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(5,) starts of the quadrants in the flat box and sector histograms."""
    boxes, sectors = np.zeros(N_QUADRANTS + 1, np.int64), np.zeros(N_QUADRANTS + 1, np.int64)
    for q in range(N_QUADRANTS):
        i, j, bins = histogram_shape(grid, q)
        boxes[q + 1] = boxes[q] + i * j
        sectors[q + 1] = sectors[q] + j * bins
    return boxes, sectors


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
def _sign_change(slope, offset, width):  # type: ignore[no-untyped-def]
    """First x where `slope x + offset >= 0` is not as at x = 0, evaluated as the pixels are; else width."""
    first = offset >= 0.0
    if (slope * (width - 1) + offset >= 0.0) == first:
        return width
    low, high = 0, width - 1
    while high - low > 1:
        middle = (low + high) // 2
        if (slope * middle + offset >= 0.0) == first:
            low = middle
        else:
            high = middle
    return high


@njit(cache=True, nogil=True, inline="always")
def _add(entries, n, last, cell, atom, run):  # type: ignore[no-untyped-def]
    """Add a run of pixels to the newest entry of its cell, or open one; return the number of entries."""
    entry = last[cell]
    if entry >= 0 and entries[entry, 0] == atom:
        entries[entry, 2] += run
        return n
    entries[n, 0], entries[n, 1], entries[n, 2] = atom, cell, run
    last[cell] = n
    return n + 1


@njit(cache=True, nogil=True)
def _count(atoms, atom_count, step, shear, m, states, counts, slopes, bins, box_offset, sector_offset):  # type: ignore[no-untyped-def]
    height, width = atoms.shape
    quadrant_pixels = np.zeros((atom_count, 4))
    behind_pixels = np.zeros((atom_count, 4))
    boxes = np.empty((height * width // step + height, 3), np.int32)  # untouched pages cost nothing
    sectors = np.empty_like(boxes)
    last_box = np.full(box_offset[4], -1, np.int32)
    last_sector = np.full(sector_offset[4], -1, np.int32)
    n_box, n_sector = 0, 0
    vertical_bin = np.zeros(2, np.int64)
    horizontal_bin = np.zeros(2, np.int64)
    angle_bin = np.zeros(4, np.int64)
    for y in range(height):
        bx, by, bz = m[0, 1] * y + m[0, 2], m[1, 1] * y + m[1, 2], m[2, 1] * y + m[2, 2]
        x = (-shear * y) % step
        cuts = (_sign_change(m[0, 0], bx, width), _sign_change(m[1, 0], by, width))
        for stop in (min(cuts), max(cuts), width):
            if x >= stop:
                continue
            right, low = int(m[0, 0] * x + bx >= 0.0), int(m[1, 0] * x + by >= 0.0)
            q = 2 * low + right
            across, n_across, i = states[low], counts[low], vertical_bin[low]
            along, n_along, j = states[2 + right], counts[2 + right], horizontal_bin[right]
            slope, n_bins, t = slopes[q], bins[q], angle_bin[q]
            box_atom, box_cell, box_run = -1, 0, 0
            sector_atom, sector_cell, sector_run = -1, 0, 0
            while x < stop:
                atom = atoms[y, x]
                horizontal, vertical = abs(m[0, 0] * x + bx), abs(m[1, 0] * x + by)
                dz = m[2, 0] * x + bz
                x += step
                if atom < 0:
                    continue
                j = _move_state(j, horizontal, dz, along, n_along)
                i = _move_state(i, vertical, dz, across, n_across)
                if dz > 0.0:
                    cell = box_offset[q] + i * n_along + j
                    if atom == box_atom and cell == box_cell:
                        box_run += 1
                    else:
                        if box_run > 0:
                            n_box = _add(boxes, n_box, last_box, box_cell, box_atom, box_run)
                            quadrant_pixels[box_atom, q] += box_run
                        box_atom, box_cell, box_run = atom, cell, 1
                else:
                    behind_pixels[atom, q] += 1
                    quadrant_pixels[atom, q] += 1
                if j > 0:
                    t = _move_angle(t, horizontal, vertical, slope, n_bins)
                    cell = sector_offset[q] + j * n_bins + t
                    if atom == sector_atom and cell == sector_cell:
                        sector_run += 1
                    else:
                        if sector_run > 0:
                            n_sector = _add(sectors, n_sector, last_sector, sector_cell, sector_atom, sector_run)
                        sector_atom, sector_cell, sector_run = atom, cell, 1
            if box_run > 0:
                n_box = _add(boxes, n_box, last_box, box_cell, box_atom, box_run)
                quadrant_pixels[box_atom, q] += box_run
            if sector_run > 0:
                n_sector = _add(sectors, n_sector, last_sector, sector_cell, sector_atom, sector_run)
            vertical_bin[low], horizontal_bin[right], angle_bin[q] = i, j, t
    return quadrant_pixels, behind_pixels, boxes[:n_box].copy(), sectors[:n_sector].copy()


@njit(cache=True, nogil=True)
def _accumulate(feature, m, states, counts, slopes, bins, box_offset, sector_offset):  # type: ignore[no-untyped-def]
    height, width = feature.shape
    boxes, sectors = np.zeros(box_offset[4]), np.zeros(sector_offset[4])
    total, behind = np.zeros(4), np.zeros(4)
    vertical_bin = np.zeros(2, np.int64)
    horizontal_bin = np.zeros(2, np.int64)
    angle_bin = np.zeros(4, np.int64)
    for y in range(height):
        bx, by, bz = m[0, 1] * y + m[0, 2], m[1, 1] * y + m[1, 2], m[2, 1] * y + m[2, 2]
        for x in range(width):
            dx, dy, dz = m[0, 0] * x + bx, m[1, 0] * x + by, m[2, 0] * x + bz
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
                behind[q] += value
            if j > 0:
                t = _move_angle(angle_bin[q], horizontal, vertical, slopes[q], bins[q])
                angle_bin[q] = t
                sectors[sector_offset[q] + j * bins[q] + t] += value
    return boxes, sectors, total, behind


@njit(cache=True, nogil=True)
def _scatter(cost, top, side, box_entries, sector_entries, box_offset, sector_offset):  # type: ignore[no-untyped-def]
    """Histograms of (front - top) costs over the boxes and (side - top) costs over the sectors."""
    boxes, sectors = np.zeros(box_offset[4]), np.zeros(sector_offset[4])
    over_top = np.empty((len(cost), 4))
    for a in range(len(cost)):
        over_top[a, 0], over_top[a, 1] = cost[a, 3] - cost[a, top[0]], cost[a, 3] - cost[a, top[2]]
    for e in range(len(box_entries)):
        cell = box_entries[e, 1]
        low = int(cell >= box_offset[2])
        boxes[cell] += box_entries[e, 2] * over_top[box_entries[e, 0], low]
    for a in range(len(cost)):
        for q in range(4):
            over_top[a, q] = cost[a, side[q]] - cost[a, top[q]]
    for e in range(len(sector_entries)):
        cell = sector_entries[e, 1]
        q = int(cell >= sector_offset[1]) + int(cell >= sector_offset[2]) + int(cell >= sector_offset[3])
        sectors[cell] += sector_entries[e, 2] * over_top[sector_entries[e, 0], q]
    return boxes, sectors


@njit(cache=True, nogil=True)
def _read(boxes, sectors, corner_bin, corner_share, total, behind):  # type: ignore[no-untyped-def]
    n_i, n_j = boxes.shape
    bins = sectors.shape[1]
    table = np.empty((n_i, n_j))
    column = np.zeros(n_j)
    for i in range(n_i):  # prefix sums: front holds the bins <= (i, j)
        row = 0.0
        for j in range(n_j):
            row += boxes[i, j]
            column[j] += row
            table[i, j] = total + column[j]
    beyond = np.zeros(bins)
    suffix = np.zeros(bins + 1)
    for j in range(n_j - 1, -1, -1):  # suffix sums: side holds the bins > j, from the corner's angle on
        mass = 0.0
        for t in range(bins - 1, -1, -1):
            mass += beyond[t]
            suffix[t] = mass
        for i in range(n_i):
            t = corner_bin[i, j]
            table[i, j] += suffix[t + 1] + corner_share[i, j] * beyond[t]
        for t in range(bins):
            beyond[t] += sectors[j, t]
    table[n_i - 1, n_j - 1] -= behind
    return table


@njit(cache=True, nogil=True)
def _face_counts(  # type: ignore[no-untyped-def]
    quadrant_pixels, behind_pixels, top, side, vertical, horizontal,
    box_entries, sector_entries, box_offset, sector_offset, counts, bins, corner_bin, corner_share, layout,
):  # fmt: skip
    result = np.zeros((len(quadrant_pixels), 5))
    for a in range(len(result)):
        for q in range(4):
            mass = quadrant_pixels[a, q]
            if layout[vertical[q]] == counts[vertical[q]] - 1 and layout[horizontal[q]] == counts[horizontal[q]] - 1:
                mass -= behind_pixels[a, q]
            result[a, top[q]] += mass
    front = np.zeros(box_offset[4], np.bool_)
    for q in range(4):
        for i in range(layout[vertical[q]] + 1):
            start = box_offset[q] + i * counts[horizontal[q]]
            front[start : start + layout[horizontal[q]] + 1] = True
    for e in range(len(box_entries)):
        cell = box_entries[e, 1]
        if front[cell]:
            result[box_entries[e, 0], 3] += box_entries[e, 2]
            result[box_entries[e, 0], int(cell >= box_offset[2])] -= box_entries[e, 2]
    share = np.zeros(sector_offset[4])
    for q in range(4):
        t = corner_bin[q]
        for j in range(layout[horizontal[q]] + 1, counts[horizontal[q]]):
            start = sector_offset[q] + j * bins[q]
            share[start + t] = corner_share[q]
            share[start + t + 1 : start + bins[q]] = 1.0
    for e in range(len(sector_entries)):
        cell = sector_entries[e, 1]
        part = share[cell] * sector_entries[e, 2]
        if part > 0.0:
            q = int(cell >= sector_offset[1]) + int(cell >= sector_offset[2]) + int(cell >= sector_offset[3])
            result[sector_entries[e, 0], side[q]] += part
            result[sector_entries[e, 0], top[q]] -= part
    return result
