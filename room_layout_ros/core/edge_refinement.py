"""The last refinement of a room: depth with its slow error, the edges of the room and the lines of the picture.

Depth alone cannot know better than its slow error (`slow_depth`), several centimetres at 4 m for stereo. The picture
can: the edges of the room are seen to about a pixel (`room_edges`), and all lines along its axes aim at its vanishing
points. Both say nothing of the scale; the depth says that, its slow error averaged over the whole image. Gauss-Newton
over the turn and the logarithms of the distances; every part counts by its noise, that of the depth as measured on the
frame: where depth is good it decides. Beyond the paper (docs/method.md, section 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics
from .layout import plane_rows
from .lines import LineSegments, segment_planes
from .room_axes import cross, nearest_rotation, rotate_rows
from .room_cells import RoomCells
from .room_edges import add_edges, edge_candidates
from .slow_depth import depth_equations, measure_errors, structure_cells

LEAST_SLOW_ERROR = 0.0002
"""In 1/m. Where the depth is better (2 mm at 3 m), there is nothing to gain."""

_ROUNDS = ((6.0, 12), (3.0, 8), (2.0, 5))
"""Spread in px that the edges may have about those of the cuboid, and how far off they are looked for, by round."""

_STEPS = 3
_LARGEST_TURN_RAD = np.deg2rad(1.0)
_LARGEST_SHIFT = 0.05

_START_TURN_RAD = np.deg2rad(2.0)
_START_SHIFT = 0.05
"""How far the start may be off: holds what neither depth nor picture knows where it is."""

_LINE_SIGMA_RAD = np.deg2rad(0.15)
_LINE_END_PX = 1.2
"""A segment's direction is uncertain by so many pixels over its length, and no less than the angle above."""

_LINE_TOLERANCE_RAD = np.deg2rad(3.0)
_LINE_CAUCHY_SIGMAS = 2.0


@dataclass(frozen=True, slots=True)
class RoomPicture:
    """The picture in which the edges of a room are looked for.

    Attributes
    ----------
    color : (H, W, 3) uint8. segments : of it. superpixels : (H, W) int32 index. clutter : (K,) bool by superpixel.
    """

    color: NDArray[np.uint8]
    segments: LineSegments
    superpixels: NDArray[np.int32]
    clutter: NDArray[np.bool_]


def refine_on_edges(
    cells: RoomCells,
    camera: CameraIntrinsics,
    picture: RoomPicture,
    R_room_camera: NDArray[np.float64],
    distances: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Turn the axes and move the planes of a room that is about right onto depth, edges and lines together.

    Parameters
    ----------
    cells : RoomCells, with depth
    camera : CameraIntrinsics
    picture : RoomPicture
    R_room_camera, distances : (3, 3) and (5,) float64, as of `RoomCuboid`

    Returns
    -------
    R_room_camera, distances
        The given ones where the depth is too good to gain by the picture, or too little of it is on the planes.
    """
    structure = structure_cells(cells, camera)
    normals, middles = segment_planes(picture.segments, camera)
    lines = normals, middles, picture.segments.length_px.astype(np.float64)
    green = np.ascontiguousarray(picture.color[..., 1])  # one type of array: a frame's may be read-only
    image = green, picture.superpixels, picture.clutter, camera.numbers
    R, moved, found = _refine(structure.cells, structure.nodes, image, lines, R_room_camera, distances)
    if not found:
        return R_room_camera, distances
    return np.asarray(nearest_rotation(R)), moved


@njit(cache=True, nogil=True)
def _refine(cells, nodes, image, lines, R, distances):  # type: ignore[no-untyped-def]
    """(R, distances, whether they changed) by Gauss-Newton; the edges are looked for anew in each round."""
    errors = measure_errors(cells, nodes, R, distances)
    if errors[0] < LEAST_SLOW_ERROR:
        return R, distances, False
    gray, index, clutter, intrinsics = image
    normals, middles, lengths = lines
    distances, since_start = distances.copy(), np.zeros(8)
    for sigma_px, reach in _ROUNDS:
        of_depth, pull = depth_equations(cells, nodes, errors, R, distances)
        candidates = edge_candidates(gray, index, clutter, intrinsics, plane_rows(R, distances), reach)
        since_round = np.zeros(8)
        for _ in range(_STEPS):
            A, g = of_depth.copy(), pull - of_depth @ since_round
            _add_lines(normals, middles, lengths, R, A, g)
            add_edges(candidates, plane_rows(R, distances), intrinsics, sigma_px, A, g)
            step = _limited_step(A, g, since_start)
            R = rotate_rows(R, step[:3])
            for k in range(5):
                distances[k] *= np.exp(step[3 + k])
            since_start += step
            since_round += step
    return R, distances, True


@njit(cache=True, nogil=True)
def _limited_step(A, g, since_start):  # type: ignore[no-untyped-def]
    """Solve the equations, the start being a measurement too."""
    for k in range(8):
        precision = 1.0 / (_START_TURN_RAD if k < 3 else _START_SHIFT) ** 2
        A[k, k] += precision
        g[k] -= precision * since_start[k]
    step = np.linalg.solve(A, g)
    for k in range(8):
        largest = _LARGEST_TURN_RAD if k < 3 else _LARGEST_SHIFT
        step[k] = min(max(step[k], -largest), largest)
    return step


@njit(cache=True, nogil=True)
def _add_lines(normals, middles, lengths, R, A, g):  # type: ignore[no-untyped-def]
    """Add to the equations that each segment along an axis aims at its vanishing point (Cauchy)."""
    for i in range(len(normals)):
        n, middle = normals[i], middles[i]
        axis, off, scale = -1, 1e9, 0.0
        for k in range(3):
            across = R[k, 0] * n[0] + R[k, 1] * n[1] + R[k, 2] * n[2]
            along = R[k, 0] * middle[0] + R[k, 1] * middle[1] + R[k, 2] * middle[2]
            per_sine = 1.0 / np.sqrt(max(1.0 - along * along, 1e-3))
            if abs(across * per_sine) < abs(off):
                axis, off, scale = k, across * per_sine, per_sine
        sigma = np.sqrt(_LINE_SIGMA_RAD**2 + (_LINE_END_PX / lengths[i]) ** 2)
        if abs(off) > _LINE_TOLERANCE_RAD + 2.0 * sigma:
            continue
        weight = 1.0 / (sigma * sigma + (off / _LINE_CAUCHY_SIGMAS) ** 2)
        gradient = cross(R[axis], n)
        for a in range(3):
            g[a] -= weight * scale * gradient[a] * off
            for b in range(3):
                A[a, b] += weight * scale * scale * gradient[a] * gradient[b]
