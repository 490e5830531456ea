"""Depth as inverse depth, and planes of cells: equal to the naive way, exact on analytic planes."""

from __future__ import annotations

import naive_room
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import SMALL, TINY, look, seen_from_inside

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import (
    CELL_PX,
    MOMENTS,
    DepthGeometry,
    _cell_moments,
    compute_depth_geometry,
    fit_cell_planes,
    plane_of_moments,
)
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame

CONFIG = EstimatorConfig()
MIDDLE = CameraIntrinsics(80, 60, 65.0, 66.0, 39.0, 30.5)
ODD = CameraIntrinsics(67, 45, 60.0, 58.0, 30.1, 25.3)
NOT_MEASURED = [np.nan, 0.0, -1.0, np.inf, -np.inf, 1e-40, 0.19, 12.1, 1e38]


def geometry_of(frame: RgbdFrame) -> DepthGeometry:
    geometry = compute_depth_geometry(frame, CONFIG)
    assert geometry is not None
    return geometry


def noisy_inverse(rng: np.random.Generator, camera: CameraIntrinsics) -> NDArray[np.float32]:
    w = rng.uniform(0.1, 2.0, (camera.height, camera.width)).astype(np.float32)
    w[rng.random(w.shape) < 0.2] = 0.0
    return w


@pytest.mark.parametrize("camera", [TINY, ODD])
def test_the_sums_of_the_cells_equal_adding_pixel_by_pixel(camera: CameraIntrinsics, rng: np.random.Generator) -> None:
    inverse = noisy_inverse(rng, camera)
    fast = _cell_moments(inverse, CELL_PX, camera.fx, camera.fy, camera.cx, camera.cy)
    assert fast.shape == (camera.height // CELL_PX, camera.width // CELL_PX, MOMENTS)
    slow = naive_room.cell_moments(inverse, CELL_PX, camera)
    np.testing.assert_allclose(fast, slow, rtol=1e-7, atol=1e-9)  # w is float32


@pytest.mark.parametrize("value", NOT_MEASURED)
def test_f22_what_is_not_a_distance_is_not_measured(value: float) -> None:
    depth = np.full((TINY.height, TINY.width), 2.0, np.float32)
    depth[5:25, 7:30] = value
    geometry = geometry_of(RgbdFrame(TINY, None, depth))
    assert (geometry.inverse_depth[5:25, 7:30] == 0).all()
    assert geometry.measured == pytest.approx(1 - 20 * 23 / depth.size)
    points = geometry.points()
    assert np.isnan(points[5:25, 7:30]).all()
    np.testing.assert_allclose(points[:5, :, 2], 2.0)
    assert compute_depth_geometry(RgbdFrame(TINY, None, np.full_like(depth, value)), CONFIG) is None


def test_the_limits_of_depth_belong_to_it() -> None:
    depth = np.full((TINY.height, TINY.width), np.nan, np.float32)
    depth[0], depth[1] = 0.25, 8.0
    config = EstimatorConfig(min_depth_m=0.25, max_depth_m=8.0)
    geometry = compute_depth_geometry(RgbdFrame(TINY, None, depth), config)
    assert geometry is not None
    assert geometry.measured == pytest.approx(2 / 30)


def test_too_little_depth_is_none_and_so_is_unwanted_depth() -> None:
    depth = np.full((100, 100), np.nan, np.float32)
    camera = CameraIntrinsics(100, 100, 90.0, 90.0, 49.5, 49.5)
    depth.ravel()[:199] = 1.0
    assert compute_depth_geometry(RgbdFrame(camera, None, depth), CONFIG) is None
    depth.ravel()[199] = 1.0
    assert compute_depth_geometry(RgbdFrame(camera, None, depth), CONFIG) is not None
    assert compute_depth_geometry(RgbdFrame(camera, None, depth), EstimatorConfig(use_depth=False)) is None


def test_memory_that_is_not_contiguous_gives_the_same_sums() -> None:
    frame, _ = seen_from_inside()
    assert frame.depth_m is not None
    big = np.repeat(frame.depth_m, 2, axis=1)
    strided = geometry_of(RgbdFrame(SMALL, None, big[:, ::2]))
    np.testing.assert_array_equal(strided.moments, geometry_of(frame).moments)


def test_points_are_where_the_room_is_and_a_stride_takes_every_nth() -> None:
    frame, room = seen_from_inside()
    geometry = geometry_of(frame)
    points = geometry.points()
    in_room = points @ room.R_room_camera.T
    floor = room.raster(SMALL) == 2
    np.testing.assert_allclose(in_room[floor, 1], room.distances[1], rtol=1e-5)
    np.testing.assert_array_equal(geometry.points(3), points[::3, ::3])


@pytest.mark.parametrize("radius", [0, 1])
def test_windows_equal_least_squares_over_their_pixels(radius: int, rng: np.random.Generator) -> None:
    frame, _ = seen_from_inside(MIDDLE, look(25, 10))
    assert frame.depth_m is not None
    depth = frame.depth_m + rng.normal(0, 0.01, frame.depth_m.shape).astype(np.float32)
    depth[rng.random(depth.shape) < 0.3] = np.nan
    depth[:12, :12] = np.nan
    geometry = geometry_of(RgbdFrame(MIDDLE, None, depth))
    fast = fit_cell_planes(geometry, radius)
    slow = naive_room.fit_windows(geometry.inverse_depth, CELL_PX, radius, 2.5, MIDDLE)
    assert len(slow) == len(fast.cell) > 1
    for i, (row, col, normal, distance, centroid) in enumerate(slow):
        assert (row, col) == tuple(fast.cell[i])
        np.testing.assert_allclose(fast.normal[i], normal, atol=1e-6)
        assert fast.distance[i] == pytest.approx(distance, rel=1e-6)
        np.testing.assert_allclose(fast.centroid[i], centroid, rtol=1e-6, atol=1e-9)


def test_planes_of_an_analytic_room_are_the_rooms_planes() -> None:
    frame, room = seen_from_inside()
    planes = fit_cell_planes(geometry_of(frame))
    truth = room.inverse_normals * room.distances[:, None]
    faces = room.raster(SMALL)[planes.cell[:, 0] * CELL_PX + 5, planes.cell[:, 1] * CELL_PX + 5]
    cosine = np.einsum("ij,ij->i", planes.normal, truth[faces - 1])
    flat = cosine > np.cos(np.deg2rad(0.2))
    assert flat.mean() > 0.6, "windows within one face"
    np.testing.assert_allclose(planes.distance[flat], room.distances[faces - 1][flat], rtol=0.01)
    assert np.isfinite(planes.sigma).all()
    assert (planes.sigma > 0).all()


def test_a_step_in_depth_has_no_plane() -> None:
    depth = np.full((SMALL.height, SMALL.width), 2.0, np.float32)
    depth[:, 80:] = 3.0
    planes = fit_cell_planes(geometry_of(RgbdFrame(SMALL, None, depth)))
    assert not np.isin(planes.cell[:, 1], (7, 8)).any(), "windows over the step"
    assert {2, 5, 10, 13} <= set(planes.cell[:, 1].tolist())


def test_a_plane_of_summed_cells_is_exact_and_rays_on_a_line_span_none() -> None:
    depth = (1 / (0.4 + 0.1 * SMALL.rays()[..., 0] - 0.05 * SMALL.rays()[..., 1])).astype(np.float32)
    moments = geometry_of(RgbdFrame(SMALL, None, depth)).moments
    m, (x, y, w), det, spread, residual = plane_of_moments(moments.sum(axis=(0, 1)))
    np.testing.assert_allclose(m, [0.1, -0.05, 0.4], atol=1e-6)
    assert w == pytest.approx(m @ np.array([x, y, 1.0]), abs=1e-9)
    rays = SMALL.rays().reshape(-1, 3)
    np.testing.assert_allclose(spread, rays[:, :2].var(axis=0), rtol=0.01)
    assert det == pytest.approx(np.linalg.det(np.cov(rays[:, :2].T)), rel=0.02)
    assert residual < 1e-12
    on_a_line = np.array([4.0, 6.0, 0.0, 2.0, 14.0, 0.0, 0.0, 3.0, 0.0, 1.0])
    assert plane_of_moments(on_a_line)[2] == 0.0


def test_an_image_smaller_than_a_cell_has_no_cells() -> None:
    camera = CameraIntrinsics(9, 200, 9.0, 9.0, 4.0, 99.0)
    geometry = geometry_of(RgbdFrame(camera, None, np.full((200, 9), 2.0, np.float32)))
    assert geometry.moments.shape == (20, 0, MOMENTS)
    assert len(fit_cell_planes(geometry).cell) == 0


def test_zero_is_not_measured_even_where_zero_is_allowed() -> None:
    depth = np.full((48, 64), 2.0, np.float32)
    depth[:10] = 0.0
    camera = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    geometry = compute_depth_geometry(RgbdFrame(camera, None, depth), EstimatorConfig(min_depth_m=0.0))
    assert geometry is not None
    assert not geometry.inverse_depth[:10].any()
    assert (geometry.inverse_depth[10:] == 0.5).all()
