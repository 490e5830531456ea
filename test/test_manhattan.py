"""The room's axes: equal to the naive growing of planes, exact where depth is, robust to noise, holes and start."""

from __future__ import annotations

import naive_room
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF, ROOM, SMALL, look, seen_from_inside

from room_layout_ros.core.axes_refinement import _grow, refine_on_planes
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import DepthGeometry, compute_depth_geometry, fit_cell_planes
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.lines import LineSegments, compute_line_segments
from room_layout_ros.core.manhattan import estimate_manhattan_frame, find_axes
from room_layout_ros.core.room_axes import angle_between_axes, name_axes, other_front
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource

CONFIG = EstimatorConfig()
VIEWS = [look(0, 0, 0), look(25, 12, 2), look(-40, -8, -3), look(10, 30, 0), look(44, 5, 10)]


def geometry_of(depth_m: NDArray[np.float32], camera: CameraIntrinsics = HALF) -> DepthGeometry:
    geometry = compute_depth_geometry(RgbdFrame(camera, None, depth_m), CONFIG)
    assert geometry is not None
    return geometry


def room_depth(R: NDArray[np.float64], camera: CameraIntrinsics = HALF) -> NDArray[np.float32]:
    frame, _ = seen_from_inside(camera, R)
    assert frame.depth_m is not None
    return frame.depth_m


def error_deg(found: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    return float(np.rad2deg(angle_between_axes(found, truth)))


@pytest.mark.parametrize("R", VIEWS)
def test_axes_of_an_exact_room_are_exact(R: NDArray[np.float64]) -> None:
    found = estimate_manhattan_frame(geometry_of(room_depth(R)))
    assert found is not None
    assert error_deg(found.R_room_camera, R) < 0.1
    assert found.confidence > 0.7
    np.testing.assert_allclose(found.R_room_camera @ found.R_room_camera.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found.R_room_camera) == pytest.approx(1.0)


@pytest.mark.parametrize("R", VIEWS)
def test_noise_of_a_kinect_costs_a_fraction_of_a_degree(R: NDArray[np.float64], rng: np.random.Generator) -> None:
    depth = room_depth(R)
    noisy = (depth + rng.normal(0, 1, depth.shape) * (0.003 + 0.0019 * depth**2)).astype(np.float32)
    noisy[rng.random(depth.shape) < 0.3] = np.nan
    found = estimate_manhattan_frame(geometry_of(noisy))
    assert found is not None
    assert error_deg(found.R_room_camera, R) < 0.4


def test_names_follow_the_view_and_gravity() -> None:
    for R in VIEWS:
        shuffled = np.array([-R[2], R[0], -R[1]])
        named = name_axes(shuffled)
        assert named[1, 1] > 0.5, "Y points down"
        assert named[2, 2] > 0, "Z points ahead"
        assert named[2, 2] >= abs(named[0, 2]) - 1e-12, "Z is the horizontal axis nearest the view"
        np.testing.assert_allclose(np.cross(named[0], named[1]), named[2], atol=1e-12)
    lying = look(0, 0, 90)  # the camera on its side: only gravity can tell
    np.testing.assert_allclose(name_axes(lying, gravity=lying[1])[1], lying[1], atol=1e-12)
    np.testing.assert_allclose(name_axes(lying, gravity=-9.81 * lying[1])[1], -lying[1], atol=1e-12)


def test_the_other_front_is_a_quarter_turn_towards_the_view() -> None:
    for R in VIEWS:
        turned = other_front(R)
        assert error_deg(turned, R) < 1e-5
        np.testing.assert_allclose(np.abs(turned[2]), np.abs(R[0]), atol=1e-12)
        np.testing.assert_array_equal(turned[1], R[1])
        assert turned[2, 2] >= 0
        assert np.linalg.det(turned) == pytest.approx(1.0)


def test_angles_between_frames_count_modulo_the_turns_of_a_cube() -> None:
    R = look(17, 9, 4)
    assert error_deg(R[[1, 2, 0]], R) < 1e-5
    assert error_deg(np.array([-R[0], R[2], R[1]]), R) < 1e-5
    for angle in (0.05, 3.0, 20.0, 44.0):
        assert error_deg(look(angle) @ R, R) == pytest.approx(angle, rel=1e-4)
    assert error_deg(look(89.0) @ R, R) == pytest.approx(1.0, rel=1e-4)


def test_hypotheses_hold_both_fronts_and_begin_with_the_best() -> None:
    R = look(40, 5, 0)
    found = estimate_manhattan_frame(geometry_of(room_depth(R)))
    assert found is not None
    np.testing.assert_array_equal(found.hypotheses[0], found.R_room_camera)
    np.testing.assert_array_equal(found.hypotheses[1], other_front(found.R_room_camera))


@pytest.mark.parametrize("tolerance_deg", (3.0, 8.0, 15.0))
def test_planes_grow_as_breadth_first_search_grows_them(tolerance_deg: float, rng: np.random.Generator) -> None:
    R = look(25, 12, 2)
    depth = room_depth(R, SMALL)
    depth = (depth + rng.normal(0, 0.02, depth.shape)).astype(np.float32)
    depth[30:70, 40:60] -= 0.5
    geometry = geometry_of(depth, SMALL)
    cells = fit_cell_planes(geometry, radius=1, max_residual=4.0)
    rows, cols, _ = geometry.moments.shape
    tolerance = np.deg2rad(tolerance_deg)
    plane, count = _grow(rows, cols, cells.cell, cells.normal, cells.centroid, cells.sigma, R, tolerance)
    expected = naive_room.grow(cells.cell, cells.normal, cells.centroid, cells.sigma, R, tolerance)
    assert count == len(expected) > 1
    assert [set(np.flatnonzero(plane == i).tolist()) for i in range(count)] == expected


@pytest.mark.parametrize("spread_m", (0.01, 0.04, 0.10))
def test_planes_of_a_rough_wall_grow_as_breadth_first_search_grows_them(
    spread_m: float, rng: np.random.Generator
) -> None:
    """Offsets around what still counts as one plane, normals around what still counts as along an axis."""
    place = np.argwhere(rng.random((12, 16)) < 0.9).astype(np.int32)
    n = len(place)
    centroid = np.column_stack([place[:, 1] * 0.08, place[:, 0] * 0.08, np.full(n, 2.0)])
    centroid[:, 2] += rng.normal(0, spread_m, n)
    normal = np.column_stack([rng.normal(0, 0.1, (n, 2)), np.ones(n)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sigma = rng.uniform(0.0, 0.1, n)
    R, tolerance = look(2, 3, 1), np.deg2rad(8.0)
    plane, count = _grow(12, 16, place, normal, centroid, sigma, R, tolerance)
    expected = naive_room.grow(place, normal, centroid, sigma, R, tolerance)
    assert [set(np.flatnonzero(plane == i).tolist()) for i in range(count)] == expected
    assert count > 1


@pytest.mark.parametrize("off_deg", (1.0, 5.0, 12.0))
def test_refinement_turns_a_rough_start_onto_the_planes(off_deg: float) -> None:
    R = look(25, 12, 2)
    start = look(off_deg) @ R @ look(0, off_deg / 2, 0)
    refined = refine_on_planes(geometry_of(room_depth(R)), start)
    assert error_deg(refined, R) < 0.05


def test_without_planes_or_lines_refinement_leaves_the_start_as_it_is(rng: np.random.Generator) -> None:
    start = look(5)
    noise = rng.uniform(0.3, 8, (SMALL.height, SMALL.width)).astype(np.float32)
    np.testing.assert_array_equal(refine_on_planes(geometry_of(noise, SMALL), start), start)


def test_a_warm_start_finds_the_same_axes_and_a_wrong_one_is_dropped() -> None:
    R = look(25, 12, 2)
    geometry = geometry_of(room_depth(R))
    cold = estimate_manhattan_frame(geometry)
    warm = estimate_manhattan_frame(geometry, prior=look(2) @ R)
    wrong = estimate_manhattan_frame(geometry, prior=look(0, 0, 45) @ look(45) @ R)
    assert cold is not None
    assert warm is not None
    assert wrong is not None
    assert error_deg(warm.R_room_camera, cold.R_room_camera) < 0.02
    np.testing.assert_array_equal(wrong.R_room_camera, cold.R_room_camera)
    assert wrong.confidence == cold.confidence


def test_gravity_decides_which_axis_is_down() -> None:
    R = look(20, 5, 85)
    geometry = geometry_of(room_depth(R))
    found = estimate_manhattan_frame(geometry, gravity=3.0 * R[1])
    assert found is not None
    assert np.rad2deg(np.arccos(found.R_room_camera[1] @ R[1])) < 0.1


@pytest.mark.parametrize("what", ("noise", "waves", "few"))
def test_f31_no_planes_no_axes(what: str, rng: np.random.Generator) -> None:
    y, x = np.mgrid[: SMALL.height, : SMALL.width]
    depth = {
        "noise": rng.uniform(0.3, 8, y.shape),
        "waves": 2 + 0.5 * np.sin(x / 7) * np.cos(y / 6),
        "few": np.where((x < 40) & (y < 40), 2.0, np.nan),
    }[what].astype(np.float32)
    assert estimate_manhattan_frame(geometry_of(depth, SMALL)) is None


def test_one_wall_alone_leaves_the_camera_level() -> None:
    """Nothing tells the turn about a wall's normal but that cameras are held upright, or gravity."""
    wall = np.array([np.inf, np.inf, np.inf, 2.0, np.inf])
    for R in (look(0, 0), look(12, 0), look(-30, 0)):
        frame, _ = seen_from_inside(HALF, R, wall)
        assert frame.depth_m is not None
        found = estimate_manhattan_frame(geometry_of(frame.depth_m))
        assert found is not None
        assert error_deg(found.R_room_camera, R) < 0.1
    tilted = look(10, 0, 25)
    frame, _ = seen_from_inside(HALF, tilted, wall)
    assert frame.depth_m is not None
    found = estimate_manhattan_frame(geometry_of(frame.depth_m), gravity=9.81 * tilted[1])
    assert found is not None
    assert error_deg(found.R_room_camera, tilted) < 0.1


def test_one_floor_alone_points_the_axes_along_the_view() -> None:
    frame, _ = seen_from_inside(HALF, look(0, 60), np.array([np.inf, 1.3, np.inf, np.inf, np.inf]))
    assert frame.depth_m is not None
    found = estimate_manhattan_frame(geometry_of(frame.depth_m))
    assert found is not None
    assert error_deg(found.R_room_camera, look(0, 60)) < 0.1


def chequered(R: NDArray[np.float64], face: int, distance_m: float, turn_deg: float) -> tuple[RgbdFrame, LineSegments]:
    """One plane that fills the view of `HALF`, with squares of a fifth of its distance, turned about its normal."""
    empty = np.full(5, np.inf)
    empty[face] = distance_m
    frame, _ = seen_from_inside(HALF, R, empty)
    assert frame.depth_m is not None
    room = (HALF.rays() * frame.depth_m[..., None]) @ R.T
    a, b = room[..., 0], room[..., 2 if face == 1 else 1]
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    tile = 0.2 * distance_m
    dark = (np.floor((c * a + s * b) / tile) + np.floor((c * b - s * a) / tile)) % 2 == 0
    color = np.where(dark[..., None], np.uint8(60), np.uint8(200)).repeat(3, axis=2).astype(np.uint8)
    return RgbdFrame(HALF, color, frame.depth_m), compute_line_segments(color, EstimatorConfig())


@pytest.mark.parametrize("roll", (3, 8, 15, 20))
@pytest.mark.parametrize("yaw", (0, 20))
def test_lines_on_the_only_wall_tell_the_roll(yaw: float, roll: float) -> None:
    R = look(yaw, 0, roll)
    frame, segments = chequered(R, 3, 2.0, 0.0)
    assert frame.depth_m is not None
    found = estimate_manhattan_frame(geometry_of(frame.depth_m), segments)
    assert found is not None
    assert error_deg(found.R_room_camera, R) < 0.3


@pytest.mark.parametrize("turn", (0, 15, 30, 45))
def test_lines_on_the_only_floor_tell_the_turn(turn: float) -> None:
    R = look(0, 60)
    frame, segments = chequered(R, 1, 1.3, turn)
    assert frame.depth_m is not None
    found = estimate_manhattan_frame(geometry_of(frame.depth_m), segments)
    assert found is not None
    c, s = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    assert error_deg(found.R_room_camera, np.array([c * R[0] + s * R[2], R[1], c * R[2] - s * R[0]])) < 0.3


def test_gravity_goes_before_lines_on_a_wall() -> None:
    """A picture may hang askew."""
    R = look(10, 0, 5)
    frame, segments = chequered(R, 3, 2.0, 20.0)
    assert frame.depth_m is not None
    found = estimate_manhattan_frame(geometry_of(frame.depth_m), segments, gravity=R[1])
    assert found is not None
    assert error_deg(found.R_room_camera, R) < 0.3


def test_a_pattern_askew_on_the_only_wall_rolls_no_camera() -> None:
    """Wallpaper with stripes of 40 degrees."""
    frame, segments = chequered(look(10, 0), 3, 2.0, 40.0)
    assert frame.depth_m is not None
    found = estimate_manhattan_frame(geometry_of(frame.depth_m), segments)
    assert found is not None
    assert error_deg(found.R_room_camera, look(10, 0)) < 0.5


def test_few_or_scattered_lines_tell_nothing(rng: np.random.Generator) -> None:
    R = look(0, 0, 10)
    frame, segments = chequered(R, 3, 2.0, 0.0)
    assert frame.depth_m is not None
    scattered = rng.uniform((0, 0, 0, 0), (320, 240, 320, 240), (60, 4)).astype(np.float32)
    for points in (segments.points[:5], scattered):
        found = estimate_manhattan_frame(geometry_of(frame.depth_m), LineSegments(points))
        assert found is not None
        assert error_deg(found.R_room_camera, look(0, 0, 0)) < 3.5


def test_axes_come_from_lines_alone_where_there_is_no_depth() -> None:
    """Rooms with doors, windows and pictures; the goal of the RGB variant is 5 degrees on most frames."""
    rooms = SyntheticSource(frames=6, seed=21, noise="clean", walk=False, camera=HALF, options={"furniture": 0.0})
    errors = []
    for sample in good_samples(rooms):
        assert sample.frame.color is not None
        assert sample.truth is not None
        assert sample.truth.cuboid is not None
        found = find_axes(None, compute_line_segments(sample.frame.color, CONFIG), HALF, CONFIG, TemporalPrior())
        assert found is not None
        np.testing.assert_array_equal(found.hypotheses[1], other_front(found.hypotheses[0]))
        errors.append(error_deg(found.R_room_camera, sample.truth.cuboid.R_room_camera))
    assert np.mean(np.array(errors) < 5.0) >= 0.7, errors


def test_nothing_to_see_gives_nothing() -> None:
    assert find_axes(None, None, HALF, CONFIG, TemporalPrior()) is None
    assert find_axes(None, LineSegments(np.empty((0, 4), np.float32)), HALF, CONFIG, TemporalPrior()) is None


def test_lines_make_coarse_depth_more_precise() -> None:
    """Depth in steps of 8 cm (8-bit sensors): the edges of the room carry the precision."""
    with_lines: list[float] = []
    without: list[float] = []
    for R in VIEWS[:4]:
        frame, _ = seen_from_inside(HALF, R, ROOM)
        assert frame.color is not None
        assert frame.depth_m is not None
        coarse = geometry_of((np.round(frame.depth_m / 0.08) * 0.08).astype(np.float32))
        segments = compute_line_segments(frame.color, CONFIG)
        for lines, errors in ((segments, with_lines), (None, without)):
            found = estimate_manhattan_frame(coarse, lines)
            assert found is not None
            errors.append(error_deg(found.R_room_camera, R))
    assert np.mean(with_lines) < np.mean(without)
    assert max(with_lines) < 0.3


@pytest.mark.parametrize("yaw", [20, 30, 45])
def test_a_start_turned_about_the_vertical_is_left_though_floor_and_ceiling_agree(yaw: float) -> None:
    """Of a camera that looks down the floor alone is half of what it sees."""
    R = look(25, 35, 2)
    geometry = geometry_of(room_depth(R))
    turned = look(yaw) @ R
    found = estimate_manhattan_frame(geometry, prior=turned)
    assert found is not None
    assert error_deg(turned, R) > 15
    assert error_deg(found.R_room_camera, R) < 1.0
