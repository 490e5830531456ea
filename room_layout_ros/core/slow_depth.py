"""Depth with a slow error: how large it is in a frame, and what the depth says of a room in spite of it.

Stereo, and every depth camera a little, is wrong by an amount that hardly changes over tens of pixels: a whole wall is
measured too near, and no number of its pixels helps. In inverse depth that error is even over the image. It is followed
by a bilinear field over a coarse grid of nodes, unknown but for its size, which is measured on the frame: the residuals
of the cells of structure on the planes of the room, as far as they go together over a tile of the grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import MAD_TO_SIGMA
from .frame import CameraIntrinsics
from .layout import plane_rows
from .room_cells import INTERLEAVED_PARTS, RoomCells
from .room_cost import face_of_point

_TILES_ACROSS = 8
"""The nodes are an eighth of the image's width apart, 80 px of 640. Where the error is slower, little is lost."""

_LOOKED_AT = 4
"""Of the interleaved parts of the cells; neighbours say the same."""

_LEAST_STRUCTURE = 0.5
_LEAST_CELLS = 9
_LEAST_ERROR = 1e-5
_LEAST_TILES = 4
_NEIGHBOURS_ALIKE = 1.5
"""The errors of neighbouring cells go together: as many cells tell less, as if each were worse by this factor."""

_CAUCHY_SIGMAS = 1.3
_FARTHEST_CUTOFFS = 4.0
_RAY_X, _RAY_Y, _INVERSE, _PROBABILITY, _NODE_X, _NODE_Y = 0, 1, 2, 3, 6, 7


@dataclass(frozen=True, slots=True)
class StructureCells:
    """Cells of an image that may lie on a face of the room, and the grid of the slow error.

    Attributes
    ----------
    cells : (n, 8) float64 ray x, ray y, inverse depth, probability of ceiling, floor and wall, place in the grid x, y.
    nodes : (columns, rows) of the grid.
    """

    cells: NDArray[np.float64]
    nodes: tuple[int, int]


def structure_cells(cells: RoomCells, camera: CameraIntrinsics) -> StructureCells:
    """Choose the measured cells that are likely structure."""
    spacing = camera.width / _TILES_ACROSS
    nodes = (_TILES_ACROSS + 1, max(int(np.ceil(camera.height / spacing)), 1) + 1)
    pixels = np.array([camera.fx, camera.cx, camera.fy, camera.cy]) / spacing
    count = len(cells.rays) * _LOOKED_AT // INTERLEAVED_PARTS
    return StructureCells(_structure(cells.rays, cells.inverse_depth, cells.probability, count, pixels), nodes)


@njit(cache=True, nogil=True)
def _structure(rays, inverse_depth, probability, count, pixels):  # type: ignore[no-untyped-def]
    """Rows of `StructureCells.cells`; `pixels` is fx, cx, fy, cy in units of the grid."""
    rows, n = np.empty((count, 8)), 0
    for i in range(count):
        ceiling, floor = probability[i, 0], probability[i, 1]
        walls = probability[i, 2] + probability[i, 3] + probability[i, 4]
        if inverse_depth[i] > 0.0 and max(max(ceiling, floor), walls) >= _LEAST_STRUCTURE:
            rows[n, 0], rows[n, 1], rows[n, 2] = rays[i, 0], rays[i, 1], inverse_depth[i]
            rows[n, 3], rows[n, 4], rows[n, 5] = ceiling, floor, walls
            rows[n, 6] = rays[i, 0] * pixels[0] + pixels[1]
            rows[n, 7] = rays[i, 1] * pixels[2] + pixels[3]
            n += 1
    return rows[:n]


@njit(cache=True, nogil=True, inline="always")
def _on_face(row, m):  # type: ignore[no-untyped-def]
    """(Face behind a cell, -1 where it is none or of another kind; inverse depth there; probability of its kind)."""
    face, expected = face_of_point(m, row[_RAY_X], row[_RAY_Y], 1.0)
    mine = row[_PROBABILITY + min(face, 2)] if face >= 0 else 0.0
    return (face if mine >= _LEAST_STRUCTURE else -1), expected, mine


@njit(cache=True, nogil=True, inline="always")
def _tile(row, nodes):  # type: ignore[no-untyped-def]
    columns, rows = nodes
    return min(max(int(row[_NODE_X]), 0), columns - 2), min(max(int(row[_NODE_Y]), 0), rows - 2)


@njit(cache=True, nogil=True)
def measure_errors(cells, nodes, R, distances):  # type: ignore[no-untyped-def]
    """How wrong the depth is on the planes of a room that is about right; 0 where too little lies on them.

    Parameters
    ----------
    cells, nodes : of `StructureCells`. R, distances : of the room.

    Returns
    -------
    slow : standard deviation, in 1/m, of what neighbouring cells have in common: of the tiles' medians about 0.
    cell : of what is left of a single cell, as it counts in a fit.
    """
    m = plane_rows(R, distances)
    columns, rows = nodes
    tiles = (columns - 1) * (rows - 1)
    tile, off = np.full(len(cells), -1, np.int64), np.empty(len(cells))
    first = np.zeros(tiles + 1, np.int64)
    for i in range(len(cells)):
        face, expected, _ = _on_face(cells[i], m)
        if face >= 0:
            x, y = _tile(cells[i], nodes)
            tile[i], off[i] = y * (columns - 1) + x, cells[i, _INVERSE] - expected
            first[tile[i] + 1] += 1
    first = np.cumsum(first)
    sorted_off, fill = np.empty(first[tiles]), first.copy()
    for i in range(len(cells)):
        if tile[i] >= 0:
            sorted_off[fill[tile[i]]] = off[i]
            fill[tile[i]] += 1
    medians, spreads, n = np.empty(tiles), np.empty(tiles), 0
    for k in range(tiles):
        mine = sorted_off[first[k] : first[k + 1]]
        if len(mine) >= _LEAST_CELLS:
            middle = np.median(mine)
            medians[n], spreads[n] = abs(middle), np.median(np.abs(mine - middle))
            n += 1
    if n < _LEAST_TILES:
        return 0.0, 0.0
    return MAD_TO_SIGMA * np.median(medians[:n]), _NEIGHBOURS_ALIKE * MAD_TO_SIGMA * np.median(spreads[:n])


@njit(cache=True, nogil=True)
def depth_equations(cells, nodes, errors, R, distances):  # type: ignore[no-untyped-def]
    """(A (8, 8), g (8,)) of turn and logarithms of the distances, the slow error marginalised.

    A cell on face k has w = m_k . ray + the slow error there + noise (Cauchy), m_k = n_k / d_k. Turned by v and with
    d_k larger by the factor exp(s), m_k . ray changes by v . (m_k x ray) - s m_k . ray.
    """
    slow, cell = errors
    cell = max(cell, _LEAST_ERROR)
    columns, rows = nodes
    size = 8 + columns * rows
    A, g = np.zeros((size, size)), np.zeros(size)
    m = plane_rows(R, distances)
    cutoff, place, value = _CAUCHY_SIGMAS * (slow + cell), np.empty(8, np.int64), np.empty(8)
    for i in range(len(cells)):
        face, expected, mine = _on_face(cells[i], m)
        off = (cells[i, _INVERSE] - expected) / cutoff
        if face < 0 or abs(off) > _FARTHEST_CUTOFFS:
            continue
        weight = mine / (cell * cell * (1.0 + off * off))
        x, y = cells[i, _RAY_X], cells[i, _RAY_Y]
        place[0], place[1], place[2], place[3] = 0, 1, 2, 3 + face
        value[0], value[1] = m[face, 1] - m[face, 2] * y, m[face, 2] * x - m[face, 0]
        value[2], value[3] = m[face, 0] * y - m[face, 1] * x, -expected
        column, row = _tile(cells[i], nodes)
        right, down = cells[i, _NODE_X] - column, cells[i, _NODE_Y] - row
        corner = 8 + row * columns + column
        place[4], place[5], place[6], place[7] = corner, corner + 1, corner + columns, corner + columns + 1
        value[4], value[5] = (1.0 - right) * (1.0 - down), right * (1.0 - down)
        value[6], value[7] = (1.0 - right) * down, right * down
        for a in range(8):
            weighted = weight * value[a]
            g[place[a]] += weighted * (cells[i, _INVERSE] - expected)
            for b in range(a, 8):
                A[place[a], place[b]] += weighted * value[b]
    return _marginalised(A, g, 1.0 / (slow * slow))


@njit(cache=True, nogil=True)
def _marginalised(A, g, prior):  # type: ignore[no-untyped-def]
    """The first eight unknowns of the equations (upper half of A) when the others have mean 0 and that precision."""
    others = len(g) - 8
    B, known = np.empty((others, others)), np.empty((others, 9))
    for a in range(others):
        for b in range(a, others):
            B[a, b] = B[b, a] = A[8 + a, 8 + b]
        B[a, a] += prior
        known[a, 8] = g[8 + a]
        known[a, :8] = A[:8, 8 + a]
    solved = np.linalg.solve(B, known)
    left, right = np.empty((8, 8)), np.empty(8)
    for a in range(8):
        right[a] = g[a] - (known[:, a] * solved[:, 8]).sum()
        for b in range(8):
            left[a, b] = A[min(a, b), max(a, b)] - (known[:, a] * solved[:, b]).sum()
    return left, right
