"""The room as a cuboid: one rule gives raster, polygons and depth, for every way to look at it."""

from __future__ import annotations

import cv2
import naive_room
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import ROOM, SMALL, TINY, look, seen_from_inside

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid

OUT_OF_VIEW = np.array([np.inf, 1.3, np.inf, 3.5, 2.2])
VIEWS = [
    ("ahead", look(), ROOM),
    ("turned", look(33, 10, 2), ROOM),
    ("corner", look(-45, 0, 0), ROOM),
    ("to the floor", look(5, 70, 0), ROOM),
    ("to the ceiling", look(100, -60, -20), ROOM),
    ("two faces missing", look(20, 5, 0), OUT_OF_VIEW),
    ("only the front", look(10, 0, 0), np.array([np.inf, np.inf, np.inf, 2.0, np.inf])),
    ("nothing at all", look(), np.full(5, np.inf)),
]
every_view = pytest.mark.parametrize(("R", "distances"), [v[1:] for v in VIEWS], ids=[v[0] for v in VIEWS])


@every_view
def test_raster_and_depth_equal_walking_each_ray_to_the_planes(
    R: NDArray[np.float64], distances: NDArray[np.float64]
) -> None:
    room = RoomCuboid(R, distances)
    faces, depth = naive_room.cast(R, distances, TINY)
    tied = np.zeros(faces.shape, bool)  # a pixel on an edge of the room is on both faces
    different = room.raster(TINY) != faces
    np.testing.assert_allclose(room.depth(TINY), depth, rtol=1e-5)
    for y, x in np.argwhere(different):
        values = np.sort(room.inverse_normals @ naive_room.ray_of(TINY, x, y))
        tied[y, x] = values[-1] - values[-2] < 1e-12
    assert (different == tied).all()
    assert different.sum() < 20


@every_view
def test_a_face_at_infinity_is_nowhere_and_rays_that_hit_nothing_are_infinitely_long(
    R: NDArray[np.float64], distances: NDArray[np.float64]
) -> None:
    room = RoomCuboid(R, distances)
    raster, depth = room.raster(SMALL), room.depth(SMALL)
    absent = np.flatnonzero(np.isinf(distances)) + 1
    assert not np.isin(raster, absent).any()
    assert (np.isinf(depth) == (raster == 0)).all()
    assert not {p.face for p in room.polygons(SMALL)} & set(absent.tolist())


@every_view
def test_points_at_the_rooms_depth_lie_on_the_plane_of_their_face_and_inside_all_others(
    R: NDArray[np.float64], distances: NDArray[np.float64]
) -> None:
    room = RoomCuboid(R, distances)
    raster = room.raster(SMALL)
    seen = (raster > 0) & (room.depth(SMALL) < 100)
    points = SMALL.rays()[seen].astype(np.float64) * room.depth(SMALL)[seen, None] @ R.T
    beyond = FACE_SIGN * points[:, FACE_AXIS] - distances
    own = beyond[np.arange(len(points)), raster[seen] - 1]
    np.testing.assert_allclose(own, 0.0, atol=1e-4)
    assert (beyond < 1e-4).all()


@every_view
def test_the_polygons_tile_the_raster(R: NDArray[np.float64], distances: NDArray[np.float64]) -> None:
    room = RoomCuboid(R, distances)
    raster = room.raster(SMALL)
    near = room.depth(SMALL) < 900  # polygons end a kilometre away
    inside = np.zeros((6, *raster.shape), bool)
    for polygon in room.polygons(SMALL):
        corners = polygon.pixels.astype(np.float32)
        for y, x in np.ndindex(raster.shape):
            inside[polygon.face, y, x] = cv2.pointPolygonTest(corners, (float(x), float(y)), True) >= -0.01
    held = np.take_along_axis(inside, raster[None].astype(np.intp), 0)[0] | (raster == 0) | ~near
    assert held.all(), "a pixel lies outside the polygon of its face"
    shared = inside[1:].sum(axis=0) > 1
    assert shared.mean() < 0.02, "only pixels on an edge lie in two polygons"
    assert not (inside[1:].any(axis=0) & (raster == 0) & near).any()


@every_view
def test_the_corners_in_metres_are_the_corners_in_pixels_on_the_plane(
    R: NDArray[np.float64], distances: NDArray[np.float64]
) -> None:
    room = RoomCuboid(R, distances)
    for polygon in room.polygons(SMALL):
        points = polygon.points_m
        np.testing.assert_allclose((points @ SMALL.matrix.T)[:, :2] / points[:, 2:], polygon.pixels, atol=1e-6)
        near = points[:, 2] < 999.0
        np.testing.assert_allclose(points[near] @ -polygon.normal, polygon.distance, rtol=1e-9)
        assert polygon.distance == distances[polygon.face - 1]
        assert np.linalg.norm(polygon.normal) == pytest.approx(1.0)
        assert (points[:, 2] > 0).all()
        assert (polygon.pixels >= -0.5 - 1e-9).all()
        assert (polygon.pixels <= [SMALL.width - 0.5 + 1e-9, SMALL.height - 0.5 + 1e-9]).all()


def test_a_wide_camera_sees_all_five_faces() -> None:
    camera = CameraIntrinsics(160, 120, 60.0, 60.0, 79.5, 59.5)
    room = RoomCuboid(look(3), ROOM)
    assert set(np.unique(room.raster(camera))) == {1, 2, 3, 4, 5}
    assert [p.face for p in room.polygons(camera)] == [1, 2, 3, 4, 5]


def test_the_layout_does_not_change_with_the_size_of_the_room() -> None:
    _, room = seen_from_inside()
    larger = RoomCuboid(room.R_room_camera, 3.0 * room.distances)
    np.testing.assert_array_equal(larger.raster(SMALL), room.raster(SMALL))
    np.testing.assert_allclose(larger.depth(SMALL), 3.0 * room.depth(SMALL), rtol=1e-6)


@pytest.mark.parametrize("distances", ([0.0, 1, 1, 1, 1], [1, 1, 1, -2, 1], [1, 1, 1, 1, np.nan], [1, 1, 1, 1]))
def test_distances_that_are_none_are_refused(distances: list[float]) -> None:
    with pytest.raises(ValueError, match=r"^plane distances are \[.*\]; five values above 0 are needed$"):
        RoomCuboid(np.eye(3), np.array(distances, np.float64))


@pytest.mark.parametrize(
    "R", (np.diag([1.0, 1.0, -1.0]), 2 * np.eye(3), np.full((3, 3), np.nan), np.eye(4), np.zeros((3, 3)))
)
def test_a_matrix_that_is_no_rotation_is_refused(R: NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match=r"^R_room_camera is \[\[.*\]\]; it must be a rotation matrix$"):
        RoomCuboid(R, ROOM)


@pytest.mark.parametrize(
    ("distances", "expected"),
    [
        ([0.8, 0.5, 1.2, 1.6, np.inf], [0.5, 0.3125, 0.75, 1.0, np.inf]),
        ([np.inf, 0.5, 2.0, np.inf, 1.0], [np.inf, 0.25, 1.0, np.inf, 0.5]),
    ],
)
def test_without_a_scale_the_front_wall_is_at_one(distances: list[float], expected: list[float]) -> None:
    room = RoomCuboid(np.eye(3), np.array(distances)).at_unit_scale()
    np.testing.assert_allclose(room.distances, expected)
