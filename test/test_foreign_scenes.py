"""The benchmark's own ray caster is right where a formula says so, and the estimator finds its way in its rooms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import _ray_caster as rc
from benchmarks._foreign_rooms import enclose, ground
from benchmarks._foreign_things import PALE, SILVERED, Scene
from benchmarks._foreign_truth import take, true_layout
from benchmarks.foreign_scenes import score
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.datasets.synthetic import camera_pose

CAMERA = CameraIntrinsics(160, 120, 140.0, 140.0, 79.5, 59.5)
LAMP = np.array([1.0, 0.0, 2.0, 2.0])


def empty_scene() -> Scene:
    return Scene(np.random.default_rng(3), half_view=0.5, floor_from_m=1.0)


def depth_of(scene: Scene, pose: NDArray[np.float64]) -> NDArray[np.float32]:
    return rc.look(scene.solids(), CAMERA, pose, LAMP).depth_m


def test_every_ray_in_an_empty_room_ends_on_the_nearest_plane() -> None:
    scene = empty_scene()
    ground(scene, (-0.1, scene.length_m + 0.1), (-0.1, scene.width_m + 0.1))
    enclose(scene, skirt=False)
    pose = camera_pose(1.0, 1.5, 1.2, yaw=0.4, pitch=-0.2, roll=0.05)
    low, high = np.zeros(3), np.array([scene.length_m, scene.width_m, scene.height_m])
    rays = CAMERA.rays().astype(float) @ pose[:3, :3].T
    expected = np.where(rays > 0, (high - pose[:3, 3]) / rays, (low - pose[:3, 3]) / rays).min(axis=-1)
    np.testing.assert_allclose(depth_of(scene, pose), expected, rtol=1e-5)


def test_a_ball_and_a_post_are_round() -> None:
    scene = empty_scene()
    part = scene.thing("things")
    part.egg(3.0, 0.3, 1.0, (0.5, 0.5, 0.5), PALE)
    part.post(3.0, -0.8, -2.0, 4.0, 0.3, PALE)
    depth_m = depth_of(scene, camera_pose(0.0, 0.0, 1.0, yaw=0.0))
    x, y = CAMERA.rays()[..., 0].astype(float), CAMERA.rays()[..., 1].astype(float)

    def first_root(a: NDArray[np.float64], b: NDArray[np.float64], c: float) -> NDArray[np.float64]:
        with np.errstate(invalid="ignore"):
            return (b - np.sqrt(b * b - a * c)) / a

    to_ball = first_root(1 + x * x + y * y, 3.0 - 0.3 * x, 3.0**2 + 0.3**2 - 0.5**2)
    to_post = first_root(1 + x * x, 3.0 + 0.8 * x, 3.0**2 + 0.8**2 - 0.3**2)
    expected = np.fmin(np.fmin(to_ball, to_post), np.inf)
    assert np.isfinite(to_ball).sum() > 1000
    assert np.isfinite(to_post).sum() > 1000
    np.testing.assert_allclose(depth_m, expected, rtol=1e-5)


def test_a_mirror_shows_what_is_behind_the_camera_as_far_as_the_way_is() -> None:
    scene = empty_scene()
    scene.thing("mirror").box(2.05, 0.0, -5, 5, 0.1, 9.0, SILVERED)
    scene.thing("wall").box(-1.05, 0.0, -9, 9, 0.1, 19.0, PALE)
    depth_m = depth_of(scene, camera_pose(0.0, 0.0, 1.0, yaw=0.0))
    np.testing.assert_allclose(depth_m, 2.0 + 3.0, rtol=1e-5)


def test_places_under_a_table_top_are_taken_and_a_step_is_another_level() -> None:
    scene = empty_scene()
    ground(scene, (0.0, 2.0), (-1.0, 1.0))
    ground(scene, (2.0, 4.0), (-1.0, 1.0), top=0.1)
    scene.thing("table").post(1.0, 0.0, 0.7, 0.73, 0.4, PALE)
    x, y = np.array([1.0, 1.39, 1.41, 3.0, 9.0]), np.zeros(5)
    state = rc.what_stands(scene.solids(), x, y, 2.0)[0]
    assert state.tolist() == [rc.TAKEN, rc.TAKEN, rc.CLEAR, rc.OTHER_LEVEL, rc.OTHER_LEVEL]
    assert rc.what_stands(scene.solids(), x, y, 0.5)[0][0] == rc.CLEAR


def test_the_same_seed_gives_the_same_frame_and_its_true_layout_is_what_the_rays_meet() -> None:
    view, again = take("empty", 1), take("empty", 1)
    np.testing.assert_array_equal(view.frame.color, again.frame.color)
    np.testing.assert_array_equal(view.frame.depth_m, again.frame.depth_m)
    role = view.solids.role[view.picture.solid]
    floor = true_layout(view) == 2
    assert np.mean(role[floor] == rc.FLOOR) > 0.95  # the rest is skirting board
    assert not np.isin(role[~floor], (rc.FLOOR, rc.THING)).any()


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator()


@pytest.mark.parametrize(("kind", "seed"), [("persons", 0), ("balls", 1)])
def test_things_of_other_shapes_are_found_and_hide_no_room(estimator: LayoutEstimator, kind: str, seed: int) -> None:
    row = score(estimator, take(kind, seed))
    assert row.things >= 2
    assert row.missed == []
    assert row.layout[0] < 0.01
    assert row.iou > 0.93
    assert row.wrong[1:].sum() <= 2  # cells that are called free, of some 3000
