"""The discrete layouts of one view: states of the four rays and bins of the corner angle (docs/method.md, section 7).

The signs of a pixel's ray (dx, dy) in room axes put it into one of four *quadrants*, and a quadrant meets one side
wall, one of ceiling and floor, and the front wall only. So the face of a pixel depends on one pair of parameters, and
the cost of a layout is the sum of four pair tables: upper left (y1, y3), upper right (y1, y4), lower left (y2, y3),
lower right (y2, y4). Within a quadrant the parameters are used by magnitude: a = |y|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics
from .labels import CEILING, FLOOR, LEFT_WALL, RIGHT_WALL
from .layout import RoomCuboid, is_rotation, pixel_rows

QUADRANT_VERTICAL = (0, 0, 1, 1)
"""Side (0 ceiling y1, 1 floor y2) that bounds each quadrant vertically."""

QUADRANT_HORIZONTAL = (2, 3, 2, 3)
"""Side (2 left y3, 3 right y4) that bounds each quadrant horizontally."""

SIDE_FACE = (CEILING, FLOOR, LEFT_WALL, RIGHT_WALL)
"""Face beyond each of the four rays."""

N_SIDES = 4
N_QUADRANTS = 4

_SAMPLES = 64
_MAX_SLOPE = 20.0
_NEAR = 0.02
_NEAR_STATES = 6
_MIN_ANGLE_BINS = 8


@dataclass(frozen=True, slots=True)
class RayGrid:
    """States of the four rays and angle bins of the four quadrants, fixed for one camera pose.

    Attributes
    ----------
    camera : CameraIntrinsics
    R_room_camera : (3, 3) float64, rows X right, Y down, Z front in the camera frame.
    states : (4, n) float64, |y| of ceiling, floor, left, right, ascending; the last used state and the padding are
        +inf: the face is absent.
    state_counts : (4,) int64, states used per side, the absent one included; at least 1.
    slopes : (4, m) float64, |dx|/|dy| at the lower edge of each angle bin per quadrant, ascending from 0, padded with
        inf.
    edges : (4, m + 1) float64, the same edges as t = |dx|/(|dx|+|dy|) from 0 to 1, padded with 1.
    bin_counts : (4,) int64, angle bins per quadrant, at least 1.
    corner_bin, corner_share : per quadrant (n_i, n_j) int64 and float64, angle bin of the corner of each pair of
        states, and the share of that bin on the side wall's part.
    """

    camera: CameraIntrinsics
    R_room_camera: NDArray[np.float64]
    states: NDArray[np.float64]
    state_counts: NDArray[np.int64]
    slopes: NDArray[np.float64]
    edges: NDArray[np.float64]
    bin_counts: NDArray[np.int64]
    corner_bin: tuple[NDArray[np.int64], ...]
    corner_share: tuple[NDArray[np.float64], ...]

    @property
    def ray_matrix(self) -> NDArray[np.float64]:
        """(3, 3) R K^-1: the ray (dx, dy, dz) in room axes of pixel (x, y, 1)."""
        return pixel_rows(self.R_room_camera, self.camera)

    def side_states(self, side: int) -> NDArray[np.float64]:
        """(n,) |y| of one side, ascending, the last +inf."""
        return self.states[side, : self.state_counts[side]]

    def cuboid(self, layout: tuple[int, int, int, int], scale: float = 1.0) -> RoomCuboid:
        """Return the room of four state indices (ceiling, floor, left, right) with the front wall at `scale`.

        Raises
        ------
        ValueError
            When an index is not a state of its side.
        """
        for side, state in enumerate(layout):
            if not 0 <= state < self.state_counts[side]:
                raise ValueError(
                    f"layout {layout} has no state {state} on side {side}; "
                    f"allowed is 0 to {self.state_counts[side] - 1}"
                )
        ceiling, floor, left, right = (self.states[side, state] * scale for side, state in enumerate(layout))
        return RoomCuboid(self.R_room_camera, np.array([ceiling, floor, left, scale, right]))

    def nearest(self, cuboid: RoomCuboid) -> tuple[int, int, int, int]:
        """Return the state indices nearest to a room with these axes (by state number, so uniformly in the image)."""
        ceiling, floor, left, front, right = cuboid.distances
        values = (ceiling / front, floor / front, left / front, right / front)
        return tuple(_nearest(self.side_states(side), value) for side, value in enumerate(values))  # type: ignore[return-value]


def _nearest(states: NDArray[np.float64], value: float) -> int:
    if len(states) == 1 or not np.isfinite(value):
        return len(states) - 1
    finite = states[:-1]
    if len(finite) > 1 and value > finite[-1] + 0.5 * (finite[-1] - finite[-2]):
        return len(states) - 1
    return int(np.abs(finite - value).argmin())


def compute_ray_grid(
    camera: CameraIntrinsics, R_room_camera: NDArray[np.float64], rays: int = 50, angle_bins: int = 320
) -> RayGrid:
    """Place the states so that neighbouring face borders enclose about the same number of pixels everywhere.

    The states of a side are the quantiles of |u| or |v| over the image's pixels on that side, which needs no case for
    vanishing points inside, outside or at infinity. Where the horizon of a side is out of view, a few states nearer
    than the image are added: their corner is not seen, but the border that runs from it may be.

    Parameters
    ----------
    camera : CameraIntrinsics
    R_room_camera : (3, 3) float64 array
        Rows are the room's axes in the camera frame.
    rays : int
        States per ray, on average over the two sides of an axis: `2 rays` are shared by the sides' pixels.
    angle_bins : int
        Bins of the corner angle, shared by the four quadrants' pixels.

    Raises
    ------
    ValueError
        When a number is out of range or the matrix is no rotation.
    """
    if not 2 <= rays <= 400 or not 8 <= angle_bins <= 4096:
        raise ValueError(f"ray grid of {rays} rays and {angle_bins} angle bins; allowed are 2 to 400 and 8 to 4096")
    R = np.asarray(R_room_camera, dtype=np.float64)
    if R.shape != (3, 3) or not is_rotation(R):
        raise ValueError(f"R_room_camera is {R.tolist()}; it must be a rotation matrix")
    magnitudes, seen, angles, in_quadrant, on_side = _sample_rays(pixel_rows(R, camera), camera.width, camera.height)
    for side in range(N_SIDES):
        magnitudes[side, : seen[side]].sort()
    for q in range(N_QUADRANTS):
        angles[q, : in_quadrant[q]].sort()
    return RayGrid(camera, R, *_place(magnitudes, seen, on_side, rays, angles, in_quadrant, angle_bins))


@njit(cache=True, nogil=True, error_model="numpy")
def _place(magnitudes, seen, on_side, rays, angles, in_quadrant, angle_bins):  # type: ignore[no-untyped-def]
    """What `RayGrid` holds besides camera and pose, from the sorted samples."""
    states, state_counts = _place_states(magnitudes, seen, 2 * rays * on_side // _SAMPLES**2)
    edges, bin_counts = _place_edges(angles, in_quadrant, angle_bins)
    slopes = np.full((4, edges.shape[1] - 1), np.inf)
    for q in range(4):
        for t in range(bin_counts[q]):
            slopes[q, t] = edges[q, t] / (1.0 - edges[q, t])
    c0, s0 = _corners(states[0], state_counts[0], states[2], state_counts[2], edges[0], bin_counts[0])
    c1, s1 = _corners(states[0], state_counts[0], states[3], state_counts[3], edges[1], bin_counts[1])
    c2, s2 = _corners(states[1], state_counts[1], states[2], state_counts[2], edges[2], bin_counts[2])
    c3, s3 = _corners(states[1], state_counts[1], states[3], state_counts[3], edges[3], bin_counts[3])
    return states, state_counts, slopes, edges, bin_counts, (c0, c1, c2, c3), (s0, s1, s2, s3)


@njit(cache=True, nogil=True, error_model="numpy")
def _corners(vertical, n_i, horizontal, n_j, edges, n_t):  # type: ignore[no-untyped-def]
    """Angle bin and share of every corner t(i, j) = a_j / (a_i + a_j)."""
    bins = np.empty((n_i, n_j), np.int64)
    share = np.empty((n_i, n_j))
    for j in range(n_j):
        t = n_t - 1
        for i in range(n_i):  # t(i, j) falls as a_i grows
            if np.isinf(horizontal[j]):
                corner = 0.5 if np.isinf(vertical[i]) else 1.0  # nothing lies beyond two absent faces
            else:
                corner = horizontal[j] / (vertical[i] + horizontal[j])
            while t > 0 and corner < edges[t]:
                t -= 1
            bins[i, j] = t
            share[i, j] = (edges[t + 1] - corner) / (edges[t + 1] - edges[t])
    return bins, share


@njit(cache=True, nogil=True, error_model="numpy")
def _sample_rays(m, width, height):  # type: ignore[no-untyped-def]
    """|u| or |v| of sample pixels ahead per side, |dx| / (|dx| + |dy|) of all per quadrant, and how many there are."""
    magnitudes, angles = np.empty((4, _SAMPLES**2)), np.empty((4, _SAMPLES**2))
    seen, in_quadrant, on_side = np.zeros(4, np.int64), np.zeros(4, np.int64), np.zeros(4, np.int64)
    for row in range(_SAMPLES):
        for column in range(_SAMPLES):
            # sheared, so that no two samples share a column, a row or, with axes upright, a state
            u, v = column / (_SAMPLES - 1), row / (_SAMPLES - 1)
            x, y = (u + (v - 0.5) / _SAMPLES) * width - 0.5, (v + (u - 0.5) / _SAMPLES) * height - 0.5
            dx, dy = m[0, 0] * x + m[0, 1] * y + m[0, 2], m[1, 0] * x + m[1, 1] * y + m[1, 2]
            dz = m[2, 0] * x + m[2, 1] * y + m[2, 2]
            level, side = int(dy >= 0), 2 + int(dx >= 0)
            on_side[level] += 1
            on_side[side] += 1
            if dz > 0.0:
                magnitudes[level, seen[level]], magnitudes[side, seen[side]] = abs(dy) / dz, abs(dx) / dz
                seen[level] += 1
                seen[side] += 1
            q = 2 * level + side - 2
            angles[q, in_quadrant[q]] = abs(dx) / max(abs(dx) + abs(dy), 1e-12)
            in_quadrant[q] += 1
    return magnitudes, seen, angles, in_quadrant, on_side


@njit(cache=True, nogil=True)
def _quantile(ordered, count, share):  # type: ignore[no-untyped-def]
    """Value at a share, 0..1, of the way through the first `count` of ascending values."""
    position = share * (count - 1)
    low = min(int(position), count - 2)
    return ordered[low] + (ordered[low + 1] - ordered[low]) * (position - low)


@njit(cache=True, nogil=True)
def _append(values, n, value):  # type: ignore[no-untyped-def]
    """Append to ascending values what is above the last; return how many there are."""
    if n == 0 or value > values[n - 1]:
        values[n] = value
        return n + 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _place_states(magnitudes, seen, wanted):  # type: ignore[no-untyped-def]
    """(4, n) ascending states per side, padded with +inf, and how many each side uses, one +inf included."""
    states = np.full((4, wanted.max() + _NEAR_STATES + 1), np.inf)
    used = np.zeros(4, np.int64)
    for side in range(4):
        ordered = magnitudes[side]
        count, n = np.searchsorted(ordered[: seen[side]], _MAX_SLOPE), 0
        if wanted[side] >= 1 and count >= 2:
            if ordered[0] > 2 * _NEAR:
                for k in range(_NEAR_STATES):
                    n = _append(states[side], n, _NEAR * (ordered[0] / _NEAR) ** (k / _NEAR_STATES))
            for k in range(wanted[side]):
                n = _append(states[side], n, max(_quantile(ordered, count, (k + 0.5) / wanted[side]), 1e-4))
        used[side] = n + 1
    return states[:, : used.max()].copy(), used


@njit(cache=True, nogil=True, error_model="numpy")
def _place_edges(angles, in_quadrant, bins):  # type: ignore[no-untyped-def]
    """(4, m + 1) edges of t from 0 to 1 with about the same number of pixels between neighbours, padded with 1, and the
    bins that each quadrant uses.
    """
    edges = np.ones((4, max(bins, _MIN_ANGLE_BINS) + 3))
    used = np.ones(4, np.int64)
    for q in range(4):
        edges[q, 0] = 0.0
        if in_quadrant[q] < 2:
            continue
        count, n = max(_MIN_ANGLE_BINS, int(np.rint(bins * in_quadrant[q] / _SAMPLES**2))), 1
        for k in range(count + 1):
            edge = _quantile(angles[q], in_quadrant[q], k / count)
            if 1e-6 < edge < 1.0 - 1e-6:
                n = _append(edges[q], n, edge)
        edges[q, n] = 1.0
        used[q] = n
    return edges[:, : used.max() + 1].copy(), used
