"""Synthetic rooms: what they say is true is true, by independent geometry."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from naive_synthetic import cast_pixel, hidden_from_projector

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import CEILING, FLOOR, FRONT_WALL, LEFT_WALL, RIGHT_WALL
from room_layout_ros.datasets import BadFrame, DataError, FrameSource, Sample
from room_layout_ros.datasets.synthetic import (
    CLEAN,
    KINDS,
    KINECT,
    NOISES,
    SyntheticRoom,
    SyntheticSource,
    camera_pose,
    random_pose,
    random_scene,
    render,
    walk,
)
from room_layout_ros.datasets.synthetic.floor import is_free
from room_layout_ros.datasets.synthetic.noise import _shadow
from room_layout_ros.datasets.synthetic.raster import camera_rectangles, cast

SMALL = CameraIntrinsics(160, 120, 131.0, 131.0, 79.5, 59.5)


@lru_cache(maxsize=16)
def scene(kind: str, seed: int = 3) -> SyntheticRoom:
    return random_scene(np.random.default_rng(seed), kind, small_objects=3)


@lru_cache(maxsize=16)
def view(kind: str, seed: int = 3) -> Sample:
    pose = random_pose(scene(kind, seed), np.random.default_rng(seed + 50))
    return render(scene(kind, seed), SMALL, pose)


@pytest.mark.parametrize("kind", KINDS)
def test_the_ray_caster_equals_its_naive_twin(kind: str, rng: np.random.Generator) -> None:
    room, sample = scene(kind), view(kind)
    assert sample.T_world_camera is not None
    surfaces = room.surfaces
    index, depth_m = cast(camera_rectangles(surfaces, sample.T_world_camera), SMALL)
    for x, y in zip(rng.integers(0, 160, 150), rng.integers(0, 120, 150), strict=True):
        naive_index, naive_depth = cast_pixel(surfaces, SMALL, sample.T_world_camera, int(x), int(y))
        assert index[y, x] == naive_index
        assert depth_m[y, x] == pytest.approx(naive_depth, rel=1e-6)


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("l_shape", "sloped")])
def test_the_true_cuboid_rasters_to_the_true_layout_and_depth(kind: str) -> None:
    truth = view(kind).truth
    assert truth is not None
    assert truth.cuboid is not None
    assert truth.layout is not None
    assert truth.layout_depth_m is not None
    np.testing.assert_array_equal(truth.cuboid.raster(SMALL), truth.layout)
    np.testing.assert_allclose(truth.cuboid.depth(SMALL), truth.layout_depth_m, rtol=1e-5)


@pytest.mark.parametrize("kind", ["l_shape", "sloped"])
def test_what_is_no_cuboid_has_none(kind: str) -> None:
    truth = view(kind).truth
    assert truth is not None
    assert truth.cuboid is None
    assert truth.layout is not None
    assert truth.layout.min() >= 1


def test_nothing_in_a_closed_room_lies_behind_its_walls() -> None:
    truth = view("cuboid").truth
    assert truth is not None
    assert truth.depth_m is not None
    assert truth.layout_depth_m is not None
    assert (truth.depth_m <= truth.layout_depth_m * (1 + 1e-5)).all()


def test_an_open_door_shows_the_room_behind() -> None:
    room = random_scene(np.random.default_rng(1), "open_door", furniture=0.0, decorate=False)
    deepest = 0.0
    for yaw in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        truth = render(room, SMALL, camera_pose(0, 0, 1.4, float(yaw))).truth
        assert truth is not None
        assert truth.depth_m is not None
        assert truth.layout_depth_m is not None
        assert np.isfinite(truth.depth_m).all(), "a gap in the walls"
        deepest = max(deepest, float((truth.depth_m - truth.layout_depth_m).max()))
    assert deepest > 1.5


@pytest.mark.parametrize("yaw_deg", [-40, -10, 0, 25, 44])
def test_front_is_the_wall_that_faces_the_camera_most(yaw_deg: float) -> None:
    """From the middle of a room 5 m x 4 m, turned less than 45 degrees from +x: front is the wall at x = 2.5."""
    from room_layout_ros.datasets.synthetic.paint import decoration
    from room_layout_ros.datasets.synthetic.room import cuboid_corners, empty_room
    from room_layout_ros.datasets.synthetic.shading import Light

    look = decoration(np.random.default_rng(0), 4)
    room = empty_room("cuboid", *cuboid_corners(5.0, 4.0), 2.5, look, Light(0.6, np.zeros((0, 4))))
    wide = CameraIntrinsics(160, 120, 60.0, 60.0, 79.5, 59.5)
    truth = render(room, wide, camera_pose(0, 0, 1.0, np.deg2rad(yaw_deg), -0.1)).truth
    assert truth is not None
    assert truth.cuboid is not None
    distances = truth.cuboid.distances
    np.testing.assert_allclose(distances[[CEILING - 1, FLOOR - 1, FRONT_WALL - 1]], [1.5, 1.0, 2.5])
    assert {round(float(d), 9) for d in distances[[LEFT_WALL - 1, RIGHT_WALL - 1]]} <= {2.0, np.inf}
    axis = truth.cuboid.R_room_camera[2]
    assert np.rad2deg(np.arctan2(axis[0], axis[2])) == pytest.approx(yaw_deg, abs=0.5)
    assert truth.down_camera is not None
    np.testing.assert_allclose(truth.cuboid.R_room_camera[1], truth.down_camera, atol=1e-12)
    assert truth.camera_height_m == pytest.approx(1.0)


def test_points_of_the_clean_depth_lie_on_their_normals_planes() -> None:
    """Neighbours of one surface differ at right angles to its normal."""
    truth = view("cuboid").truth
    assert truth is not None
    assert truth.depth_m is not None
    assert truth.normal is not None
    points = SMALL.rays() * truth.depth_m[..., None]
    step = points[:, 1:] - points[:, :-1]
    same = np.all(truth.normal[:, 1:] == truth.normal[:, :-1], axis=2)
    across = np.abs(np.einsum("ijk,ijk->ij", step, truth.normal[:, 1:]))
    assert np.median(across[same]) < 1e-6
    assert (across[same] < 1e-5).mean() > 0.93, "the rest are steps between parallel surfaces"


@pytest.mark.parametrize("noise", NOISES)
def test_the_same_seed_gives_the_same_bytes(noise: str) -> None:
    first, second = (list(SyntheticSource(2, 9, "random", noise, camera=SMALL)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert isinstance(a, Sample)
        assert isinstance(b, Sample)
        np.testing.assert_array_equal(a.frame.color, b.frame.color)
        np.testing.assert_array_equal(a.frame.depth_m, b.frame.depth_m)
        np.testing.assert_array_equal(a.T_world_camera, b.T_world_camera)


def test_other_seeds_give_other_rooms() -> None:
    frames = [next(iter(SyntheticSource(1, seed, camera=SMALL))) for seed in (1, 2)]
    assert not isinstance(frames[0], BadFrame)
    assert not isinstance(frames[1], BadFrame)
    assert frames[0].frame.color is not None
    assert frames[1].frame.color is not None
    assert (frames[0].frame.color != frames[1].frame.color).mean() > 0.5


@pytest.mark.parametrize("share", [0.5, 0.6])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_wall_clutter_hides_at_least_its_share_of_every_wall(share: float, seed: int) -> None:
    """Seen from the middle of the room, all walls in turn."""
    room = random_scene(np.random.default_rng(seed), "cuboid", furniture=0.0, wall_clutter=share, decorate=False)
    hidden, total = np.zeros(4), np.zeros(4)
    for side in range(4):
        pose = camera_pose(0.0, 0.0, room.height / 2, side * np.pi / 2)
        wide = CameraIntrinsics(200, 200, 60.0, 60.0, 99.5, 99.5)
        truth = render(room, wide, pose).truth
        assert truth is not None
        assert truth.labels is not None
        assert truth.layout is not None
        front = truth.layout == FRONT_WALL
        hidden[side], total[side] = (truth.labels[front] == 6).sum(), front.sum()
    assert (hidden / total > share - 0.03).all(), hidden / total


def errors_of(noise: str, depth: float) -> np.ndarray:
    """Return measured minus true depth of a flat wall at `depth`."""
    from room_layout_ros.datasets.synthetic.noise import sense_depth

    true = np.full((480, 640), depth, np.float32)
    normals = np.zeros((480, 640, 3), np.float32)
    normals[..., 2] = -1
    color = np.random.default_rng(1).integers(0, 255, (480, 640, 3)).astype(np.uint8)
    measured = sense_depth(
        true, normals, np.zeros((480, 640), np.uint8), color, KINECT, NOISES[noise], np.random.default_rng(0)
    )
    return np.asarray(measured - true)


@pytest.mark.parametrize("depth", [1.0, 2.0, 3.5])
def test_kinect_noise_grows_as_measured_kinects_do(depth: float) -> None:
    """sigma_z is about 0.0014 z^2 [m] and 1/8 px steps add their share (Khoshelham & Elberink 2012)."""
    error = errors_of("kinect", depth)
    random = 0.0014 * depth**2
    step = depth**2 * 0.125 / (525 * 0.075) / np.sqrt(12)
    assert 0.7 * np.hypot(random, step) < np.nanstd(error) < 1.6 * np.hypot(random, step)


def test_eight_bit_noise_has_steps_of_39_mm_and_no_holes() -> None:
    sample = next(iter(SyntheticSource(1, 4, noise="nyu8")))
    assert isinstance(sample, Sample)
    assert sample.frame.depth_m is not None
    assert np.isfinite(sample.frame.depth_m).all()
    steps = sample.frame.depth_m / (10.0 / 255)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-3)
    assert sample.frame.color is not None
    assert (sample.frame.color[:9] == 255).all(), "white border"


@pytest.mark.parametrize("noise", ["kinect", "stereo"])
def test_sensors_lose_pixels_but_not_the_room(noise: str) -> None:
    for seed in range(3):
        sample = next(iter(SyntheticSource(1, seed, noise=noise)))
        assert isinstance(sample, Sample)
        assert sample.frame.depth_m is not None
        assert sample.truth is not None
        assert sample.truth.depth_m is not None
        measured = np.isfinite(sample.frame.depth_m)
        assert 0.4 < measured.mean() < 0.999
        relative = np.abs(sample.frame.depth_m - sample.truth.depth_m)[measured] / sample.truth.depth_m[measured]
        assert np.median(relative) < 0.02


def test_clean_depth_is_the_truth() -> None:
    sample = view("cuboid")
    assert sample.truth is not None
    np.testing.assert_array_equal(sample.frame.depth_m, sample.truth.depth_m)


def test_the_shadow_equals_its_naive_twin(rng: np.random.Generator) -> None:
    disparity = np.repeat(rng.uniform(5, 40, (6, 12)).astype(np.float32), 10, axis=1)
    hidden = _shadow(disparity)
    assert 0.05 < hidden.mean() < 0.95
    expected = [[hidden_from_projector(disparity, y, x) for x in range(120)] for y in range(6)]
    np.testing.assert_array_equal(hidden, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_a_walk_is_smooth_and_stays_clear_of_everything(kind: str) -> None:
    room = scene(kind)
    poses = walk(room, np.random.default_rng(5), 200)
    positions = np.array([pose[:3, 3] for pose in poses])
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() < 0.03, "slower than 1 m/s at 30 Hz"
    for before, after in pairwise(poses):
        turn = np.arccos(np.clip((np.trace(before[:3, :3].T @ after[:3, :3]) - 1) / 2, -1, 1))
        assert np.rad2deg(turn) < 1.5
    for x, y, z in positions[::10]:
        assert is_free(room, float(x), float(y), 0.25)
        assert 0.2 < z < room.height
    np.testing.assert_allclose([np.linalg.det(p[:3, :3]) for p in poses], 1.0)


def test_the_estimator_agrees_with_an_empty_room() -> None:
    """Axes within 0.1 degrees, layout error below 1 %: two independent geometries meet."""
    from room_layout_ros.core.estimator import LayoutEstimator

    source = SyntheticSource(1, 0, noise="clean", walk=False, options={"furniture": 0.0, "decorate": False})
    sample = next(iter(source))
    assert isinstance(sample, Sample)
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    estimate = LayoutEstimator().estimate(sample.frame)
    R = estimate.R_room_camera @ sample.truth.cuboid.R_room_camera.T
    assert np.rad2deg(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))) < 0.1
    assert (estimate.layout != sample.truth.layout).mean() < 0.01


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"frames": 0}, "frames is 0"),
        ({"kind": "dome"}, "room kind is 'dome'"),
        ({"noise": "loud"}, "noise is 'loud'"),
    ],
)
def test_wrong_settings_are_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(DataError, match=words):
        SyntheticSource(**arguments)  # type: ignore[arg-type]
    assert isinstance(SyntheticSource(), FrameSource)


def test_noise_without_chance_is_refused() -> None:
    with pytest.raises(ValueError, match="rng"):
        render(scene("cuboid"), SMALL, camera_pose(0, 0, 1, 0), NOISES["kinect"])
    with pytest.raises(ValueError, match="wall_clutter"):
        random_scene(np.random.default_rng(0), wall_clutter=0.9)
    with pytest.raises(ValueError, match="furniture"):
        random_scene(np.random.default_rng(0), furniture=-1)
    assert CLEAN.baseline_m == 0
