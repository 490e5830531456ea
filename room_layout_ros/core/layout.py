"""The room cuboid: faces, raster, polygons, expected depth (docs/method.md, section 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics
from .labels import FACES, N_FACES

FACE_AXIS = np.array([1, 1, 0, 2, 0])
"""Room axis (0 X, 1 Y, 2 Z) of each face in the order of `labels.FACES`."""

FACE_SIGN = np.array([-1.0, 1.0, -1.0, 1.0, 1.0])
"""Side of the camera on which each face lies along its axis."""

_MIN_POLYGON_DEPTH = 1e-3


@dataclass(frozen=True, slots=True)
class RoomCuboid:
    """A room around the camera, aligned with the rows of `R_room_camera`.

    Parameters
    ----------
    R_room_camera : (3, 3) float64 array
        Rows are the room's axes in the camera frame: X right, Y down, Z towards the front wall.
    distances : (5,) float64 array
        Distance of the camera to ceiling, floor, left, front and right plane, in metres (in front-wall
        distances where the scale is unknown); +inf where a face is not in view. All above 0.

    Raises
    ------
    ValueError
        When a distance is not above 0 or the matrix is not a rotation.
    """

    R_room_camera: NDArray[np.float64]
    distances: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.distances.shape != (N_FACES,) or not (self.distances > 0).all():
            raise ValueError(f"plane distances are {self.distances}; five values above 0 are needed")
        R = self.R_room_camera
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise ValueError(f"R_room_camera is {R.tolist()}; it must be a rotation matrix")

    @property
    def inverse_normals(self) -> NDArray[np.float64]:
        """(5, 3) n_k / d_k in the camera frame: the face of ray r is argmax_k (n_k / d_k) . r."""
        return FACE_SIGN[:, None] * self.R_room_camera[FACE_AXIS] / self.distances[:, None]

    def raster(self, camera: CameraIntrinsics) -> NDArray[np.uint8]:
        """Return the layout image: (H, W) uint8, face ids 1..5 (0 where no finite face is hit)."""
        return self._cast(camera)[0]

    def depth(self, camera: CameraIntrinsics) -> NDArray[np.float32]:
        """Return the empty room's depth: (H, W) float32 along the optical axis, inf where nothing is hit."""
        return self._cast(camera)[1]

    def _cast(self, camera: CameraIntrinsics) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        m = self.inverse_normals @ np.linalg.inv(camera.matrix)
        return _cast(m, camera.height, camera.width)

    def polygons(self, camera: CameraIntrinsics) -> tuple[FacePolygon, ...]:
        """Return the visible part of each face, in the order of their ids."""
        return tuple(p for k in range(N_FACES) if (p := self._polygon(k, camera)) is not None)

    def _polygon(self, k: int, camera: CameraIntrinsics) -> FacePolygon | None:
        if not np.isfinite(self.distances[k]):
            return None
        m = self.inverse_normals @ np.linalg.inv(camera.matrix)
        right, bottom = camera.width - 0.5, camera.height - 0.5
        corners = np.array([[-0.5, -0.5, 1.0], [right, -0.5, 1.0], [right, bottom, 1.0], [-0.5, bottom, 1.0]])
        for other in range(N_FACES):
            if other != k:
                corners = _clip(corners, m[k] - m[other])
        corners = _clip(corners, m[k])  # in front of the plane, not at infinity
        if len(corners) < 3:
            return None
        inverse_depth = np.maximum(corners @ m[k], _MIN_POLYGON_DEPTH)
        points = (corners @ np.linalg.inv(camera.matrix).T) / inverse_depth[:, None]
        normal = -FACE_SIGN[k] * self.R_room_camera[FACE_AXIS[k]]
        return FacePolygon(FACES[k], corners[:, :2].copy(), points, normal, float(self.distances[k]))


@dataclass(frozen=True, slots=True)
class FacePolygon:
    """The visible part of one face of the room.

    Attributes
    ----------
    face : label id 1..5.
    pixels : (n, 2) float64 corners (x, y) in the image, n >= 3; pixel centres at integers.
    points_m : (n, 3) float64 the same corners on the plane, camera optical frame (at most 1 km away).
    normal : (3,) unit normal towards the camera. distance : of the camera to the plane.
    """

    face: int
    pixels: NDArray[np.float64]
    points_m: NDArray[np.float64]
    normal: NDArray[np.float64]
    distance: float


def _clip(polygon: NDArray[np.float64], line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep the part of a convex polygon (n, 3 homogeneous, last = 1) where line . p >= 0 (Sutherland-Hodgman)."""
    side = polygon @ line
    kept = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if side[i] >= 0:
            kept.append(polygon[i])
        if (side[i] >= 0) != (side[j] >= 0):
            t = side[i] / (side[i] - side[j])
            kept.append(polygon[i] + t * (polygon[j] - polygon[i]))
    return np.array(kept).reshape(-1, 3)


@njit(cache=True, nogil=True)
def _cast(m, height, width):  # type: ignore[no-untyped-def]
    faces = np.zeros((height, width), np.uint8)
    depth = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            best, face = 0.0, 0
            for k in range(5):
                value = m[k, 0] * x + m[k, 1] * y + m[k, 2]
                if value > best:
                    best, face = value, k + 1
            faces[y, x] = face
            depth[y, x] = 1.0 / best if best > 0.0 else np.inf
    return faces, depth
