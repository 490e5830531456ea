"""Boxes of things: right on boxes of known size and place, upright, classed by their pixels, steady in number."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.cuboids import ObjectCuboid, compute_object_cuboids
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.floor.floor_frame import floor_frame
from room_layout_ros.core.floor.floor_plane import FloorPlane
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.freespace import compute_free_space
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.layout import RoomCuboid

CAMERA = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
HEIGHT = 1.2
PITCH = np.deg2rad(25.0)
R = np.array([[1, 0, 0], [0, np.cos(PITCH), np.sin(PITCH)], [0, -np.sin(PITCH), np.cos(PITCH)]])
T_CAMERA_FLOOR = floor_frame(R[1], HEIGHT)
ROOM = RoomCuboid(R, np.array([1.4, HEIGHT, 2.0, 4.0, 2.0]))


class Thing:
    """A box on the floor: middle x, y, size along its own axes, yaw, all in the floor frame."""

    def __init__(
        self, x: float, y: float, size: tuple[float, float, float], yaw_deg: float = 0.0, z: float = 0.0
    ) -> None:
        self.middle, self.size, self.z = np.array([x, y, z + size[2] / 2]), np.array(size), z
        c, s = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
        self.axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    def depth(self) -> NDArray[np.float64]:
        """Distance along each pixel's ray to the box (slab test), inf where it is missed."""
        rays = CAMERA.rays().astype(np.float64) @ T_CAMERA_FLOOR[:3, :3] @ self.axes
        start = (-T_CAMERA_FLOOR[:3, :3].T @ T_CAMERA_FLOOR[:3, 3] - self.middle) @ self.axes
        with np.errstate(divide="ignore"):
            a, b = (-self.size / 2 - start) / rays, (self.size / 2 - start) / rays
        near, far = np.minimum(a, b).max(axis=2), np.maximum(a, b).min(axis=2)
        return np.where((near <= far) & (near > 0), near, np.inf)


def seen(things: list[Thing], classes: dict[int, int] | None = None, noise: float = 0.0) -> tuple[ObjectCuboid, ...]:
    """Return the boxes found in the room with these things; `classes` gives NYU40 ids by index."""
    depths = np.stack([ROOM.depth(CAMERA).astype(np.float64), *(t.depth() for t in things)])
    which = depths.argmin(axis=0)
    depth_m = depths.min(axis=0)
    depth_m += np.random.default_rng(1).normal(0, 1, depth_m.shape) * noise * depth_m**2
    labels = ROOM.raster(CAMERA)
    labels[which > 0] = CLUTTER
    furniture = np.zeros_like(labels)
    for k, nyu40 in (classes or {}).items():
        furniture[which == k + 1] = nyu40
    frame = RgbdFrame(CAMERA, None, depth_m.astype(np.float32))
    geometry = compute_depth_geometry(frame, EstimatorConfig())
    assert geometry is not None
    estimate = RoomEstimate(
        status=Status.OK, layout=labels, labels=labels, furniture=furniture, superpixels=labels.astype(np.int32),
        R_room_camera=R, axes_confidence=1.0, confidence=1.0, face_confidence=np.ones(5), cuboid=ROOM, polygons=(),
    )  # fmt: skip
    floor = FloorPlane(R[1], HEIGHT)
    free_space = compute_free_space(geometry, estimate, EstimatorConfig(), floor)
    assert free_space is not None
    np.testing.assert_allclose(free_space.T_camera_floor, T_CAMERA_FLOOR, atol=0.01)
    return compute_object_cuboids(geometry, estimate, free_space, EstimatorConfig())


@pytest.mark.parametrize("yaw", (0.0, 35.0, -20.0))
def test_a_box_that_shows_three_sides_is_measured(yaw: float) -> None:
    thing = Thing(2.0, 0.6, (0.6, 0.4, 0.5), yaw)
    (found,) = seen([thing])
    np.testing.assert_allclose(found.size_m, thing.size, atol=0.05)
    np.testing.assert_allclose(found.center_m, thing.middle, atol=0.04)
    assert np.rad2deg(found.yaw) == pytest.approx(yaw, abs=4.0)


def test_things_apart_are_apart_and_the_largest_comes_first() -> None:
    things = [Thing(1.6, 0.5, (0.3, 0.3, 0.3)), Thing(2.4, -0.6, (0.5, 0.8, 0.7)), Thing(3.0, 0.9, (0.3, 0.5, 0.9))]
    found = seen(things)
    assert len(found) == 3
    assert [f.points for f in found] == sorted((f.points for f in found), reverse=True)
    for thing in things:
        assert min(np.linalg.norm(f.center_m[:2] - thing.middle[:2]) for f in found) < 0.12


def test_one_behind_the_other_is_not_one() -> None:
    """The flat top of the one behind, seen at a glance, may be a box of its own."""
    things = [Thing(1.6, 0.0, (0.3, 0.4, 0.3)), Thing(2.6, 0.1, (0.4, 0.9, 0.8))]
    found = seen(things)
    assert len(found) in (2, 3)
    for thing in things:
        assert min(np.linalg.norm(f.center_m[:2] - thing.middle[:2]) for f in found) < 0.2


def test_a_thing_has_the_class_of_its_pixels() -> None:
    things = [Thing(2.2, 0.6, (0.5, 0.5, 0.5)), Thing(2.2, -0.6, (0.5, 0.5, 0.5))]
    left, right = sorted(seen(things, {0: 5, 1: 7}), key=lambda f: -f.center_m[1])
    assert (left.nyu40, right.nyu40) == (5, 7)
    assert {f.nyu40 for f in seen(things)} == {0}


def test_a_shelf_on_the_wall_does_not_reach_the_floor() -> None:
    (found,) = seen([Thing(3.5, 0.3, (0.3, 0.8, 0.3), z=0.9)])
    assert found.center_m[2] - found.size_m[2] / 2 == pytest.approx(0.9, abs=0.05)


def test_noise_changes_a_box_by_centimetres() -> None:
    thing = Thing(2.0, 0.5, (0.6, 0.4, 0.5), 30.0)
    (found,) = seen([thing], noise=0.002)
    np.testing.assert_allclose(found.size_m, thing.size, atol=0.08)


def test_an_empty_room_has_no_things() -> None:
    assert seen([]) == ()


def test_specks_are_no_things() -> None:
    assert seen([Thing(3.0, 0.0, (0.04, 0.04, 0.04))]) == ()


@pytest.mark.parametrize("yaw", (0.0, 35.0))
def test_a_box_is_whole_in_a_picture_of_few_pixels(yaw: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 160 x 120 every second one is looked at: a cell of 5 cm has less than one of them."""
    monkeypatch.setitem(globals(), "CAMERA", CAMERA.scaled(160 / CAMERA.width))
    thing = Thing(2.6, 0.0, (0.6, 1.5, 0.8), yaw)
    found = seen([thing])[0]
    np.testing.assert_allclose(sorted(found.size_m), sorted(thing.size), atol=0.2)
