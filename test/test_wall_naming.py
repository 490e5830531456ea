"""The names of the walls: a convention that moves no plane and loses no probability."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import ROOM, SMALL, look

from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.room_axes import other_front
from room_layout_ros.core.wall_naming import name_walls, rename_walls


def seen(room: RoomCuboid) -> NDArray[np.bool_]:
    return np.bincount(room.raster(SMALL).ravel(), minlength=6)[1:] >= 30


def corner(yaw_deg: float, left: float = np.inf, right: float = np.inf) -> RoomCuboid:
    return RoomCuboid(look(yaw_deg, 5), np.array([np.inf, 1.3, left, 3.0, right]))


@pytest.mark.parametrize("yaw", (50.0, 60.0, 70.0))
def test_a_right_wall_that_faces_the_camera_more_becomes_the_front(yaw: float) -> None:
    room = corner(yaw, right=2.5)
    named, origin = name_walls(room, seen(room))
    np.testing.assert_array_equal(origin, [0, 1, 3, 4, -1])
    np.testing.assert_array_equal(named.distances, [np.inf, 1.3, 3.0, 2.5, np.inf])
    np.testing.assert_array_equal(named.raster(SMALL), np.array([0, 1, 2, 0, 3, 4])[room.raster(SMALL)])
    np.testing.assert_array_equal(named.depth(SMALL), room.depth(SMALL))


@pytest.mark.parametrize("yaw", (-50.0, -60.0, -70.0))
def test_a_left_wall_that_faces_the_camera_more_becomes_the_front(yaw: float) -> None:
    room = corner(yaw, left=2.5)
    named, origin = name_walls(room, seen(room))
    np.testing.assert_array_equal(origin, [0, 1, -1, 2, 3])
    np.testing.assert_array_equal(named.distances, [np.inf, 1.3, np.inf, 2.5, 3.0])
    np.testing.assert_array_equal(named.raster(SMALL), np.array([0, 1, 2, 4, 5, 0])[room.raster(SMALL)])
    np.testing.assert_array_equal(named.depth(SMALL), room.depth(SMALL))


def test_what_is_named_right_stays() -> None:
    for room in (corner(40, right=2.5), corner(-40, left=2.5), corner(0, left=1.5, right=1.5), corner(20)):
        named, origin = name_walls(room, seen(room))
        assert named is room
        np.testing.assert_array_equal(origin, np.arange(5))


def test_naming_twice_changes_nothing_more() -> None:
    room = corner(60, right=2.5)
    named, _ = name_walls(room, seen(room))
    again, origin = name_walls(named, seen(named))
    assert again is named
    np.testing.assert_array_equal(origin, np.arange(5))


def test_a_side_wall_whose_opposite_is_in_view_stays_a_side_wall() -> None:
    """A front wall with both sides in view has no other name."""
    room = RoomCuboid(look(30, 0), ROOM)
    assert name_walls(room, np.ones(5, bool))[0] is room


def test_a_front_wall_out_of_view_leaves_its_name_to_the_side_wall_in_view() -> None:
    room = corner(70, right=2.5)
    named, origin = name_walls(room, np.array([False, True, False, False, True]))
    np.testing.assert_array_equal(origin, [0, 1, 3, 4, -1])
    assert named.distances[3] == 2.5


@pytest.mark.parametrize("yaw", (-60.0, -20.0, 20.0, 60.0))
def test_probabilities_under_the_other_front_are_those_of_the_same_walls(yaw: float, rng: np.random.Generator) -> None:
    R = look(yaw, 5)
    turned_R = other_front(R)
    p = rng.dirichlet(np.ones(6), 7)
    turned = rename_walls(p, R, turned_R)
    np.testing.assert_allclose(turned.sum(axis=1), 1.0)
    np.testing.assert_array_equal(turned[:, [0, 1, 5]], p[:, [0, 1, 5]])
    side, kept = (4, 2) if yaw > 0 else (2, 4)  # the side wall in view becomes the front one
    np.testing.assert_array_equal(turned[:, 3], p[:, side])
    np.testing.assert_allclose(turned[:, kept], p[:, 3] + p[:, kept])
    assert not turned[:, side].any()


def test_probabilities_keep_their_names_under_the_same_axes_and_under_another_triple(rng: np.random.Generator) -> None:
    p = rng.dirichlet(np.ones(6), 5)
    np.testing.assert_array_equal(rename_walls(p, look(10), look(10)), p)
    np.testing.assert_array_equal(rename_walls(p, look(0), look(45)), p)
    assert rename_walls(p, look(10), look(10)) is not p
