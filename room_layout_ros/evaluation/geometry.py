"""How wrong is an estimate in the image's corners and in metres: corners, planes, rooms, free space."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, HalfspaceIntersection

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import N_FACES
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid
from room_layout_ros.core.room_axes import angle_between_axes

MISSING_CORNER = 0.3
"""Error of a corner without a partner, in image diagonals; no pair counts more than this."""


def layout_corners(layout: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the corners of a layout image as (n, 2) float64 (x, y).

    A corner is where three faces meet in the image, or two at its border. Junctions closer than 5 px (the
    staircase of a raster) count once.
    """
    padded = np.pad(layout.astype(np.int16), 1, constant_values=-1)
    shifts = [padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]]
    four = np.sort(np.stack(shifts, axis=-1), axis=-1)
    distinct = 1 + (np.diff(four, axis=-1) != 0).sum(axis=-1)
    junction = (distinct >= 3).astype(np.uint8)  # the outside (-1) is the third face at the border
    _, index = cv2.connectedComponents(cv2.dilate(junction, np.ones((5, 5), np.uint8)))
    ys, xs = np.nonzero(junction)
    groups = index[ys, xs]
    count = np.bincount(groups)[1:]
    centre = [np.bincount(groups, v - 0.5)[1:] / np.maximum(count, 1) for v in (xs, ys)]
    return np.stack(centre, axis=1)[count > 0].astype(np.float64)


def corner_error(true_layout: NDArray[np.uint8], layout: NDArray[np.uint8]) -> float:
    """Return the mean distance of matched corners in image diagonals; wall names do not matter.

    Corners are matched one to one at the least total cost; a corner without a partner costs
    `MISSING_CORNER`. 0 when neither image has a corner.

    Raises
    ------
    ValueError
        When the shapes differ.
    """
    if true_layout.shape != layout.shape:
        raise ValueError(f"layouts have shapes {true_layout.shape} and {layout.shape}; they must be the same")
    a, b = layout_corners(true_layout), layout_corners(layout)
    n = max(len(a), len(b))
    if n == 0:
        return 0.0
    cost = np.full((n, n), MISSING_CORNER)
    distance = np.linalg.norm(a[:, None] - b[None], axis=2) / np.hypot(*layout.shape)
    cost[: len(a), : len(b)] = np.minimum(distance, MISSING_CORNER)
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].mean())


@dataclass(frozen=True, slots=True)
class PlaneErrors:
    """Per face in the order of `labels.FACES`; NaN where the truth or the estimate has no such face.

    Attributes
    ----------
    offset_m : (5,) |difference of the distances to the camera|. angle_deg : (5,) between the normals.
    """

    offset_m: NDArray[np.float64]
    angle_deg: NDArray[np.float64]


def plane_errors(truth: RoomCuboid, estimate: RoomCuboid, wall_names: tuple[int, ...] | None = None) -> PlaneErrors:
    """Compare the planes of two rooms seen by the same camera, the estimate's walls renamed by `wall_names`."""
    offset, angle = np.full(N_FACES, np.nan), np.full(N_FACES, np.nan)
    for k in range(N_FACES):
        true_k = k if wall_names is None else wall_names[k + 1] - 1
        distance, true_distance = estimate.distances[k], truth.distances[true_k]
        if not (np.isfinite(distance) and np.isfinite(true_distance)):
            continue
        offset[true_k] = abs(distance - true_distance)
        cosine = _outward(estimate)[k] @ _outward(truth)[true_k]
        angle[true_k] = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return PlaneErrors(offset, angle)


def axes_error_deg(R_true: NDArray[np.float64], R: NDArray[np.float64]) -> float:
    """Return the angle between two Manhattan frames in degrees, modulo the cube's 24 rotations."""
    return float(np.degrees(angle_between_axes(R_true, R)))


def room_iou(truth: RoomCuboid, estimate: RoomCuboid, camera: CameraIntrinsics, reach_m: float = 10.0) -> float:
    """Return the exact volume IoU of two rooms inside the camera's view, up to `reach_m` along the optical axis.

    Nothing is known of what lies out of view, and which wall is called front has no say in what lies in it.
    """
    view = _view(camera, reach_m)
    a, b = np.vstack([_halfspaces(truth), view]), np.vstack([_halfspaces(estimate), view])
    both = _volume(np.vstack([a, b]), camera)
    return both / (_volume(a, camera) + _volume(b, camera) - both)


def grid_iou(truth: NDArray[np.bool_], estimate: NDArray[np.bool_]) -> float:
    """Return the IoU of two boolean grids (free space); NaN when both are empty.

    Raises
    ------
    ValueError
        When the shapes differ.
    """
    if truth.shape != estimate.shape:
        raise ValueError(f"grids have shapes {truth.shape} and {estimate.shape}; they must be the same")
    union = np.count_nonzero(truth | estimate)
    return float(np.count_nonzero(truth & estimate) / union) if union else float("nan")


def _outward(room: RoomCuboid) -> NDArray[np.float64]:
    return np.asarray(FACE_SIGN[:, None] * room.R_room_camera[FACE_AXIS])


def _halfspaces(room: RoomCuboid) -> NDArray[np.float64]:
    """Rows (n, -d) of the planes in view: inside is n . p <= d."""
    seen = np.isfinite(room.distances)
    return np.hstack([_outward(room)[seen], -room.distances[seen, None]])


def _view(camera: CameraIntrinsics, reach_m: float) -> NDArray[np.float64]:
    left, right, top, bottom = _edges(camera)
    return np.array(
        [[-1, 0, left, 0], [1, 0, -right, 0], [0, -1, top, 0], [0, 1, -bottom, 0], [0, 0, 1, -reach_m]], np.float64
    )


def _edges(camera: CameraIntrinsics) -> tuple[float, float, float, float]:
    """X/Z of the image's left and right edge, Y/Z of its top and bottom; pixel centres are at integers."""
    x = (np.array([-0.5, camera.width - 0.5]) - camera.cx) / camera.fx
    y = (np.array([-0.5, camera.height - 0.5]) - camera.cy) / camera.fy
    return float(x[0]), float(x[1]), float(y[0]), float(y[1])


def _volume(halfspaces: NDArray[np.float64], camera: CameraIntrinsics) -> float:
    left, right, top, bottom = _edges(camera)
    ahead = np.array([(left + right) / 2, (top + bottom) / 2, 1.0])
    ahead /= np.linalg.norm(ahead)
    # The camera is the apex of the view; nearer than every plane of the room, the middle ray is inside of all.
    nearest = -halfspaces[halfspaces[:, 3] < 0, 3].max()
    corners = HalfspaceIntersection(halfspaces, 0.5 * nearest * ahead).intersections
    return float(ConvexHull(corners).volume)
