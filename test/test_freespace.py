"""Free space: what is called free is free, what stands there is found, what is not seen is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, GREY, ahead_of, box, empty, free_space_of, no_estimate_of, with_truth
from naive_free_space import naive_cells, naive_hidden
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.cuboids import compute_object_cuboids
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.floor.depth_holes import close_holes
from room_layout_ros.core.floor.floor_cells import BLIND, BRIDGE, FINE, HOLE, OBSTACLE, SEEN, sum_floor_cells
from room_layout_ros.core.floor.floor_frame import floor_frame, room_outline, walls_on_floor
from room_layout_ros.core.floor.floor_pixels import OBSTACLE_PIXEL, WALL_PIXEL
from room_layout_ros.core.floor.floor_plane import FloorFit, FloorPlane, fit_floor
from room_layout_ros.core.floor.overhang import find_overhung
from room_layout_ros.core.floor.slow_error import remove_bias
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, FreeSpace, compute_free_space
from room_layout_ros.core.labels import CLUTTER, FLOOR
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import (
    CLEAN,
    KINECT,
    KINECT_NOISE,
    NOISES,
    SensorNoise,
    SyntheticRoom,
    camera_pose,
    render,
)
from room_layout_ros.datasets.synthetic.shapes import Material, Solid


def look(
    room: SyntheticRoom, noise: SensorNoise = CLEAN, height: float = 1.2, pitch: float = -0.35
) -> tuple[Sample, FreeSpace]:
    pose = camera_pose(-1.4, 0.0, height, 0.0, pitch)
    sample = render(room, KINECT, pose, noise, np.random.default_rng(3))
    return sample, free_space_of(sample.frame, with_truth(sample))


def places(sample: Sample, height: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (H, W, 3) in the floor frame of the truth, and its pose (4, 4) in the camera's."""
    assert sample.frame.depth_m is not None
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    T = floor_frame(sample.truth.down_camera, height)
    return (KINECT.rays() * sample.frame.depth_m[..., None] - T[:3, 3]) @ T[:3, :3], T


def cell_at(free_space: FreeSpace, x: float, y: float) -> int:
    i = int((y - free_space.origin_m[1]) / free_space.resolution_m)
    return int(free_space.grid[i, int((x - free_space.origin_m[0]) / free_space.resolution_m)])


def test_sums_equal_their_naive_twin() -> None:
    camera = CameraIntrinsics(64, 48, 52.5, 52.5, 31.5, 23.5)
    room = empty(box(0.3, 0.2, 0.3, 0.4), box(0.9, -0.4, 0.2, 1.6))
    sample = render(room, camera, camera_pose(-1.4, 0.1, 1.2, 0.1, -0.4), CLEAN)
    assert sample.frame.depth_m is not None
    depth = sample.frame.depth_m.copy()
    depth[40:44, 10:20] *= 1.3  # below the floor
    depth[5:20, 50:60] *= 1.5  # beyond a wall
    depth[30, ::3] = np.nan
    geometry = compute_depth_geometry(replace(sample.frame, depth_m=depth), CONFIG)
    assert geometry is not None
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    T = floor_frame(sample.truth.down_camera, sample.truth.camera_height_m)
    walls = walls_on_floor(sample.truth.cuboid, T)
    fit = FloorFit(sample.truth.down_camera, sample.truth.camera_height_m, np.full(24, 0.007), np.zeros((1, 1)), "")
    holes = close_holes(geometry.inverse_depth, np.full(geometry.inverse_depth.shape, FLOOR, np.uint8), None)
    labels = np.full(geometry.inverse_depth.shape, FLOOR, np.uint8)
    labels[:, 20:40] = CLUTTER
    cells = sum_floor_cells(geometry, holes.kind, labels, fit, T, walls, CONFIG)
    seen, obstacle, hole, gap, kinds = naive_cells(
        geometry, labels, T, 0.007, walls, cells.sums.shape[:2], 0.05, (0.02, 3.5, 2.0)
    )
    assert np.array_equal(cells.kind, kinds)
    assert np.count_nonzero(np.bincount(kinds.ravel(), minlength=7)) == 7, "every kind of pixel must occur"
    np.testing.assert_allclose(cells.sums[..., SEEN], seen, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(cells.sums[..., OBSTACLE], obstacle, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(cells.sums[..., HOLE], hole, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(cells.sums[..., BLIND], gap, rtol=1e-4, atol=1e-5)
    assert gap.max() > 0.1
    rows, cols = cells.sums.shape[:2]
    quarters = cells.stands.reshape(rows, FINE, cols, FINE).any(axis=(1, 3))
    assert np.array_equal(quarters, cells.sums[..., OBSTACLE] > 0)
    assert not cells.sums[..., BRIDGE].any(), "no picture, no bridge"


def test_the_floor_frame_is_that_of_rep_103() -> None:
    """Ahead on the floor is x, left is y, up is z, and the origin is below the camera."""
    pose = camera_pose(0.0, 0.0, 1.3, 0.7, -0.4, 0.05)
    T = pose @ floor_frame(np.array([0.0, 0.0, -1.0]) @ pose[:3, :3], 1.3)
    np.testing.assert_allclose(T[:3, 3], 0.0, atol=1e-9)
    np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(T[:2, 0], [np.cos(0.7), np.sin(0.7)], atol=1e-9)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    down = floor_frame(np.array([0.0, 0.0, 1.0]), 2.0)
    np.testing.assert_allclose(down[:3, 0], [0, -1, 0], atol=1e-9)


def test_outline_is_clipped_by_walls_and_grid() -> None:
    walls = np.array([[1.0, 0.0, 3.0, 3], [0.0, 1.0, 1.5, 2]])
    outline = room_outline(walls, (0.0, -4.0, 6.0, 4.0))
    assert sorted(map(tuple, outline.round(6).tolist())) == [(0.0, -4.0), (0.0, 1.5), (3.0, -4.0), (3.0, 1.5)]
    assert len(room_outline(np.array([[1.0, 0.0, -1.0, 3]]), (0.0, -4.0, 6.0, 4.0))) == 0


@pytest.mark.parametrize("noise", NOISES)
def test_floor_within_two_centimetres_and_a_degree_from_a_wrong_start(noise: str) -> None:
    room = empty(box(0.6, 0.3, 0.4, 0.5))
    pose = camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35)
    sample = render(room, KINECT, pose, NOISES[noise], np.random.default_rng(5))
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    down = np.array([0.0, 0.0, -1.0]) @ pose[:3, :3]
    tilted = down + np.array([0.0, 0.0, 0.025])
    start = FloorPlane(tilted / np.linalg.norm(tilted), 1.24, "tf")
    fit = fit_floor(geometry, with_truth(sample), CONFIG, start)
    assert fit is not None
    assert fit.source == "tf+depth"
    slow = 1.5 if noise == "stereo" else 1.0  # its slow error bends the floor itself
    assert abs(fit.distance_m - 1.2) < 0.02 * slow
    assert np.degrees(np.arccos(np.clip(fit.normal @ down, -1, 1))) < 0.6 * slow


def test_without_floor_in_view_the_prior_is_kept_or_nothing_is_said() -> None:
    sample = render(empty(), KINECT, camera_pose(0.0, 0.0, 1.2, 0.0, 0.5), CLEAN)
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    down = np.array([0.0, np.cos(0.5), -np.sin(0.5)])
    estimate = with_truth(sample)
    assert compute_free_space(geometry, estimate, CONFIG) is None
    assert compute_free_space(geometry, estimate, CONFIG, FloorPlane(down, float("nan"), "imu")) is None
    given = compute_free_space(geometry, estimate, CONFIG, FloorPlane(down, 1.2, "tf"))
    assert given is not None
    assert given.source == "tf"
    assert not (given.grid == FREE_CELL).any()


def test_gravity_alone_finds_the_height() -> None:
    sample, _ = look(empty())
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    plane = FloorPlane(sample.truth.down_camera, float("nan"), "imu")
    result = compute_free_space(geometry, with_truth(sample), CONFIG, plane)
    assert result is not None
    assert result.source == "imu+depth"
    assert result.camera_height_m == pytest.approx(1.2, abs=0.005)


@pytest.mark.parametrize(
    ("normal", "height", "message"),
    [([0.0, 1.0, 0.1], 1.0, "unit vector"), ([0.0, 1.0, 0.0], 0.0, "above 0"), ([0.0, 1.0, 0.0], np.inf, "above 0")],
)
def test_a_wrong_prior_is_refused(normal: list[float], height: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FloorPlane(np.array(normal), height)


def test_a_bed_that_is_labelled_floor_is_no_floor() -> None:
    """Lower floor is seen nearer than the bed's top: no free space beats a wrong one. What TF says is kept."""
    sample, _ = look(empty(Solid(0.6, 0.0, 0.0, 2.4, 1.1, 0.0, 0.5, 4, GREY, thing=1)))
    estimate = with_truth(sample)
    assert estimate.cuboid is not None
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    labels = np.where(estimate.labels == CLUTTER, FLOOR, estimate.labels).astype(np.uint8)
    on_bed = replace(estimate.cuboid, distances=estimate.cuboid.distances - np.array([0, 0.5, 0, 0, 0]))
    fooled = replace(estimate, labels=labels, cuboid=on_bed)
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    assert compute_free_space(geometry, fooled, CONFIG) is None
    given = compute_free_space(geometry, fooled, CONFIG, FloorPlane(sample.truth.down_camera, 1.2, "tf"))
    assert given is not None
    assert given.camera_height_m == pytest.approx(1.2, abs=0.01)


def test_the_slow_error_of_the_depth_is_measured_on_the_floor_and_taken_off() -> None:
    sample, _ = look(empty())
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    true = geometry.inverse_depth
    v, u = np.indices(true.shape)
    slow = 0.004 * np.sin(2 * np.pi * u / 400) * np.cos(2 * np.pi * v / 400)  # 0.1 px of a stereo camera
    wrong = (true + slow).astype(np.float32)
    estimate = with_truth(sample)
    fit = fit_floor(replace(geometry, inverse_depth=wrong), estimate, CONFIG)
    assert fit is not None
    right = wrong.copy()
    remove_bias(right, fit.bias)
    floor = estimate.labels == FLOOR
    assert np.std((right - true)[floor]) < 0.4 * np.std((wrong - true)[floor])
    empty_pixels = np.zeros_like(wrong)
    remove_bias(empty_pixels, fit.bias)
    assert not empty_pixels.any(), "what was not measured stays so"


def test_a_wall_settles_where_its_foot_is() -> None:
    sample, right = look(empty())
    estimate = with_truth(sample)
    assert estimate.cuboid is not None
    moved = replace(estimate.cuboid, distances=estimate.cuboid.distances + np.array([0, 0, 0, 0.04, 0]))
    result = free_space_of(sample.frame, replace(estimate, cuboid=moved))
    front, true = (next(row for row in walls if row[3] == 3) for walls in (result.walls, right.walls))
    assert front[2] == pytest.approx(true[2], abs=0.006)


def test_what_the_pictures_side_cuts_off_may_stand_in_the_margin() -> None:
    """A cell at the side of the picture, whose margin lies beside it, before a thing that the side cuts off."""
    pose = camera_pose(-1.4, 0.0, 1.2, 0.0, -0.45)
    sample = render(empty(box(0.6, 1.3, 0.5, 0.4)), KINECT, pose, CLEAN)
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    assert sample.truth.labels is not None
    assert (sample.truth.labels[:, 0] == CLUTTER).any(), "the picture's side must cut the box off"
    T = floor_frame(sample.truth.down_camera, 1.2)
    kind = np.where(sample.truth.labels == CLUTTER, OBSTACLE_PIXEL, WALL_PIXEL).astype(np.uint8)
    hidden = []
    for margin in (0.0, 0.1):
        grid = np.zeros((160, 120), np.int8)
        hidden.append(find_overhung(grid, geometry.inverse_depth, kind, KINECT, T, (0.0, -4.0, 0.05), 2.0, margin))
    assert not (hidden[0] & ~hidden[1]).any()
    assert (hidden[1] & ~hidden[0]).any()


def test_floor_below_a_sofa_is_not_free_even_where_a_table_hides_the_sofa() -> None:
    """A low sofa on feet of 10 cm; a table top before it, turned a little, leaves in view but 0 to 10 cm."""
    table = Solid(0.25, 0.0, 0.15, 0.8, 1.8, 0.68, 0.74, 7, GREY, thing=2)
    sample, free_space = look(empty(box(1.5, 0.0, 0.8, 0.4, bottom=0.1), table), height=1.16)
    local, _ = places(sample, 1.16)
    below = (np.abs(local[..., 2]) < 0.01) & (local[..., 0] > 2.55) & (np.abs(local[..., 1]) < 0.35)
    assert below.sum() > 500, "floor below the sofa has to be in the picture"
    assert not (ahead_of(free_space, (2.4, 3.3), 0.4) == FREE_CELL).any()
    assert (ahead_of(free_space, (0.0, 6.0), 0.4) == FREE_CELL).any()


def test_floor_below_a_bed_is_not_free_for_a_low_camera() -> None:
    """A bed on feet of 8 cm: from 34 cm the floor is in view to 60 cm behind its front."""
    bed = Solid(1.8, 0.0, 0.0, 2.0, 1.6, 0.08, 0.5, 5, GREY, thing=1)
    sample, free_space = look(empty(bed), height=0.34, pitch=-0.05)
    local, _ = places(sample, 0.34)
    below = (np.abs(local[..., 2]) < 0.01) & (local[..., 0] > 2.7) & (np.abs(local[..., 1]) < 0.6)
    assert below.sum() > 200, "floor far below the bed has to be in the picture"
    assert not (ahead_of(free_space, (2.2, 4.2), 0.75) == FREE_CELL).any()
    assert (ahead_of(free_space, (1.2, 1.9), 0.5) == FREE_CELL).mean() > 0.9


def test_a_low_camera_sees_the_floor_between_the_rows_of_its_picture() -> None:
    """From 30 cm two rows of pixels are two cells apart at 4 m: a pixel is as much floor as it covers."""
    _, free_space = look(empty(), height=0.3, pitch=-0.05)
    assert (ahead_of(free_space, (1.5, 4.0), 0.5) == FREE_CELL).mean() > 0.97


@pytest.mark.parametrize(("pitch", "scale"), [(-0.5, 1), (-0.1, 1), (0.2, 1), (-0.3, 5)])
def test_what_hides_the_space_over_cells_is_what_its_slow_twin_says(
    pitch: float, scale: int, rng: np.random.Generator
) -> None:
    """Places are passed over by tiles of the picture; none of those that are hidden may be among them."""
    width, height = 160 * scale, 120 * scale
    camera = CameraIntrinsics(width, height, 140.0 * scale, 140.0 * scale, 79.3 * scale, 60.2 * scale)
    normal = np.array([0.05, np.cos(pitch), -np.sin(pitch)])
    T = floor_frame(normal / np.linalg.norm(normal), 1.1)
    inverse = np.full((height, width), 1.0 / 7.0, np.float32)
    for _ in range(25 * scale):
        v, u = rng.integers(0, height - 10), rng.integers(0, width - 10)
        size = rng.integers(3, 30), rng.integers(3, 20) * scale**2
        inverse[v : v + size[0], u : u + size[1]] = rng.choice([0.0, 1 / rng.uniform(1.0, 6.0)])
    kind = np.where(rng.random((height, 1)) < 0.5, OBSTACLE_PIXEL, WALL_PIXEL).astype(np.uint8).repeat(width, axis=1)
    grid = np.where(rng.random((48, 36)) < 0.8, 0, -1).astype(np.int8)
    view = (inverse, kind, camera, T, (0.5, -2.5, 0.1), 2.0, 0.1)
    expected = naive_hidden(grid, *view)
    np.testing.assert_array_equal(np.where(find_overhung(grid, *view), -1, grid), expected)
    assert (expected == -1).any()
    assert (expected == 0).any()


def test_a_hole_in_the_floor_is_not_free() -> None:
    sample, _ = look(empty())
    assert sample.frame.depth_m is not None
    # 60 cm x 60 cm of the floor are 30 cm lower: stairs down
    local, _ = places(sample, 1.2)
    hole = (np.abs(local[..., 2]) < 0.01) & (np.abs(local[..., 0] - 2.0) < 0.3) & (np.abs(local[..., 1]) < 0.3)
    depth = np.where(hole, sample.frame.depth_m * (1.5 / 1.2), sample.frame.depth_m).astype(np.float32)
    result = free_space_of(replace(sample.frame, depth_m=depth), with_truth(sample))
    assert all(cell_at(result, x, y) == OCCUPIED_CELL for x in (1.8, 2.0, 2.2) for y in (-0.2, 0.0, 0.2))
    assert cell_at(result, 2.0, 0.5) == FREE_CELL


def test_stray_pixels_are_no_obstacles(rng: np.random.Generator) -> None:
    sample, clean = look(empty())
    assert sample.frame.depth_m is not None
    depth = sample.frame.depth_m.copy()
    ys, xs = rng.integers(300, 480, 150), rng.integers(0, 640, 150)
    depth[ys, xs] *= 0.8
    result = free_space_of(replace(sample.frame, depth_m=depth), with_truth(sample))
    assert ((clean.grid == FREE_CELL) & (result.grid == OCCUPIED_CELL)).sum() == 0
    assert ((clean.grid == FREE_CELL) & (result.grid != FREE_CELL)).sum() < 10


@pytest.mark.parametrize("drop_m", [0.15, 0.3, 0.75])
@pytest.mark.parametrize("noise", ["none", "kinect"])
def test_below_an_edge_nothing_is_free(drop_m: float, noise: str) -> None:
    """A step down over the whole width, of which the camera sees the lower floor: that is no noise of this floor."""
    sample, _ = look(empty())
    assert sample.frame.depth_m is not None
    local, _ = places(sample, 1.2)
    below = (np.abs(local[..., 2]) < 0.01) & (local[..., 0] > 2.0)
    depth = np.where(below, sample.frame.depth_m * (1.0 + drop_m / 1.2), sample.frame.depth_m)
    if noise == "kinect":
        depth = depth + np.random.default_rng(5).normal(size=depth.shape) * 0.0014 * depth * depth
    result = free_space_of(replace(sample.frame, depth_m=depth.astype(np.float32)), with_truth(sample))
    assert (result.grid[:, :40] == FREE_CELL).sum() > 100
    assert not (result.grid[:, 40:] == FREE_CELL).any()


def test_the_floor_is_that_on_which_the_camera_stands() -> None:
    """Two levels of like size, and a start between them, as a cuboid's floor is."""
    sample, _ = look(empty(), height=1.5, pitch=-0.5)
    assert sample.frame.depth_m is not None
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    local, T = places(sample, 1.5)
    below = (np.abs(local[..., 2]) < 0.01) & (local[..., 0] > 2.0)
    depth = np.where(below, sample.frame.depth_m * (1.65 / 1.5), sample.frame.depth_m).astype(np.float32)
    geometry = compute_depth_geometry(replace(sample.frame, depth_m=depth), CONFIG)
    assert geometry is not None
    down, ahead = sample.truth.down_camera, T[:3, 0]
    tilted = down * np.cos(0.07) - ahead * np.sin(0.07)
    between = FloorPlane(tilted / np.linalg.norm(tilted), 1.39, "tf")
    fit = fit_floor(geometry, with_truth(sample), CONFIG, between)
    assert fit is not None
    assert abs(fit.distance_m - 1.5) < 0.01
    assert np.rad2deg(np.arccos(fit.normal @ down)) < 0.3


def test_the_far_side_of_a_hole_is_not_free() -> None:
    """The wall below its far edge is seen a little below the floor, no deeper than noise."""
    sample, _ = look(empty(), height=1.5, pitch=-0.5)
    assert sample.frame.depth_m is not None
    place, T = places(sample, 1.5)
    rays = KINECT.rays() @ T[:3, :3]
    hole = (np.abs(place[..., 2]) < 0.01) & (np.abs(place[..., 0] - 2.3) < 0.5) & (np.abs(place[..., 1]) < 0.5)
    bottom, wall = sample.frame.depth_m * (2.0 / 1.5), 2.8 / np.maximum(rays[..., 0], 1e-6)
    depth = np.where(hole, np.minimum(bottom, wall), sample.frame.depth_m).astype(np.float32)
    result = free_space_of(replace(sample.frame, depth_m=depth), with_truth(sample))
    assert all(cell_at(result, x, y) != FREE_CELL for x in np.arange(1.825, 2.8, 0.05) for y in (-0.3, 0.0, 0.3))
    assert cell_at(result, 3.05, 0.0) == FREE_CELL


@pytest.mark.parametrize("side_px", [20, 40, 90])
def test_where_depth_is_missing_nothing_is_free_but_by_choice(side_px: int) -> None:
    sample, clean = look(empty())
    assert sample.frame.depth_m is not None
    first, last = slice(350 - side_px // 2, 350 + side_px // 2), slice(320 - side_px // 2, 320 + side_px // 2)
    depth = sample.frame.depth_m.copy()
    depth[first, last] = np.nan
    corner = clean.T_camera_floor[:3, 3]
    place = (KINECT.rays() * sample.frame.depth_m[..., None] - corner) @ clean.T_camera_floor[:3, :3]
    lost = replace(sample.frame, depth_m=depth)
    middle = place[350, 320]
    assert cell_at(clean, middle[0], middle[1]) == FREE_CELL
    for frame in (lost, replace(lost, color=None)):
        assert cell_at(free_space_of(frame, with_truth(sample)), middle[0], middle[1]) == -1
    geometry = compute_depth_geometry(lost, CONFIG)
    assert geometry is not None
    by_picture = EstimatorConfig(free_by_picture=True)
    chosen = compute_free_space(geometry, with_truth(sample), by_picture, color=lost.color)
    assert chosen is not None
    assert (cell_at(chosen, middle[0], middle[1]) == FREE_CELL) == (side_px < 90)
    no_picture = compute_free_space(geometry, with_truth(sample), by_picture)
    assert no_picture is not None
    assert cell_at(no_picture, middle[0], middle[1]) == -1


def test_a_thing_without_depth_is_not_free_even_when_it_is_labelled_floor() -> None:
    """Black plastic: infrared sees nothing there. Its outline in the picture keeps the hole from being plain floor."""
    thing = Solid(0.6, 0.0, 0.0, 0.08, 0.08, 0.0, 0.08, 5, Material((8, 8, 8)), thing=1)
    sample, _ = look(empty(thing))
    assert sample.frame.depth_m is not None
    assert sample.truth is not None
    assert sample.truth.labels is not None
    estimate = with_truth(sample)
    thing_px = sample.truth.labels == CLUTTER
    assert thing_px.sum() > 200
    lost = replace(sample.frame, depth_m=np.where(thing_px, np.nan, sample.frame.depth_m).astype(np.float32))
    result = free_space_of(lost, replace(estimate, labels=np.where(thing_px, FLOOR, estimate.labels).astype(np.uint8)))
    assert all(cell_at(result, 2.0 + dx, dy) != FREE_CELL for dx in (-0.12, -0.06, 0.0) for dy in (-0.03, 0.0, 0.03))


def test_behind_a_thing_nothing_is_known_and_before_it_nothing_is_free() -> None:
    _, result = look(empty(box(0.6, 0.0, 0.4, 0.5)))  # its front is 1.8 m ahead
    assert cell_at(result, 1.82, 0.0) == OCCUPIED_CELL
    assert cell_at(result, 1.72, 0.0) == -1
    assert cell_at(result, 1.62, 0.0) == FREE_CELL
    assert cell_at(result, 2.5, 0.0) == -1


def test_a_low_robot_passes_under_what_a_tall_one_hits() -> None:
    room = empty(Solid(0.6, 0.0, 0.0, 0.5, 0.5, 0.9, 0.95, 7, GREY, thing=1))
    pose = camera_pose(-1.4, 0.0, 0.4, 0.0, -0.05)
    sample = render(room, KINECT, pose, CLEAN)
    tall = free_space_of(sample.frame, with_truth(sample))
    low = free_space_of(sample.frame, with_truth(sample), replace(CONFIG, robot_height_m=0.6))
    assert cell_at(tall, 2.0, 0.0) != FREE_CELL
    assert cell_at(low, 2.0, 0.0) == FREE_CELL


@pytest.mark.parametrize(("sill_m", "stands"), [(0.014, False), (0.017, False), (0.03, True)])
def test_what_is_lower_than_the_lowest_obstacle_is_none(sill_m: float, stands: bool) -> None:
    """A door sill across the way; the mean height of its cells is told to a millimetre."""
    sill = Solid(0.4, 0.0, 0.0, 0.25, 1.6, 0.0, sill_m, 40, GREY, thing=1)
    sample = render(empty(sill), KINECT, camera_pose(-1.4, 0.0, 0.8, 0.0, -0.35), CLEAN)
    found = free_space_of(sample.frame, with_truth(sample))
    assert found is not None
    over = ahead_of(found, (1.7, 1.9), 0.5)
    assert (over == 100).any() == stands
    assert (ahead_of(found, (1.0, 1.6), 0.5) == FREE_CELL).mean() > 0.9


@pytest.mark.parametrize("robot_m", [0.08, 0.1, 0.15])
def test_a_robot_of_less_than_20_cm_is_kept_from_below_a_bed_too(robot_m: float) -> None:
    """Of a bed on feet of 6 cm the picture shows a row or two below the robot's height."""
    bed = Solid(1.8, 0.0, 0.0, 2.0, 1.6, 0.06, 0.5, 5, GREY, thing=1)
    sample = render(empty(bed), KINECT, camera_pose(-1.4, 0.0, 0.34, 0.0, -0.05), CLEAN)
    low = free_space_of(sample.frame, with_truth(sample), replace(CONFIG, robot_height_m=robot_m))
    assert low is not None
    assert not (ahead_of(low, (2.2, 4.2), 0.75) == FREE_CELL).any()
    assert (ahead_of(low, (1.2, 1.9), 0.5) == FREE_CELL).mean() > 0.9


def test_clouds_leave_walls_out_and_keep_small_things() -> None:
    sample, result = look(empty(box(0.1, 0.2, 0.04, 0.04)), KINECT_NOISE)
    assert sample.T_world_camera is not None
    world = result.obstacles @ sample.T_world_camera[:3, :3].T + sample.T_world_camera[:3, 3]
    near_thing = np.hypot(world[:, 0] - 0.1, world[:, 1] - 0.2) < 0.08
    assert near_thing.sum() >= 10
    assert near_thing.mean() > 0.5, "walls, ceiling and noise are not in the cloud"
    floor = result.floor @ sample.T_world_camera[:3, :3].T + sample.T_world_camera[:3, 3]
    assert len(floor) > 1000
    assert np.abs(floor[:, 2]).max() < 0.1


def test_a_board_flat_against_the_wall_keeps_its_own_margin() -> None:
    """3 cm before the wall, within its noise, it is told from it by its label: 10 cm before it nothing is free."""
    room = empty()
    wall = max(float(s.origin[0]) for s in room.surfaces)
    board = Solid(wall - 0.015, 0.0, 0.0, 0.03, 0.5, 0.0, 1.0, 3, GREY)
    pose = camera_pose(wall - 2.40, 0.0, 1.2, 0.0, -0.35)
    sample = render(empty(board), KINECT, pose, KINECT_NOISE, np.random.default_rng(3))
    result = free_space_of(sample.frame, with_truth(sample))
    for y in (0.05 * k + 0.025 for k in range(-4, 4)):
        assert cell_at(result, 2.225, y) == FREE_CELL
        assert cell_at(result, 2.275, y) != FREE_CELL


def test_scan_tells_range_free_and_unknown() -> None:
    room = empty(box(0.6, 0.0, 0.4, 0.5))
    sample, result = look(room)
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    scan = result.scan
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges_m))
    ahead = np.abs(angles) < 0.06
    np.testing.assert_allclose(scan.ranges_m[ahead], 1.8 / np.cos(angles[ahead]), atol=0.02)
    beside = np.flatnonzero((angles > 0.2) & (angles < 0.3))
    wall = sample.truth.cuboid.distances[3] / np.cos(angles[beside])
    assert np.all(np.abs(scan.ranges_m[beside] - wall) < 0.06)
    assert sample.frame.depth_m is not None
    depth = sample.frame.depth_m.copy()
    depth[:, :200] = np.nan
    depth[:330, 450:] = np.nan  # only the near floor is left there
    walls_unknown = replace(with_truth(sample), cuboid=None)
    geometry = compute_depth_geometry(replace(sample.frame, depth_m=depth), CONFIG)
    assert geometry is not None
    assert sample.truth.down_camera is not None
    half = compute_free_space(geometry, walls_unknown, CONFIG, FloorPlane(sample.truth.down_camera, 1.2, "tf"))
    assert half is not None
    assert np.isnan(half.scan.ranges_m[angles > 0.33]).all()
    assert np.isposinf(half.scan.ranges_m[angles < -0.33]).all()


def test_an_object_is_a_box_of_its_size() -> None:
    thing = Solid(0.6, 0.2, 0.3, 0.6, 0.4, 0.0, 0.7, 6, GREY, thing=1)
    sample, result = look(empty(thing))
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    (found,) = compute_object_cuboids(geometry, with_truth(sample), result, CONFIG)
    assert found.nyu40 == 6
    np.testing.assert_allclose(found.center_m[:2], [2.0, 0.2], atol=0.04)
    assert sorted(found.size_m[:2].round(2)) == pytest.approx([0.4, 0.6], abs=0.05)
    assert found.center_m[2] + found.size_m[2] / 2 == pytest.approx(0.7, abs=0.03)
    assert abs(np.sin(2 * (found.yaw - 0.3))) < 0.1  # modulo 90 degrees


def test_no_estimate_and_no_prior_gives_none() -> None:
    sample, _ = look(empty())
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    assert compute_free_space(geometry, no_estimate_of(sample), CONFIG) is None


def test_without_colour_the_picture_is_not_looked_at() -> None:
    """The picture closes a hole in the depth of plain floor; with `use_color` off it must not."""
    sample, _ = look(empty())
    assert sample.frame.depth_m is not None
    depth = sample.frame.depth_m.copy()
    depth[380:400, 300:340] = np.nan
    frame, config = replace(sample.frame, depth_m=depth), replace(CONFIG, use_color=False)
    blind = free_space_of(replace(frame, color=None), with_truth(sample), config)
    assert np.array_equal(free_space_of(frame, with_truth(sample), config).grid, blind.grid)
    assert not np.array_equal(free_space_of(frame, with_truth(sample)).grid, blind.grid)


def test_walls_of_the_room_are_no_things_with_the_floor_beyond_them_either() -> None:
    sample = render(empty(), KINECT, camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35))
    truth, open_walls = with_truth(sample), replace(CONFIG, free_beyond_walls=True)
    closed, opened = (free_space_of(sample.frame, truth, config) for config in (CONFIG, open_walls))
    assert len(closed.obstacles) == len(opened.obstacles) == 0
    assert (opened.grid == OCCUPIED_CELL).sum() > 50
    free = closed.grid == FREE_CELL
    assert (opened.grid[free] == FREE_CELL).mean() > 0.99
    # with a wall found a metre too near, there is floor behind it, and things
    assert truth.cuboid is not None
    near = RoomCuboid(truth.cuboid.R_room_camera, truth.cuboid.distances - np.array([0.0, 0.0, 0.0, 1.0, 0.0]))
    behind = free_space_of(sample.frame, replace(truth, cuboid=near), open_walls)
    assert (behind.grid[free] == FREE_CELL).mean() > 0.95
    assert len(behind.obstacles) > 1000


def test_the_robots_own_body_in_the_picture_is_left_out_by_the_least_depth() -> None:
    """A bumper that reaches 30 to 35 cm before the camera, along the lower edge of the picture."""
    sample, without = look(empty(), height=0.8, pitch=-0.2)
    assert sample.frame.depth_m is not None
    estimate, v = with_truth(sample), np.arange(KINECT.height)[:, None]
    body = (v > KINECT.height - 70) & (np.abs(np.arange(KINECT.width) - KINECT.cx) < 200)
    depth_m = np.where(body, np.float32(0.30) + (KINECT.height - v) * np.float32(0.05 / 70), sample.frame.depth_m)
    frame = replace(sample.frame, depth_m=depth_m.astype(np.float32))
    estimate = replace(estimate, labels=np.where(body, CLUTTER, estimate.labels).astype(np.uint8))
    geometry = compute_depth_geometry(frame, CONFIG)
    assert geometry is not None
    assert compute_free_space(geometry, estimate, CONFIG, color=frame.color) is None, "the camera may stand on a table"
    found = free_space_of(frame, estimate, replace(CONFIG, min_depth_m=0.45))
    assert not (found.scan.ranges_m < 0.5).any()
    assert not len(found.obstacles)
    assert (found.grid == FREE_CELL).sum() > 0.7 * (without.grid == FREE_CELL).sum()
