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
from .layout import RoomCuboid

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
        result: NDArray[np.float64] = self.R_room_camera @ np.linalg.inv(self.camera.matrix)
        return result

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
    if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6):
        raise ValueError(f"R_room_camera is {R.tolist()}; it must be a rotation matrix")
    dx, dy, dz = _sample_rays(camera, R)
    horizontal, vertical = np.abs(dx), np.abs(dy)
    masks = (dy < 0, dy >= 0, dx < 0, dx >= 0)
    sides = [
        _side_states(magnitude[mask], dz[mask], 2 * rays * int(np.count_nonzero(mask)) // mask.size)
        for mask, magnitude in zip(masks, (vertical, vertical, horizontal, horizontal), strict=True)
    ]
    angle = horizontal / np.maximum(horizontal + vertical, 1e-12)
    quadrant = 2 * masks[1] + masks[3]
    edges = [_angle_edges(angle[quadrant == q], angle_bins, angle.size) for q in range(N_QUADRANTS)]
    widest = max(len(e) for e in edges)
    slopes = np.full((N_QUADRANTS, widest - 1), np.inf)
    padded = np.ones((N_QUADRANTS, widest))
    for q, e in enumerate(edges):
        padded[q, : len(e)] = e
        slopes[q, : len(e) - 1] = e[:-1] / (1.0 - e[:-1])
    states = np.full((N_SIDES, max(len(s) for s in sides)), np.inf)
    for side, s in enumerate(sides):
        states[side, : len(s)] = s
    corners = [
        _corners(sides[QUADRANT_VERTICAL[q]], sides[QUADRANT_HORIZONTAL[q]], edges[q]) for q in range(N_QUADRANTS)
    ]
    return RayGrid(
        camera=camera,
        R_room_camera=R,
        states=states,
        state_counts=np.array([len(s) for s in sides], dtype=np.int64),
        slopes=slopes,
        edges=padded,
        bin_counts=np.array([len(e) - 1 for e in edges], dtype=np.int64),
        corner_bin=tuple(c[0] for c in corners),
        corner_share=tuple(c[1] for c in corners),
    )


@njit(cache=True, nogil=True)
def _corners(vertical, horizontal, edges):  # type: ignore[no-untyped-def]
    """Angle bin and share of every corner t(i, j) = a_j / (a_i + a_j)."""
    n_i, n_j = len(vertical), len(horizontal)
    bins = np.empty((n_i, n_j), np.int64)
    share = np.empty((n_i, n_j))
    for j in range(n_j):
        t = len(edges) - 2
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


def _sample_rays(
    camera: CameraIntrinsics, R: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    steps = np.arange(_SAMPLES) / (_SAMPLES - 1)
    shear = (steps - 0.5) / _SAMPLES  # so that no two samples share a column, a row or, with axes upright, a state
    x = (steps + shear[:, None]) * camera.width - 0.5
    y = (steps[:, None] + shear) * camera.height - 0.5
    m = R @ np.linalg.inv(camera.matrix)
    rays = m[:, 0, None, None] * x + m[:, 1, None, None] * y + m[:, 2, None, None]
    return rays[0].ravel(), rays[1].ravel(), rays[2].ravel()


def _side_states(magnitude: NDArray[np.float64], dz: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(n,) ascending states of one side, +inf last."""
    seen = dz > 0
    slopes = np.sort(magnitude[seen] / dz[seen])
    slopes = slopes[: np.searchsorted(slopes, _MAX_SLOPE)]
    if count < 1 or len(slopes) < 2:
        return np.array([np.inf])
    positions = (np.arange(count) + 0.5) / count * (len(slopes) - 1)
    inside = np.interp(positions, np.arange(len(slopes)), slopes)
    near = np.geomspace(_NEAR, slopes[0], _NEAR_STATES, endpoint=False) if slopes[0] > 2 * _NEAR else np.empty(0)
    states = np.unique(np.concatenate([near, np.maximum(inside, 1e-4)]))
    return np.append(states, np.inf)


def _angle_edges(angle: NDArray[np.float64], bins: int, samples: int) -> NDArray[np.float64]:
    """(m + 1,) edges of t from 0 to 1 with about the same number of pixels between neighbours."""
    if len(angle) < 2:
        return np.array([0.0, 1.0])
    count = max(_MIN_ANGLE_BINS, round(bins * len(angle) / samples))
    ordered = np.sort(angle)
    inner = np.interp(np.arange(count + 1) / count * (len(ordered) - 1), np.arange(len(ordered)), ordered)
    inner = np.unique(inner)
    inner = inner[(inner > 1e-6) & (inner < 1.0 - 1e-6)]
    return np.concatenate([[0.0], inner, [1.0]])
