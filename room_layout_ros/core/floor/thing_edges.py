"""What the edge of a thing, seen in one row of the picture, tells: how wide it is, and how far it goes on behind.

A level top is seen from about its own height, so its depth is not seen. A table is as deep as tables are, or as its
width lets it be, or it reaches to the legs that are seen under it and end at its edge.
"""

from __future__ import annotations

from numba import njit

from .floor_pixels import OBSTACLE_PIXEL

DEEP_M = 1.2
"""Behind its farthest pixel a level surface may go on so far (a table is long, seen from its corner)."""

_NARROW_M, _END_M, _TIMES_WIDE = 0.6, 1.0, 2.0
"""An edge of this to this width may be the end of a table that is so many times as long as wide."""

_WIDE_M, _CUT_OFF = 0.8, 0.5
"""Wide is what is as wide as the first; where a side of the picture cuts it off the second of that has to be seen."""

LOW_M, LONG_M = 0.40, 2.0
"""What hangs lower than the first is a bed or a sofa, and may go on for the second."""

OVER_LEGS_M = 0.2
"""What stands on legs goes on so far behind the farthest that is seen."""

_LEG_M, _AT_LEGS_M = 0.15, 2.0
"""A leg is no wider than the first, and no farther behind the edge than the second."""

STRAYS = 2
"""So many pixels of noise in a row part no edge from its legs, and make no legs of a cupboard."""


@njit(cache=True, nogil=True, error_model="numpy")
def joined(inverse, kind, u, step_m, strays):  # type: ignore[no-untyped-def]
    """First and last column of what is joined with a pixel of a thing in its row, over so many strays.

    `step_m` : by how much neighbours of one thing may differ in depth, m.
    """
    ends = [u, u]
    for side, step in enumerate((-1, 1)):
        k = u + step
        while 0 <= k < len(inverse) and abs(k - ends[side]) <= strays + 1:
            last = inverse[ends[side]]
            if kind[k] == OBSTACLE_PIXEL and abs(inverse[k] - last) < step_m * last * inverse[k]:
                ends[side] = k
            k += step
    return ends[0], ends[1]


@njit(cache=True, nogil=True, error_model="numpy")
def is_wide(wide_m, first, last, width):  # type: ignore[no-untyped-def]
    """Whether a thing is wide; cut off by a side of a picture of that width, it may be twice as wide."""
    enough = _WIDE_M
    if first == 0:
        enough *= _CUT_OFF
    if last == width - 1:
        enough *= _CUT_OFF
    return wide_m >= enough


@njit(cache=True, nogil=True, error_model="numpy")
def how_deep(wide_m):  # type: ignore[no-untyped-def]
    """How far a level thing may go on behind an edge of that width, m."""
    return max(DEEP_M, _TIMES_WIDE * wide_m) if _NARROW_M <= wide_m <= _END_M else DEEP_M


@njit(cache=True, nogil=True, error_model="numpy")
def to_its_legs(behind, pixels_per_m):  # type: ignore[no-untyped-def]
    """How far a table goes on behind its edge to the last of its legs, m; 0 where none is seen.

    `behind` : of each column of the edge how far behind it, in m, something ends that is seen below it; 0: nothing.
    """
    deep, k = 0.0, 0
    while k < len(behind):
        if behind[k] <= 0.0:
            k += 1
            continue
        begin, last, farthest = k, k, behind[k]
        while k < len(behind) and k - last <= STRAYS + 1:
            if behind[k] > 0.0:
                last, farthest = k, max(farthest, behind[k])
            k += 1
        if last - begin + 1 <= _LEG_M * pixels_per_m and farthest <= _AT_LEGS_M:
            deep = max(deep, farthest + OVER_LEGS_M)
    return deep
