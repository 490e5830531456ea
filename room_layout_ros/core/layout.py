"""The room cuboid: faces, raster, polygons, expected depth (docs/method.md, section 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frame import CameraIntrinsics
from .labels import FACES, FRONT_FACE, N_FACES

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
        distances where the scale is unknown: `at_unit_scale`); +inf where a face is not in view. All above 0.

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
        if R.shape != (3, 3) or not is_rotation(R):
            raise ValueError(f"R_room_camera is {R.tolist()}; it must be a rotation matrix")

    @property
    def inverse_normals(self) -> NDArray[np.float64]:
        """(5, 3) n_k / d_k in the camera frame: the face of ray r is argmax_k (n_k / d_k) . r."""
        return np.asarray(plane_rows(self.R_room_camera, self.distances))

    def at_unit_scale(self) -> RoomCuboid:
        """Return the room with the front wall at 1; where none is in view the farthest face is there."""
        front = self.distances[FRONT_FACE]
        unit = front if np.isfinite(front) else self.distances[np.isfinite(self.distances)].max(initial=0.0)
        return RoomCuboid(self.R_room_camera, self.distances / unit) if unit > 0.0 else self

    def in_view(self, pixels: NDArray[np.int64]) -> RoomCuboid:
        """Return the room without the faces of which there is no pixel; `pixels` of `view`."""
        return RoomCuboid(self.R_room_camera, np.where(pixels[1:] > 0, self.distances, np.inf))

    def raster(self, camera: CameraIntrinsics) -> NDArray[np.uint8]:
        """Return the layout image: (H, W) uint8, face ids 1..5 (0 where no finite face is hit)."""
        return self.view(camera)[0]

    def view(self, camera: CameraIntrinsics) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Return `raster` and how many pixels each id has in it, (6,) int64."""
        layout, pixels = _raster(self._rows(camera), camera.height, camera.width)
        return layout, pixels

    def depth(self, camera: CameraIntrinsics) -> NDArray[np.float32]:
        """Return the empty room's depth: (H, W) float32 along the optical axis, inf where nothing is hit."""
        return np.asarray(_depth(self._rows(camera), camera.height, camera.width))

    def _rows(self, camera: CameraIntrinsics) -> NDArray[np.float64]:
        """(5, 3) m_k: the inverse depth of face k at pixel (x, y) is m_k . (x, y, 1)."""
        return pixel_rows(self.inverse_normals, camera)

    def polygons(self, camera: CameraIntrinsics) -> tuple[FacePolygon, ...]:
        """Return the visible part of each face, in the order of their ids."""
        m, found = self._rows(camera), []
        numbers = camera.numbers
        for k in range(N_FACES):
            if np.isfinite(self.distances[k]):
                pixels, points = _polygon(m, k, camera.width, camera.height, numbers)
                normal = -FACE_SIGN[k] * self.R_room_camera[FACE_AXIS[k]]
                if len(pixels) >= 3:
                    found.append(FacePolygon(FACES[k], pixels, points, normal, float(self.distances[k])))
        return tuple(found)


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


def pixel_rows(rows: NDArray[np.float64], camera: CameraIntrinsics) -> NDArray[np.float64]:
    """(n, 3) rows K^-1: what rows (n, 3) say of a ray of the camera, for the pixel (x, y, 1)."""
    x, y = rows[:, 0] / camera.fx, rows[:, 1] / camera.fy
    return np.stack([x, y, rows[:, 2] - x * camera.cx - y * camera.cy], axis=1)


@njit(cache=True, nogil=True)
def plane_rows(R, distances):  # type: ignore[no-untyped-def]
    """(5, 3) n_k / d_k of the five faces, n_k outward."""
    m = np.empty((5, 3))
    for j in range(3):
        m[0, j] = -R[1, j] / distances[0]
        m[1, j] = R[1, j] / distances[1]
        m[2, j] = -R[0, j] / distances[2]
        m[3, j] = R[2, j] / distances[3]
        m[4, j] = R[0, j] / distances[4]
    return m


@njit(cache=True, nogil=True, inline="always")
def face_of_ray(m, x, y, z, least):  # type: ignore[no-untyped-def]
    """(face 0..4 hit by the ray through (x, y, z), -1 for none; m . (x, y, z) of it), for rows m; above `least`."""
    best, face = least, -1
    for k in range(5):
        value = m[k, 0] * x + m[k, 1] * y + m[k, 2] * z
        if value > best:
            best, face = value, k
    return face, best


@njit(cache=True, nogil=True)
def is_rotation(R):  # type: ignore[no-untyped-def]
    """Whether a 3 x 3 matrix turns and does nothing else, to about 1e-6; a NaN does not."""
    for i in range(3):
        for j in range(3):
            dot = R[i, 0] * R[j, 0] + R[i, 1] * R[j, 1] + R[i, 2] * R[j, 2]
            if not abs(dot - (1.0 if i == j else 0.0)) <= (1e-5 if i == j else 1e-6):
                return False
    minor0 = R[1, 1] * R[2, 2] - R[1, 2] * R[2, 1]
    minor1 = R[1, 0] * R[2, 2] - R[1, 2] * R[2, 0]
    minor2 = R[1, 0] * R[2, 1] - R[1, 1] * R[2, 0]
    return R[0, 0] * minor0 - R[0, 1] * minor1 + R[0, 2] * minor2 > 0.0


@njit(cache=True, nogil=True)
def _clip(polygon, a, b, c):  # type: ignore[no-untyped-def]
    """The part of a convex polygon (n, 2) where a x + b y + c >= 0 (Sutherland-Hodgman)."""
    kept, n = np.empty((len(polygon) + 2, 2)), 0
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        here, there = a * polygon[i, 0] + b * polygon[i, 1] + c, a * polygon[j, 0] + b * polygon[j, 1] + c
        if here >= 0.0:
            kept[n] = polygon[i]
            n += 1
        if (here >= 0.0) != (there >= 0.0):
            share = here / (here - there)
            kept[n, 0] = polygon[i, 0] + share * (polygon[j, 0] - polygon[i, 0])
            kept[n, 1] = polygon[i, 1] + share * (polygon[j, 1] - polygon[i, 1])
            n += 1
    return kept[:n]


@njit(cache=True, nogil=True)
def _polygon(m, k, width, height, camera):  # type: ignore[no-untyped-def]
    """Corners (n, 2) in the image of what is seen of face k, and (n, 3) on its plane in the camera frame."""
    fx, fy, cx, cy = camera
    right, bottom = width - 0.5, height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    for other in range(N_FACES):
        if other != k:
            corners = _clip(corners, m[k, 0] - m[other, 0], m[k, 1] - m[other, 1], m[k, 2] - m[other, 2])
    corners = _clip(corners, m[k, 0], m[k, 1], m[k, 2])  # in front of the plane, not at infinity
    points = np.empty((len(corners), 3))
    for i in range(len(corners)):
        x, y = corners[i, 0], corners[i, 1]
        z = 1.0 / max(m[k, 0] * x + m[k, 1] * y + m[k, 2], _MIN_POLYGON_DEPTH)
        points[i, 0], points[i, 1], points[i, 2] = (x - cx) / fx * z, (y - cy) / fy * z, z
    return corners, points


@njit(cache=True, nogil=True, inline="always")
def _face_at(m, x, y):  # type: ignore[no-untyped-def]
    """(Face id 1..5 of pixel (x, y), inverse depth there); 0 where no face is hit."""
    face, best = face_of_ray(m, x, y, 1.0, 0.0)
    return face + 1, best


@njit(cache=True, nogil=True)
def _run_end(m, x, y, face, width):  # type: ignore[no-untyped-def]
    """First x after which `face`, that of pixel (x, y), is not seen in the row again: each face is one run of it."""
    mine, slope = (0.0, 0.0) if face == 0 else (m[face - 1, 1] * y + m[face - 1, 2], m[face - 1, 0])
    end = float(width)
    for k in range(-1, 5):
        rise, other = (-slope, 0.0) if k < 0 else (m[k, 0] - slope, m[k, 1] * y + m[k, 2])
        if rise > 0.0:
            end = min(end, (mine - other) / rise)
    at = min(max(int(end), x + 1), width)
    while at > x + 1 and _face_at(m, at - 1, y)[0] != face:
        at -= 1
    while at < width and _face_at(m, at, y)[0] == face:
        at += 1
    return at


@njit(cache=True, nogil=True)
def _raster(m, height, width):  # type: ignore[no-untyped-def]
    """Face id of each pixel, and pixels per id."""
    faces, pixels = np.empty((height, width), np.uint8), np.zeros(6, np.int64)
    for y in range(height):
        x = 0
        while x < width:
            face = _face_at(m, x, y)[0]
            end = _run_end(m, x, y, face, width)
            faces[y, x:end] = face
            pixels[face] += end - x
            x = end
    return faces, pixels


@njit(cache=True, nogil=True)
def _depth(m, height, width):  # type: ignore[no-untyped-def]
    depth = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            best = _face_at(m, x, y)[1]
            depth[y, x] = 1.0 / best if best > 0.0 else np.inf
    return depth
