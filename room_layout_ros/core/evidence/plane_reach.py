"""What lies beyond the plane of each plane segment: a wall ends the room, a wardrobe's front does not."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .room_extents import CELL_PX

COLUMNS = (
    "reach_beyond",
    "reach_before",
    "reach_on",
    "reach_on_top",
    "reach_on_bottom",
    "reach_beside_beyond",
    "reach_above_beyond",
    "reach_near_beyond",
    "reach_ceiling",
    "reach_floor",
)
"""Shares of the scene's cells beyond the plane, before it and on it; how near the cells on it come to the ceiling and
to the floor (m); shares beyond it among the cells beside the segment, above it and close around it; how far ceiling and
floor go on beyond it (m)."""

_TOLERANCE_M, _TOLERANCE_PER_M = 0.10, 0.005
"""Off the plane is what is farther from it than the first plus the second times the square of the range."""

_LEVEL_M = 0.12
"""Cells so near to the scene's top or bottom are ceiling or floor."""

_AROUND_PX = 6
"""How many cells around a segment's box are close to it."""

_STEPS_PER_M = np.float32(1e4)
_NONE_STEPS = np.int32(2**30)


def compute_plane_reach(
    points: NDArray[np.float32],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    planes: NDArray[np.float64],
    boxes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Compare all cells of a frame with each plane.

    Parameters
    ----------
    points : (rows, cols, 3) float32
        Means of the cells of 8 px in room axes, m; NaN where not measured.
    low, high : (3,) float64
        Robust extents of the scene.
    planes : (S, 4) float64
        Normal away from the camera in room axes and distance; NaN for none.
    boxes : (S, 4) float64
        Bounds of the segments in the image: x low, x high, y low, y high, px.

    Returns
    -------
    (S, 10) float64
        `COLUMNS`; NaN without a plane or where there is no cell to compare.
    """
    cells = np.floor(boxes / CELL_PX).astype(np.int64)
    return np.asarray(_reach(points, float(low[1]), float(high[1]), planes, cells))


@njit(cache=True, nogil=True)
def _reach(points, top, bottom, planes, boxes):  # type: ignore[no-untyped-def]
    rows, cols = points.shape[:2]
    cells = _planar(points, top, bottom)
    measured = _measured_above(points)
    beyond = np.empty(rows * cols, np.float32)
    out = np.full((planes.shape[0], 10), np.nan)
    for s in range(planes.shape[0]):
        if not np.isnan(planes[s, 3]) and measured[rows, cols] > 0:
            _compare(cells, measured[rows, cols], top, bottom, planes[s].astype(np.float32), beyond, out[s])
            _look_beside(beyond.reshape(rows, cols), measured, boxes[s], out[s])
    return out


@njit(cache=True, nogil=True)
def _planar(points, top, bottom):  # type: ignore[no-untyped-def]
    """X, Y, Z, tolerance, level (-1 ceiling, 1 floor) and twice Y in steps of the cells, in an array each.

    A cell without a point is off no plane, for its tolerance, and on a plane is neither its top nor its bottom.
    """
    rows, cols = points.shape[:2]
    x, y, z = np.zeros(rows * cols, np.float32), np.zeros(rows * cols, np.float32), np.zeros(rows * cols, np.float32)
    tolerance, level = np.full(rows * cols, np.inf, np.float32), np.zeros(rows * cols, np.float32)
    upper, lower = np.full(rows * cols, _NONE_STEPS, np.int32), np.full(rows * cols, -_NONE_STEPS, np.int32)
    for i in range(rows * cols):
        px, py, pz = points[i // cols, i % cols]
        if not np.isnan(pz):
            x[i], y[i], z[i] = px, py, pz
            tolerance[i] = _TOLERANCE_M + _TOLERANCE_PER_M * (px * px + py * py + pz * pz)
            level[i] = -1 if py < top + _LEVEL_M else 1 if py > bottom - _LEVEL_M else 0
            upper[i] = lower[i] = np.int32(np.round(py * _STEPS_PER_M))
    return x, y, z, tolerance, level, upper, lower


@njit(cache=True, nogil=True)
def _measured_above(points):  # type: ignore[no-untyped-def]
    """(rows + 1, cols + 1) int32 integral image of the cells with a point."""
    rows, cols = points.shape[:2]
    total = np.zeros((rows + 1, cols + 1), np.int32)
    for row in range(rows):
        in_row = 0
        for col in range(cols):
            in_row += not np.isnan(points[row, col, 2])
            total[row + 1, col + 1] = total[row, col + 1] + in_row
    return total


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz", "reassoc", "contract"})
def _compare(cells, n, top, bottom, plane, beyond, out):  # type: ignore[no-untyped-def]
    """Mark the cells beyond the plane; write shares and reaches of all cells (columns 0-4, 8, 9).

    Extremes are sought in steps of 0.1 mm: minima of whole numbers run in vector registers.
    """
    x, y, z, tolerance, level, upper, lower = cells
    nx, ny, nz, d = plane
    zero, one, nothing = np.float32(0.0), np.float32(1.0), np.int32(0)
    n_beyond = n_before = zero
    on_top, on_bottom, ceiling, floor = _NONE_STEPS, -_NONE_STEPS, nothing, nothing
    for i in range(len(x)):
        limit = tolerance[i]
        off = nx * x[i] + ny * y[i] + nz * z[i] - d
        is_beyond, is_before = one if off > limit else zero, one if off < -limit else zero
        n_beyond += is_beyond
        n_before += is_before
        beyond[i] = is_beyond
        on = abs(off) <= limit
        on_top = min(on_top, upper[i] if on else _NONE_STEPS)
        on_bottom = max(on_bottom, lower[i] if on else -_NONE_STEPS)
        reach = np.int32(is_beyond * off * _STEPS_PER_M)
        ceiling = max(ceiling, reach if level[i] < zero else nothing)
        floor = max(floor, reach if level[i] > zero else nothing)
    n_on = n - n_beyond - n_before
    out[0], out[1], out[2] = n_beyond / n, n_before / n, n_on / n
    if n_on > 0:
        out[3], out[4] = on_top / _STEPS_PER_M - top, bottom - on_bottom / _STEPS_PER_M
    out[8], out[9] = ceiling / _STEPS_PER_M, floor / _STEPS_PER_M


@njit(cache=True, nogil=True)
def _look_beside(beyond, measured, box, out):  # type: ignore[no-untyped-def]
    """Write the shares of cells beyond the plane beside the box, above it and close around it (columns 5-7)."""
    rows, cols = beyond.shape
    left, right, upper, lower = max(box[0], 0), min(box[1], cols - 1) + 1, max(box[2], 0), min(box[3], rows - 1) + 1
    inside = _cells(measured, upper, lower, left, right), _sum_box(beyond, upper, lower, left, right)
    beside = _cells(measured, upper, lower, 0, cols) - inside[0]
    if beside > 0:
        out[5] = (_sum_box(beyond, upper, lower, 0, cols) - inside[1]) / beside
    above = _cells(measured, 0, upper, left, right)
    if above > 0:
        out[6] = _sum_box(beyond, 0, upper, left, right) / above
    first, last = max(upper - _AROUND_PX, 0), min(lower + _AROUND_PX, rows)
    start, end = max(left - _AROUND_PX, 0), min(right + _AROUND_PX, cols)
    near = _cells(measured, first, last, start, end) - inside[0]
    if near > 0:
        out[7] = (_sum_box(beyond, first, last, start, end) - inside[1]) / near


@njit(cache=True, nogil=True)
def _cells(total, first, last, start, end):  # type: ignore[no-untyped-def]
    """Cells with a point in rows first..last-1 and columns start..end-1."""
    return total[last, end] - total[first, end] - total[last, start] + total[first, start]


@njit(cache=True, nogil=True, fastmath={"reassoc"})
def _sum_box(mask, first, last, start, end):  # type: ignore[no-untyped-def]
    """Sum of a mask of 0 and 1, exact in any order."""
    total = np.float32(0.0)
    for row in range(first, last):
        for col in range(start, end):
            total += mask[row, col]
    return float(total)
