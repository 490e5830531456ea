"""Pixels per (atom, cell of a ray grid), counted once per frame and pose (docs/method.md, section 7).

An *atom* is a region on which every feature is constant: superpixel x orientation. Pixels of one atom that share a cell
are counted once, so whatever is asked of the layouts later is one pass over the counts.

The bin of a pixel is the number of states (or angle edges) that it lies beyond. A table over h / (h + v) gives a bin
that is never too far, usually the right one; the last steps compare products, so that the bin is exact.
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
    return count_samples(grid, sample_lattice(atoms, pixel_step), atom_count, pixel_step)


def count_samples(grid: RayGrid, samples: NDArray[np.int32], atom_count: int, pixel_step: int) -> CellCounts:
    """Count pixels per (atom, cell), given the atoms of the lattice's pixels (`sample_lattice`).

    Raises
    ------
    ValueError
        When an atom is beyond `atom_count`.
    """
    if atom_count < 1:
        raise ValueError(f"atom_count is {atom_count}; it must be 1 or more")
    if int(samples.max()) >= atom_count:
        raise ValueError(f"an atom has number {int(samples.max())}; below {atom_count} was announced")
    quadrants, behind, boxes, sectors = _count(
        samples, atom_count, pixel_step, lattice_shear(pixel_step), grid.ray_matrix,
        grid.states, grid.state_counts, grid.slopes, grid.bin_counts,
    )  # fmt: skip
    return CellCounts(grid, quadrants.sum(axis=1), quadrants, behind, boxes, sectors)


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


def keep_atoms(counts: CellCounts, keep: NDArray[np.bool_]) -> CellCounts:
    """Return the counts of some atoms only, numbered anew in their order; the others must have no pixels."""
    number = (np.cumsum(keep) - 1).astype(np.int32)
    return CellCounts(
        counts.grid,
        counts.pixels[keep],
        counts.quadrant_pixels[keep],
        counts.behind_pixels[keep],
        _renumber(counts.boxes, number),
        _renumber(counts.sectors, number),
    )


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
def _renumber(entries, number):  # type: ignore[no-untyped-def]
    result = np.empty_like(entries)
    for e in range(len(entries)):
        result[e, 0], result[e, 1], result[e, 2] = number[entries[e, 0]], entries[e, 1], entries[e, 2]
    return result


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
def _add(entries, n, newest, cell, atom):  # type: ignore[no-untyped-def]
    """Add a pixel to the newest entry of its cell, or open one; return the number of entries."""
    if newest[cell, 0] == atom:
        entries[newest[cell, 1], 2] += 1
        return n
    entries[n, 0], entries[n, 1], entries[n, 2] = atom, cell, 1
    newest[cell, 0], newest[cell, 1] = atom, n
    return n + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _count(samples, atom_count, step, shear, m, states, counts, slopes, bins):  # type: ignore[no-untyped-def]
    height, n = samples.shape
    box_offset, sector_offset = histogram_offsets(counts, bins)
    quadrant_pixels, behind_pixels = np.zeros((atom_count, 4)), np.zeros((atom_count, 4))
    boxes = np.empty((height * n, 3), np.int32)  # untouched pages cost nothing
    sectors = np.empty((height * n, 3), np.int32)
    newest_box, newest_sector = np.full((box_offset[4], 2), -1, np.int32), np.full((sector_offset[4], 2), -1, np.int32)
    state_table, angle_table = _tables(states, counts, slopes, bins)
    rays, at, quadrant = np.empty((3, n)), np.empty((3, n), np.uint16), np.empty(n, np.uint8)
    n_box, n_sector = 0, 0
    for y in range(height):
        _place_row(m, y, (-shear * y) % step, step, rays, at, quadrant)
        for k in range(n):
            atom = samples[y, k]
            if atom < 0:
                continue
            q = int(quadrant[k])
            side, level = 2 + (q & 1), q >> 1
            horizontal, vertical, dz = rays[0, k], rays[1, k], rays[2, k]
            quadrant_pixels[atom, q] += 1.0
            j = int(state_table[side, at[0, k]])
            while horizontal > states[side, j] * dz:  # ends at the last state, +inf
                j += 1
            if dz > 0.0:
                i = int(state_table[level, at[1, k]])
                while vertical > states[level, i] * dz:
                    i += 1
                n_box = _add(boxes, n_box, newest_box, box_offset[q] + i * counts[side] + j, atom)
            else:
                behind_pixels[atom, q] += 1.0
            if j > 0:
                t = int(angle_table[q, at[2, k]])
                while t < bins[q] - 1 and horizontal >= slopes[q, t + 1] * vertical:
                    t += 1
                n_sector = _add(sectors, n_sector, newest_sector, sector_offset[q] + j * bins[q] + t, atom)
    return quadrant_pixels, behind_pixels, boxes[:n_box].copy(), sectors[:n_sector].copy()
