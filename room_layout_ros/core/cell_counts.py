"""Pixels per (atom, cell of a ray grid), counted once per frame and pose (docs/method.md, section 7).

An *atom* is a region on which every feature is constant: superpixel x orientation. Pixels of one atom that share a cell
are counted once, so whatever is asked of the layouts later is one pass over the counts.

The bin of a pixel is the number of states (or angle edges) that it lies beyond. A table over h / (h + v) gives a bin
that is never too far, usually the right one or the one before; the last steps compare products, so that it is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .ray_grid import QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid

_FINE = 1024
_SAFETY = 1e-9
_NONE = np.uint64(2**64 - 1)
_ENTRY = np.uint64(2**32 - 1)


@dataclass(frozen=True, slots=True)
class CellCounts:
    """Pixels per (atom, cell), counted once per frame and pose.

    Attributes
    ----------
    grid : RayGrid
    pixels : (A,) float64 pixels per atom.
    quadrant_pixels : (A, 4) float64 pixels per atom and quadrant.
    boxes : (B, 3) uint32 entries (atom, cell, pixels) of the box histograms, of pixels with dz > 0.
    hidden : (D, 3) uint32 entries likewise, of the others: the front wall can never cover them, and in a layout that
        has their cell among its boxes no other face does, for those that could are absent (`hidden_cell`).
    sectors : (S, 3) uint32 entries of the sector histograms.
    """

    grid: RayGrid
    pixels: NDArray[np.float64]
    quadrant_pixels: NDArray[np.float64]
    boxes: NDArray[np.uint32]
    hidden: NDArray[np.uint32]
    sectors: NDArray[np.uint32]


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
    if atom_count < 1:
        raise ValueError(f"atom_count is {atom_count}; it must be 1 or more")
    return count_samples(grid, sample_lattice(atoms, pixel_step), np.ones(atom_count, bool), pixel_step)


def count_samples(grid: RayGrid, samples: NDArray[np.int32], held: NDArray[np.bool_], pixel_step: int) -> CellCounts:
    """Count pixels per (atom, cell), given the atoms of the lattice's pixels (`sample_lattice`).

    Parameters
    ----------
    held : (n,) bool
        Atoms that are counted, numbered anew in their order; the others must have no pixels.

    Raises
    ------
    ValueError
        When an atom is beyond n.
    """
    if int(samples.max()) >= len(held):
        raise ValueError(f"an atom has number {int(samples.max())}; below {len(held)} was announced")
    number = (np.cumsum(held) - 1).astype(np.int32)
    pixels, quadrants, boxes, hidden, sectors = _count(
        samples, number, pixel_step, lattice_shear(pixel_step), grid.ray_matrix,
        grid.states, grid.state_counts, grid.slopes, grid.bin_counts,
    )  # fmt: skip
    return CellCounts(grid, pixels, quadrants, boxes, hidden, sectors)


def sample_lattice(image: NDArray[np.int32] | NDArray[np.uint8], step: int) -> NDArray[np.int32]:
    """(H, n) int32: the pixels x = x0(y), x0 + step, ... of each row of a sheared lattice; -1 beyond the image.

    Raises
    ------
    ValueError
        When the step is below 1.
    """
    if step < 1:
        raise ValueError(f"pixel_step is {step}; it must be 1 or more")
    return _sample(np.ascontiguousarray(image), step, lattice_shear(step))


@lru_cache(maxsize=64)
def lattice_shear(step: int) -> int:
    """Return c such that the pixels with (x + c y) mod step = 0 lie farthest from each other."""

    def nearest(c: int) -> int:
        return min(
            ((-c * dy + k * step) ** 2 + dy * dy) for dy in range(step) for k in range(-step, step + 1) if dy or k
        )

    return max(range(step), key=nearest)


@njit(cache=True, nogil=True)
def histogram_offsets(counts, bins):  # type: ignore[no-untyped-def]
    """(5,) starts of the quadrants in the flat box histograms (vertical bin, horizontal bin) and sector histograms
    (horizontal bin, angle bin), for the states per side and the angle bins per quadrant.
    """
    boxes, sectors = np.zeros(5, np.int64), np.zeros(5, np.int64)
    for q in range(4):
        columns = counts[QUADRANT_HORIZONTAL[q]]
        boxes[q + 1] = boxes[q] + counts[QUADRANT_VERTICAL[q]] * columns
        sectors[q + 1] = sectors[q] + columns * bins[q]
    return boxes, sectors


@njit(cache=True, nogil=True, inline="always")
def hidden_cell(start, rows, columns, by_level, by_side):  # type: ignore[no-untyped-def]
    """Cell of a quadrant's box histogram, which starts at `start`, of a pixel with dz <= 0.

    Every finite state is exceeded by what is not 0, none by what is: dz counts as 0. In the layouts that have the cell
    among their boxes nothing is hit: both faces that could be (`by_level`, `by_side`) are absent.
    """
    return start + (rows - 1) * by_level * columns + (columns - 1) * by_side


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(image, step, shear):  # type: ignore[no-untyped-def]
    height, width = image.shape
    samples = np.full((height, (width + step - 1) // step), -1, np.int32)
    for y in range(height):
        first = (-shear * y) % step
        for k in range((width - first + step - 1) // step):
            samples[y, k] = image[y, first + k * step]
    return samples


@njit(cache=True, nogil=True, error_model="numpy")
def _first_bins(limits, count, table):  # type: ignore[no-untyped-def]
    """For each cell of h / (h + v), how many of the ascending `limits` of h / v are surely below everything in it."""
    b = 0
    for cell in range(_FINE + 1):
        while b < count and limits[b] / (1.0 + limits[b]) <= cell / _FINE - _SAFETY:
            b += 1
        table[cell] = b
    table[_FINE] = count


@njit(cache=True, nogil=True, error_model="numpy")
def _tables(states, counts, slopes, bins):  # type: ignore[no-untyped-def]
    """First guesses of the bins of the four sides and of the four quadrants' angles."""
    state_table = np.empty((4, _FINE + 1), np.uint16)
    angle_table = np.empty((4, _FINE + 1), np.uint16)
    for s in range(4):
        _first_bins(states[s], counts[s] - 1, state_table[s])
        _first_bins(slopes[s, 1:], bins[s] - 1, angle_table[s])
    return state_table, angle_table


@njit(cache=True, nogil=True, error_model="numpy")
def _place_row(m, y, first, step, rays, at, quadrant):  # type: ignore[no-untyped-def]
    """|dx|, |dy|, max(dz, 0) of a row's pixels, their places in the three tables and their quadrants."""
    bx, by, bz = m[0, 1] * y + m[0, 2], m[1, 1] * y + m[1, 2], m[2, 1] * y + m[2, 2]
    for k in range(rays.shape[1]):
        x = float(first + k * step)
        dx, dy, dz = m[0, 0] * x + bx, m[1, 0] * x + by, max(m[2, 0] * x + bz, 0.0)
        horizontal, vertical = abs(dx), abs(dy)
        rays[0, k], rays[1, k], rays[2, k] = horizontal, vertical, dz
        at[0, k] = np.uint16(_FINE * (horizontal / (horizontal + dz + 1e-300)))
        at[1, k] = np.uint16(_FINE * (vertical / (vertical + dz + 1e-300)))
        at[2, k] = np.uint16(_FINE * (horizontal / (horizontal + vertical + 1e-300)))
        quadrant[k] = np.uint8(2 * int(dy >= 0.0) + int(dx >= 0.0))


@njit(cache=True, nogil=True, inline="always")
def _beyond(table, place, limits, length, unit, bins):  # type: ignore[no-untyped-def]
    """Bins: how many ascending limits have length > limit * unit. One past the table's is tried without a branch."""
    for k in range(len(place)):
        b = np.uint32(table[place[k]])
        b += np.uint32(length[k] > limits[b] * unit[k])
        while length[k] > limits[b] * unit[k]:  # ends at the last, +inf
            b += np.uint32(1)
        bins[k] = b


@njit(cache=True, nogil=True, inline="always")
def _reached(table, place, limits, length, unit, bins):  # type: ignore[no-untyped-def]
    """`_beyond` with length >= limit * unit."""
    for k in range(len(place)):
        b = np.uint32(table[place[k]])
        b += np.uint32(length[k] >= limits[b] * unit[k])
        while length[k] >= limits[b] * unit[k]:
            b += np.uint32(1)
        bins[k] = b


@njit(cache=True, nogil=True, inline="always")
def _add(entries, n, newest, cell, atom):  # type: ignore[no-untyped-def]
    """Add a pixel to the newest entry of its cell if that is the atom's, else open one; return the number of entries.

    `newest` holds atom << 32 | entry. Neither case is a branch: which it is, no processor can guess.
    """
    last = newest[cell]
    same = np.uint64(last >> np.uint64(32) == atom)
    entry = (last & _ENTRY) * same + n * (np.uint64(1) - same)
    times = entries[entry, 2] * np.uint32(same) + np.uint32(1)
    entries[entry, 0], entries[entry, 1], entries[entry, 2] = atom, cell, times
    newest[cell] = np.uint64(atom) << np.uint64(32) | entry
    return n + np.uint64(1) - same


@njit(cache=True, nogil=True)
def _angle_limits(slopes, bins):  # type: ignore[no-untyped-def]
    """(4, m + 1) upper slopes of the angle bins, +inf from the last on."""
    limits = np.full((4, slopes.shape[1] + 1), np.inf)
    for q in range(4):
        limits[q, : bins[q] - 1] = slopes[q, 1 : bins[q]]
    return limits


@njit(cache=True, nogil=True)
def _place_hidden(hidden, box_offset, counts):  # type: ignore[no-untyped-def]
    """Replace the kinds of the entries of pixels with dz <= 0, 4 quadrant + 2 (dy other than 0) + (dx), by cells."""
    for e in range(len(hidden)):
        kind = int(hidden[e, 1])
        q, by_level, by_side = kind >> 2, kind >> 1 & 1, kind & 1
        hidden[e, 1] = hidden_cell(box_offset[q], counts[q >> 1], counts[2 + (q & 1)], by_level, by_side)


@njit(cache=True, nogil=True)
def _count_quadrants(boxes, hidden, atoms, box_offset):  # type: ignore[no-untyped-def]
    """(A,) pixels per atom and (A, 4) per quadrant, of the entries and those behind the camera."""
    quadrants, pixels = np.zeros((atoms, 4)), np.zeros(atoms)
    for entries in (boxes, hidden):
        for e in range(len(entries)):
            cell = entries[e, 1]
            q = int(cell >= box_offset[1]) + int(cell >= box_offset[2]) + int(cell >= box_offset[3])
            quadrants[entries[e, 0], q] += entries[e, 2]
    for a in range(atoms):
        pixels[a] = quadrants[a, 0] + quadrants[a, 1] + quadrants[a, 2] + quadrants[a, 3]
    return pixels, quadrants


@njit(cache=True, nogil=True, error_model="numpy")
def _count(samples, number, step, shear, m, states, counts, slopes, bins):  # type: ignore[no-untyped-def]
    height, n = samples.shape
    box_offset, sector_offset = histogram_offsets(counts, bins)
    boxes = np.empty((height * n + 1, 3), np.uint32)  # untouched pages cost nothing
    hidden = np.empty((height * n + 1, 3), np.uint32)
    sectors = np.empty((height * n + 1, 3), np.uint32)
    newest_box, newest_sector = np.full(box_offset[4], _NONE), np.full(sector_offset[4], _NONE)
    newest_hidden = np.full(16, _NONE)
    state_table, angle_table = _tables(states, counts, slopes, bins)
    angle_limits = _angle_limits(slopes, bins)
    rays, at, quadrant = np.empty((3, n)), np.empty((3, n), np.uint16), np.empty(n, np.uint8)
    column, row, angle = np.empty(n, np.uint32), np.empty(n, np.uint32), np.empty(n, np.uint32)
    n_box, n_hidden, n_sector = np.uint64(0), np.uint64(0), np.uint64(0)
    for y in range(height):
        _place_row(m, y, (-shear * y) % step, step, rays, at, quadrant)
        last = 0
        while last < n:
            first, q = last, int(quadrant[last])
            while last < n and quadrant[last] == q:
                last += 1
            side, level = 2 + (q & 1), q >> 1
            horizontal, vertical, dz = rays[0, first:last], rays[1, first:last], rays[2, first:last]
            _beyond(state_table[side], at[0, first:last], states[side], horizontal, dz, column)
            _beyond(state_table[level], at[1, first:last], states[level], vertical, dz, row)
            _reached(angle_table[q], at[2, first:last], angle_limits[q], horizontal, vertical, angle)
            columns, angles = np.uint32(counts[side]), np.uint32(bins[q])
            box, sector = np.uint32(box_offset[q]), np.uint32(sector_offset[q])
            for k in range(last - first):
                sample = samples[y, first + k]
                if sample < 0:
                    continue
                atom = np.uint32(number[sample])
                if dz[k] > 0.0:
                    cell = np.uint32(box + row[k] * columns + column[k])
                    n_box = _add(boxes, n_box, newest_box, cell, atom)
                else:
                    kind = np.uint32(4 * q + 2 * int(vertical[k] > 0.0) + int(horizontal[k] > 0.0))
                    n_hidden = _add(hidden, n_hidden, newest_hidden, kind, atom)
                if column[k] > 0:
                    cell = np.uint32(sector + column[k] * angles + angle[k])
                    n_sector = _add(sectors, n_sector, newest_sector, cell, atom)
    hidden = hidden[:n_hidden]
    _place_hidden(hidden, box_offset, counts)
    pixels, quadrants = _count_quadrants(boxes[:n_box], hidden, number[-1] + 1, box_offset)
    return pixels, quadrants, boxes[:n_box], hidden, sectors[:n_sector]
