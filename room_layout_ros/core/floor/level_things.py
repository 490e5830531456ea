"""What hangs over the floor and is seen from about its own height: of a table's top a robot sees little but the edge.

A look up from the floor (`overhang.py`) needs a piece of the thing that is as high as a hand is long. Here each column
of the picture is followed upwards instead, over the things that it meets. Below a thing is the floor under its pixels;
that between two of them on one level; that under pixels without depth behind its edge, for a sensor loses a top that it
sees flat; so much behind the edge as a level surface may go on without one more pixel; and that before an underside
which the picture cuts off.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..labels import CLUTTER, FLOOR
from .floor_cells import FREE_CELL
from .floor_pixels import FLYING_PIXEL, NOTHING, OBSTACLE_PIXEL, camera_height, pixel_rays
from .thing_edges import DEEP_M, LONG_M, LOW_M, STRAYS, how_deep, is_wide, joined, to_its_legs

_HANGS_M = 0.12
"""What begins lower stands on the floor: as far as it is seen, its cells hold its surface."""

_SAME_LEVEL_M, _SAME_RANGE_M, _ROWS_APART = 0.08, 0.5, 1.5
"""The next pixel up is of the same thing if it is no farther from the last in height, and over the floor; or, of a top
that is seen flat, no more than so many times as far as it goes from one row to the next."""

_THIN_M, _SHALLOW_M = 0.10, 0.1
"""The edge of a level surface is no higher than the first. Behind its farthest pixel such a surface may go on for
`DEEP_M` and more (`thing_edges.py`), other things for the second."""

_DESK_M = 0.9
"""A wide front that rises through the camera's height is no back of a chair but a desk or a cupboard, and may go on
behind its edge so far."""

_LEG_SEEN_M = 0.2
"""What is seen behind an edge and ends at it, for so much in height, may be a leg of the same table."""

_ROWS = 16
"""How wide things are is looked at in one of so many rows."""

_TOWARDS_M, _TIMES_SEEN = 0.6, 6.0
"""An underside that the picture's upper side cuts off goes on towards the camera: so far, but not for more than so many
times what is seen of it."""

_DEEPEST_M = 1.5
"""So far a surface goes on over pixels without depth."""

_BESIDE_M = 0.3
"""What a side of the picture cuts off goes on so far beside it: a camera that looks down sees floor there."""

_CLOSING = np.ones((3, 3), np.uint8)
"""Between two hidden cells there is no free one."""

_LEVEL = 1e-6
"""Rays that rise or fall by no more are level."""

_SIDEWAYS = 1e-9

_NOTHING, _PIXEL, _THING, _NO_DEPTH = range(4)
"""What a column follows: nothing, one pixel (it may be a stray), a thing, pixels without depth behind its edge."""

_LAST, _LOWEST, _BEGIN, _WIDE, _UNDERSIDE, _RANGE, _HEIGHT, _LOST_FROM, _DEEP, _BEHIND = range(10)
"""Of a column: inverse depth of the last pixel of the thing; height of the first, and its distance from below the
camera; 1 if the thing hangs and is wide anywhere, else 0; how far its underside may go on, by the ray below that (inf);
as a level surface behind its farthest pixel (0: not yet told). How far behind the first what stands on the floor ends
at it (0: nothing does).
Where the depth is lost: the distance from below the camera that was reached; height; since which distance."""


def below_level_things(
    grid: NDArray[np.int8],
    inverse_depth: NDArray[np.float32],
    kind: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    cell: NDArray[np.int32],
    camera: CameraIntrinsics,
    T_camera_floor: NDArray[np.float64],
    corner: tuple[float, float, float],
) -> NDArray[np.bool_]:
    """Return the cells that lie below a thing, as far as its pixels, or what may be behind its edge, tell.

    Parameters
    ----------
    grid : (rows, cols) int8; only where it is free is looked closely. inverse_depth : (H, W) float32, 0 where nothing
        was measured.
    kind, cell : (H, W) uint8 and int32 of `sum_floor_cells`. labels : (H, W) uint8 of the estimate.
    corner : x and y of the lower corner of cell (0, 0), and the side of a cell; m.

    Returns
    -------
    (rows, cols) bool, some of it not free in any case.
    """
    below = _follow_columns(inverse_depth, kind, labels, cell, camera.numbers, T_camera_floor, corner, grid)
    return np.asarray(cv2.morphologyEx(below.view(np.uint8), cv2.MORPH_CLOSE, _CLOSING)).view(np.bool_)


@njit(cache=True, nogil=True, error_model="numpy")
def _follow_columns(inverse, kind, labels, cell, intrinsics, T, corner, grid):  # type: ignore[no-untyped-def]
    """(rows, cols) bool: cells below a thing by at least two columns."""
    height, width = inverse.shape
    free = grid.ravel() == FREE_CELL
    first, hidden = np.full(grid.shape, -1, np.int32), np.zeros(grid.shape, np.bool_)
    by_side = np.zeros((2, *grid.shape), np.bool_)
    over = first, hidden, by_side, width - 1
    above_floor = camera_height(T)
    closer, side = np.float32(0.5 * corner[2]), np.float32(corner[2])
    follows, columns, on = np.zeros(width, np.uint8), np.zeros((10, width)), np.zeros(width, np.uint8)
    for v in range(height - 1, -1, -1):
        ax0, ax1, ay0, ay1, az0, az1 = pixel_rays(T, intrinsics, v)
        begin = end = edge_end = -1  # of what is joined with the last pixel whose width was asked
        to_legs = 0.0
        down = T[1, 0] / intrinsics[1], T[1, 1] / intrinsics[1], T[1, 2] / intrinsics[1]  # from a pixel to that below
        _row_goes_on(inverse[v], kind[v], follows, columns[_LAST], closer, on)
        for u in range(width):
            what, goes_on = kind[v, u], on[u] > 0
            if what != OBSTACLE_PIXEL and follows[u] == _NOTHING:
                continue
            w = inverse[v, u]
            thing, lost = what == OBSTACLE_PIXEL or goes_on, w <= 0.0 or what == FLYING_PIXEL
            if goes_on and columns[_LOWEST, u] >= _HANGS_M:
                look_wide = v % _ROWS == 0 and columns[_WIDE, u] == 0.0
                if look_wide or columns[_DEEP, u] == 0.0:
                    if u > end:
                        begin, end = joined(inverse[v], kind[v], u, side, 0)
                    wide_m = (end - begin + 1) / (intrinsics[0] * w)
                    if look_wide:
                        columns[_WIDE, u] = is_wide(wide_m, begin, end, width)
                    if columns[_DEEP, u] == 0.0:
                        if u > edge_end:
                            edge_begin, edge_end = joined(inverse[v], kind[v], u, side, STRAYS)
                            to_legs = to_its_legs(columns[_BEHIND, edge_begin : edge_end + 1], intrinsics[0] * w)
                        columns[_DEEP, u] = max(how_deep(wide_m), to_legs)
            if goes_on and (cell[v, u] < 0 or not free[cell[v, u]]):
                columns[_LAST, u], follows[u] = w, _THING
                continue
            ax, ay, up = ax0 + ax1 * u, ay0 + ay1 * u, az0 + az1 * u
            along = max(np.sqrt(ax * ax + ay * ay), _SIDEWAYS)
            along_below = np.sqrt((ax + down[0]) ** 2 + (ay + down[1]) ** 2) if follows[u] != _NOTHING else 0.0
            rays = (ax / along, ay / along, along, up, along_below, up + down[2])
            if thing:
                follows[u] = _meet(follows[u], goes_on, columns, w, rays, above_floor, over, u, corner)
                if follows[u] == _PIXEL:
                    below = _rows_to_depth(inverse, labels, v, u)
                    columns[_UNDERSIDE, u] = _end_of_underside(up / w, (ax, ay, up), down, below)
            elif lost and _may_be_its(labels[v, u], follows[u], columns, u, rays, above_floor):
                follows[u] = _go_on_without_depth(follows[u], columns, rays, above_floor, over, u, corner)
            else:
                _end(follows[u], columns, np.inf if lost else along / w, rays, above_floor, over, u, corner)
                follows[u] = _NOTHING
    ax0, ax1, ay0, ay1, az0, az1 = pixel_rays(T, intrinsics, 0)
    for u in range(width):
        if follows[u] == _THING:
            ray = ax0 + ax1 * u, ay0 + ay1 * u, az0 + az1 * u
            _go_on_above_picture(columns, ray, above_floor, over, u, corner)
    _go_on_beside_picture(hidden, by_side, int(np.rint(_BESIDE_M / corner[2])))
    return hidden


@njit(cache=True, nogil=True, error_model="numpy")
def _row_goes_on(inverse, kind, follows, last, closer, on):  # type: ignore[no-untyped-def]
    """Write where a row's pixels are surely of the thing below them; by itself, so that it runs on vectors.

    What rises over the robot's height is no obstacle there, but the same thing.
    """
    for u in range(len(on)):
        w = inverse[u]
        seen = (kind[u] == OBSTACLE_PIXEL) | ((kind[u] == NOTHING) & (w > np.float32(0.0)))
        followed = (follows[u] == _PIXEL) | (follows[u] == _THING)
        on[u] = seen & followed & (abs(w - last[u]) < closer * w * last[u])


@njit(cache=True, nogil=True, error_model="numpy")
def _behind(follows, columns, u, r, h, last):  # type: ignore[no-untyped-def]
    """How far behind a pixel, at that distance and height, a thing ends that is seen below it, m; 0 if none does."""
    if follows in (_NOTHING, _PIXEL) or h - columns[_LOWEST, u] < _LEG_SEEN_M:
        return 0.0
    return max((columns[_LOST_FROM, u] if follows == _NO_DEPTH else last) - r, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _rows_to_depth(inverse, labels, v, u):  # type: ignore[no-untyped-def]
    """Rows down to the first pixel with depth or of floor: an underside seen flat loses its depth too."""
    n = 1
    while v + n < len(inverse) and inverse[v + n, u] <= 0.0 and labels[v + n, u] != FLOOR:
        n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _end_of_underside(over_camera, ray, down, rows):  # type: ignore[no-untyped-def]
    """Distance at which the ray so many rows below a pixel meets the level of that pixel; inf where it does not rise.

    `over_camera` : height of the pixel over the camera, m. `ray`, `down` : ahead, to the left and up per metre of
    depth, of the pixel and from one row to the next.
    """
    rises = ray[2] + rows * down[2]
    if over_camera <= 0.0 or rises <= _LEVEL:
        return np.inf
    return np.sqrt((ray[0] + rows * down[0]) ** 2 + (ray[1] + rows * down[1]) ** 2) * over_camera / rises


@njit(cache=True, nogil=True, error_model="numpy")
def _last_seen(follows, columns, u, rays, above_floor):  # type: ignore[no-untyped-def]
    """Distance from below the camera and height of what a column came to."""
    if follows == _NO_DEPTH:
        return columns[_RANGE, u], columns[_HEIGHT, u]
    z = 1.0 / columns[_LAST, u]
    return rays[4] * z, above_floor + rays[5] * z


@njit(cache=True, nogil=True, error_model="numpy")
def _may_be_its(label, follows, columns, u, rays, above_floor):  # type: ignore[no-untyped-def]
    """Whether a pixel without depth may be of the thing below it: of a top that is seen flat by any label but floor's,
    for its few rows belong to the superpixels of what is behind as often.
    """
    if label in (CLUTTER, FLOOR):
        return label == CLUTTER
    return _last_seen(follows, columns, u, rays, above_floor)[1] - columns[_LOWEST, u] < _THIN_M


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _meet(follows, goes_on, columns, w, rays, above_floor, over, u, corner):  # type: ignore[no-untyped-def]
    """Follow a column on to a pixel of a thing: that of the last (surely, if it `goes_on`) or another.

    `rays` : unit vector over the floor, ahead and to the left; way over the floor and up per metre of depth; both of
    the pixel below.
    """
    _, _, along, up, _, _ = rays
    r, h = along / w, above_floor + up / w
    last, same = r, goes_on
    if follows != _NOTHING:
        last, last_height = _last_seen(follows, columns, u, rays, above_floor)
        farthest = max(_SAME_RANGE_M, _ROWS_APART * _to_next_row(r, h - above_floor, rays))
        near = r > last - _SHALLOW_M if follows == _NO_DEPTH else -_SAME_RANGE_M < r - last < farthest
        same = goes_on or (near and abs(h - last_height) < _SAME_LEVEL_M)
    if not same:
        _end(follows, columns, r, rays, above_floor, over, u, corner)
        columns[_BEHIND, u] = _behind(follows, columns, u, r, h, last)
        columns[_LOWEST, u], columns[_BEGIN, u], columns[_WIDE, u], columns[_DEEP, u] = h, r, 0.0, 0.0
    elif h >= _HANGS_M:
        _mark(over, u, rays, last, r, corner)
    columns[_LAST, u] = w
    return _THING if same else _PIXEL


@njit(cache=True, nogil=True, error_model="numpy")
def _to_next_row(r, level, rays):  # type: ignore[no-untyped-def]
    """How far a level surface, so high over the camera, goes from the row below to this one, where it is seen flat."""
    _, _, _, up, along_below, up_below = rays
    if up > -_LEVEL or level > -_LEVEL:
        return 0.0
    return min(r - along_below * level / up_below, DEEP_M)


@njit(cache=True, nogil=True, error_model="numpy")
def _go_on_without_depth(follows, columns, rays, above_floor, over, u, corner):  # type: ignore[no-untyped-def]
    """Follow a column on where the depth is lost: as if on the level of the last pixel with depth."""
    _, _, along, up, _, _ = rays
    last, h = _last_seen(follows, columns, u, rays, above_floor)
    if h < _HANGS_M or follows == _PIXEL:
        return _NOTHING
    if follows == _THING:
        columns[_LOST_FROM, u], columns[_HEIGHT, u] = last, h
    r = along * (h - above_floor) / up if up < -_LEVEL else -1.0
    if 0.0 < r < columns[_LOST_FROM, u] + _DEEPEST_M:
        columns[_RANGE, u] = max(last, r)
        _mark(over, u, rays, last, columns[_RANGE, u], corner)
        return _NO_DEPTH
    _mark(over, u, rays, last, columns[_LOST_FROM, u] + DEEP_M, corner)
    return _NOTHING


@njit(cache=True, nogil=True, error_model="numpy")
def _end(follows, columns, beyond, rays, above_floor, over, u, corner):  # type: ignore[no-untyped-def]
    """Leave what a column followed: behind its farthest pixel a level surface may go on unseen.

    It ends before the next ray would meet its top from above, or the ray below its first pixel its underside from
    below; seen from its own height neither tells. `beyond` : distance of what is seen next.
    """
    if follows in (_NOTHING, _PIXEL):
        return
    _, _, along, up, _, _ = rays
    r, h = _last_seen(follows, columns, u, rays, above_floor)
    lowest = columns[_LOWEST, u]
    if min(h, lowest) < _HANGS_M or beyond < r:
        return
    front = columns[_WIDE, u] > 0.0 and lowest < above_floor
    if front and lowest < LOW_M:
        far = r + LONG_M
    elif h - lowest < _THIN_M:
        far = r + max(DEEP_M, columns[_DEEP, u])
    else:
        far = r + (_DESK_M if front else _SHALLOW_M)
    if up < -_LEVEL and h < above_floor:
        far = min(far, along * (h - above_floor) / up)
    if lowest > above_floor:
        far = min(far, columns[_UNDERSIDE, u])
    _mark(over, u, rays, r, min(far, beyond), corner)


@njit(cache=True, nogil=True, error_model="numpy")
def _go_on_above_picture(columns, ray, above_floor, over, u, corner):  # type: ignore[no-untyped-def]
    """Follow on what reaches the picture's upper side: a front behind itself, an underside towards the camera.

    `ray` : ahead, to the left and up per metre of depth, of the pixel there.
    """
    ax, ay, up = ray
    along, z = max(np.sqrt(ax * ax + ay * ay), _SIDEWAYS), 1.0 / columns[_LAST, u]
    r, h, lowest = along * z, above_floor + up * z, columns[_LOWEST, u]
    if min(h, lowest) < _HANGS_M:
        return
    near, far, seen = r, r, columns[_BEGIN, u] - r
    if columns[_WIDE, u] > 0.0 and lowest < above_floor:
        far = r + _DESK_M
    elif h - lowest < _THIN_M and seen > 0.0:
        near = max(r - min(_TOWARDS_M, _TIMES_SEEN * seen), 0.0)
    if near < far:
        _mark(over, u, (ax / along, ay / along), near, far, corner)


@njit(cache=True, nogil=True, error_model="numpy")
def _go_on_beside_picture(hidden, by_side, cells):  # type: ignore[no-untyped-def]
    """Hide so many cells to the left of what the leftmost column hides, and to the right of what the rightmost does."""
    rows, cols = hidden.shape
    begun = hidden.copy()
    for i in range(rows):
        for j in range(cols):
            if begun[i, j] and by_side[0, i, j]:
                hidden[i : i + cells + 1, j] = True
            if begun[i, j] and by_side[1, i, j]:
                hidden[max(i - cells, 0) : i, j] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _mark(over, u, rays, near, far, corner):  # type: ignore[no-untyped-def]
    """Mark the cells along a ray from one distance to another; those marked by two columns are hidden.

    `rays` : begins with the unit vector over the floor, ahead and to the left.
    """
    first, hidden, by_side, last = over
    x0, y0, size = corner
    rows, cols = first.shape
    steps = int(2.0 * abs(far - near) / size) + 1
    for k in range(steps + 1):
        r = near + (far - near) * k / steps
        i, j = int(np.floor((rays[1] * r - y0) / size)), int(np.floor((rays[0] * r - x0) / size))
        if 0 <= i < rows and 0 <= j < cols:
            hidden[i, j] |= first[i, j] >= 0 and first[i, j] != u
            first[i, j] = u
            if u in (0, last):
                by_side[min(u, 1), i, j] = True
