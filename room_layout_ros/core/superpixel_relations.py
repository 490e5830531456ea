"""How touching superpixels stand to each other: above, beside, behind (paper, Table 1), and how alike they are."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics
from .superpixels import Superpixels

_TOLERANCE_M, _SPAN_M = 0.03, 0.30
"""A superpixel is fully above another when it is this much and more above it."""
_TOLERANCE_SLOPE, _SPAN_SLOPE = 0.02, 0.20
"""The same for directions |u|, |v| where nothing is known of depth."""
_RELATION_AXIS = ((0, 1, -1.0), (1, 1, 1.0), (2, 0, 1.0), (3, 0, -1.0), (4, 2, 1.0), (5, 2, -1.0))
"""Column, room axis (Y is down) and sign of each relation."""
_COLOR_SCALE = 10.0
_PLANE_SCALE = 0.03
"""Relative difference of depth at which two planes are no longer one."""


def compute_relations(
    camera: CameraIntrinsics, superpixels: Superpixels, R: NDArray[np.float64], with_depth: bool
) -> NDArray[np.float64]:
    """(E, 6) float64 0..1: i above, below, right of, left of, in front of (farther), behind j (paper, Table 1).

    Positions are the planes' points at the superpixels' centres, where both have one; without depth directions (u, v)
    tell what they can, and nothing is in front or behind.
    """
    camera_numbers = camera.numbers
    return _relations(superpixels.center_px, superpixels.plane, superpixels.edges, R, camera_numbers, with_depth)


@njit(cache=True, nogil=True, error_model="numpy")
def _position(x, y, plane, R, camera, with_depth):  # type: ignore[no-untyped-def]
    """Point on the superpixel's plane (NaN where it has none), or with z = 0 its direction, in room axes."""
    fx, fy, cx, cy = camera
    u, v = (x - cx) / fx, (y - cy) / fy
    p = R[0, 0] * u + R[0, 1] * v + R[0, 2]
    q = R[1, 0] * u + R[1, 1] * v + R[1, 2]
    r = R[2, 0] * u + R[2, 1] * v + R[2, 2]
    if with_depth:
        w = plane[0] * x + plane[1] * y + plane[2]
        z = 1.0 / w if w > 0 else np.nan
        return p * z, q * z, r * z
    return (p / r, q / r, 0.0) if r > 0.1 else (np.nan, np.nan, np.nan)


@njit(cache=True, nogil=True, error_model="numpy")
def _relations(centre, plane, edges, R, camera, with_depth):  # type: ignore[no-untyped-def]
    tolerance, span = (_TOLERANCE_M, _SPAN_M) if with_depth else (_TOLERANCE_SLOPE, _SPAN_SLOPE)
    position = np.empty((len(centre), 3))
    for k in range(len(centre)):
        at = _position(float(centre[k, 0]), float(centre[k, 1]), plane[k], R, camera, with_depth)
        position[k, 0], position[k, 1], position[k, 2] = at
    relation = np.zeros((len(edges), 6))
    for e in range(len(edges)):
        for column, axis, sign in _RELATION_AXIS:
            step = sign * (position[edges[e, 0], axis] - position[edges[e, 1], axis])
            share = (step - tolerance) / span
            if share > 0.0:  # not where a position is NaN
                relation[e, column] = min(share, 1.0)
    return relation


def compare_neighbours(superpixels: Superpixels, with_depth: bool) -> NDArray[np.float64]:
    """(E, 3) float64 0..1: 1, likeness of colour, likeness of plane (0 without depth)."""
    return np.asarray(
        _likeness(superpixels.edges, superpixels.mean_lab, superpixels.center_px, superpixels.plane, with_depth)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _likeness(edges, lab, centre, plane, with_depth):  # type: ignore[no-untyped-def]
    result = np.ones((len(edges), 3))
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        square = 0.0
        for c in range(3):
            square += (float(lab[i, c]) - float(lab[j, c])) ** 2
        result[e, 1] = np.exp(-0.5 * square / _COLOR_SCALE**2)
        gap = max(_plane_gap(plane[i], plane[j], centre[j]), _plane_gap(plane[j], plane[i], centre[i]))
        like = np.exp(-0.5 * (gap / _PLANE_SCALE) ** 2) if with_depth else 0.0
        result[e, 2] = like if like == like else 0.0
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def _plane_gap(plane, other, centre):  # type: ignore[no-untyped-def]
    """Relative difference of inverse depth between a plane and another at the other's centre; NaN where one is none."""
    x, y = float(centre[0]), float(centre[1])
    mine = plane[0] * x + plane[1] * y + plane[2]
    others = other[0] * x + other[1] * y + other[2]
    return abs(mine - others) / abs(others)
