"""Integral geometry counts what the raster counts, however it is computed."""

from __future__ import annotations

import numpy as np
import pytest
from naive_integral_geometry import naive_face_tables, naive_pair_tables
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from room_layout_ros.core.accumulate import accumulate
from room_layout_ros.core.cell_counts import count_cells, lattice_shear
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.integral_geometry import face_counts, pair_tables
from room_layout_ros.core.layout_search import Layout, layout_energy
from room_layout_ros.core.ray_grid import QUADRANT_HORIZONTAL, QUADRANT_VERTICAL, RayGrid, compute_ray_grid

SMALL = CameraIntrinsics(48, 36, 39.0, 39.0, 23.6, 17.3)
FULL = CameraIntrinsics(640, 480, 519.0, 519.0, 319.5, 239.5)
WHOLE_CENTRE = CameraIntrinsics(49, 37, 20.0, 20.0, 24.0, 18.0)
"""Rays of its middle column and row lie in a plane of the axes, where the camera turns about one of them."""

POSES = {
    "at infinity: axes of the camera": (0.0, 0.0, 0.0),
    "depth vanishing point inside, others outside": (12.0, 8.0, 3.0),
    "two walls": (44.0, -7.0, 0.0),
    "rolled": (20.0, 10.0, 33.0),
    "on its side": (5.0, 5.0, 90.0),
    "looking down, horizon out of view": (10.0, 55.0, -4.0),
    "looking up": (-25.0, -50.0, 6.0),
    "looking straight down, vertical vanishing point inside": (3.0, 86.0, 0.0),
    "front wall behind the camera": (170.0, 4.0, 2.0),
    "front wall at the side": (88.0, 3.0, 1.0),
}


ABOUT_ONE_AXIS = ((0, 60, 0), (0, -60, 0), (0, 90, 0), (90, 0, 0), (-70, 0, 0), (180, 0, 0), (0, 180, 0), (0, 0, 90))


def rotation(pose: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(Rotation.from_euler("yxz", pose, degrees=True).as_matrix())


def random_layout(rng: np.random.Generator, grid: RayGrid) -> Layout:
    a, b, c, d = (int(rng.integers(n)) for n in grid.state_counts)
    return a, b, c, d


@pytest.fixture(params=tuple(POSES.values()), ids=tuple(POSES))
def pose(request: pytest.FixtureRequest) -> NDArray[np.float64]:
    return rotation(request.param)


def test_accumulators_of_alg_2_are_the_naive_ones(pose: NDArray[np.float64], rng: np.random.Generator) -> None:
    grid = compute_ray_grid(SMALL, pose, rays=4, angle_bins=40)
    feature = rng.integers(-50, 50, (36, 48)).astype(np.float64)
    for fast, slow in zip(accumulate(grid, feature), naive_face_tables(grid, feature), strict=True):
        for a, b in zip(fast, slow, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
            whole = b == np.round(b)  # no part of a shared bin: integers must agree exactly
            assert (np.abs(a[whole] - b[whole]) < 1e-10).all()


@pytest.mark.parametrize("turned", ABOUT_ONE_AXIS)
def test_rays_in_a_plane_of_the_axes_are_counted_as_naively(
    turned: tuple[float, float, float], rng: np.random.Generator
) -> None:
    grid = compute_ray_grid(WHOLE_CENTRE, rotation(turned), rays=4, angle_bins=40)
    feature = rng.integers(-50, 50, (37, 49)).astype(np.float64)
    for fast, slow in zip(accumulate(grid, feature), naive_face_tables(grid, feature), strict=True):
        for a, b in zip(fast, slow, strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    atoms = rng.integers(0, 9, (37, 49)).astype(np.int32)
    cost = rng.normal(size=(9, 5))
    tables = pair_tables(count_cells(grid, atoms, 9), cost)
    for a, b in zip(tables, naive_pair_tables(grid, cost[atoms]), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)


@pytest.mark.parametrize("turned", ABOUT_ONE_AXIS)
def test_a_ray_that_hits_nothing_is_in_no_face(turned: tuple[float, float, float], rng: np.random.Generator) -> None:
    grid = compute_ray_grid(WHOLE_CENTRE, rotation(turned), rays=4, angle_bins=40)
    counts = count_cells(grid, np.zeros((37, 49), np.int32), 1)
    for _ in range(60):
        layout = random_layout(rng, grid)
        absent = rng.uniform(size=4) < 0.5
        a, b, c, d = (int(n) - 1 if x else k for n, x, k in zip(grid.state_counts, absent, layout, strict=True))
        held = face_counts(counts, (a, b, c, d))[0]
        hit = (grid.cuboid((a, b, c, d)).raster(WHOLE_CENTRE) > 0).sum()
        assert held.sum() == pytest.approx(hit, abs=1e-9), (a, b, c, d)
        assert (held[[0, 1, 2, 4]][absent] == 0.0).all(), (a, b, c, d)


def test_a_cost_of_rays_that_hit_nothing_is_paid_by_them_alone(
    pose: NDArray[np.float64], rng: np.random.Generator
) -> None:
    grid = compute_ray_grid(SMALL, pose, rays=4, angle_bins=40)
    counts = count_cells(grid, rng.integers(0, 9, (36, 48)).astype(np.int32), 9)
    cost, faceless = rng.normal(size=(9, 5)), rng.normal(size=9)
    tables = pair_tables(counts, cost, faceless)
    absent = tuple(int(n) - 1 for n in grid.state_counts)
    layouts = [random_layout(rng, grid) for _ in range(10)]
    for layout in (*layouts, (absent[0], absent[1], absent[2], absent[3])):
        held = face_counts(counts, layout)
        expected = (held * cost).sum() + (counts.pixels - held.sum(axis=1)) @ faceless
        assert layout_energy(tables, layout) == pytest.approx(float(expected), abs=1e-9)


def test_sparse_counts_give_the_accumulators_of_every_pixel(
    pose: NDArray[np.float64], rng: np.random.Generator
) -> None:
    grid = compute_ray_grid(SMALL, pose, rays=4, angle_bins=40)
    atoms = rng.integers(0, 9, (36, 48)).astype(np.int32)
    cost = rng.normal(size=(9, 5))
    tables = pair_tables(count_cells(grid, atoms, 9), cost)
    for a, b in zip(tables, naive_pair_tables(grid, cost[atoms]), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)


def test_all_histograms_hold_the_same_integers(pose: NDArray[np.float64]) -> None:
    grid = compute_ray_grid(FULL, pose)
    blocks = (np.add.outer(np.arange(480) // 40 * 16, np.arange(640) // 40)).astype(np.int32)
    counts = count_cells(grid, blocks, 192)
    assert counts.pixels.tolist() == np.bincount(blocks.ravel()).tolist()
    front, side, top = accumulate(grid, np.ones((480, 640)))
    alone = [pair_tables(counts, np.tile(np.eye(5)[k], (192, 1))) for k in range(5)]
    for q in range(4):
        np.testing.assert_allclose(alone[3][q], front[q], atol=1e-7)
        np.testing.assert_allclose(alone[(2, 4, 2, 4)[q]][q], side[q], atol=1e-7)
        np.testing.assert_allclose(alone[(0, 0, 1, 1)[q]][q], top[q], atol=1e-7)


def test_faces_hold_as_many_pixels_as_the_raster_within_a_thousandth_of_the_image(
    pose: NDArray[np.float64], rng: np.random.Generator
) -> None:
    grid = compute_ray_grid(FULL, pose)
    counts = count_cells(grid, np.zeros((480, 640), np.int32), 1)
    for _ in range(12):
        layout = random_layout(rng, grid)
        raster = grid.cuboid(layout).raster(FULL)
        truth = np.bincount(raster.ravel(), minlength=6)[1:]
        counted = face_counts(counts, layout)[0]
        assert np.abs(counted - truth).max() < 0.001 * raster.size, layout
        assert counted.sum() == pytest.approx(truth.sum(), abs=1e-6)


def test_random_poses_stay_within_the_binning_error(rng: np.random.Generator) -> None:
    errors = []
    for _ in range(24):
        grid = compute_ray_grid(FULL, np.asarray(Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()))
        counts = count_cells(grid, np.zeros((480, 640), np.int32), 1)
        layout = random_layout(rng, grid)
        truth = np.bincount(grid.cuboid(layout).raster(FULL).ravel(), minlength=6)[1:]
        errors.append(np.abs(face_counts(counts, layout)[0] - truth).max() / FULL.width / FULL.height)
    assert max(errors) < 0.001
    assert np.mean(errors) < 0.0002


@pytest.mark.parametrize("centre", ((319.5, 239.5), (320.0, 240.0)))
@pytest.mark.parametrize(
    ("turned", "line_px"),
    (((90.0, 0.0, 0.0), 640), ((89.9, 0.0, 0.0), 640), ((0.0, 90.0, 0.0), 480), ((0.0, -90.0, 0.0), 480)),
)
def test_where_a_line_of_pixels_has_one_angle_a_quadrant_errs_by_less_than_that_line(
    turned: tuple[float, float, float], line_px: int, centre: tuple[float, float]
) -> None:
    """The worst of all pairs of states: a face, which takes from two quadrants, is within 0.4 % of the image."""
    grid = compute_ray_grid(CameraIntrinsics(640, 480, 519.0, 519.0, *centre), rotation(turned))
    side = accumulate(grid, np.ones((480, 640)))[1]
    y, x = np.mgrid[:480, :640]
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ grid.ray_matrix.T
    quadrant = 2 * (rays[..., 1] >= 0) + (rays[..., 0] >= 0)
    worst = []
    for q in range(4):
        (dx, dy), dz = np.abs(rays[quadrant == q].T[:2]), rays[quadrant == q].T[2]
        vertical = grid.side_states(QUADRANT_VERTICAL[q])
        for j, a in enumerate(grid.side_states(QUADRANT_HORIZONTAL[q])[:-1]):
            beyond = dx > a * dz
            slope = np.sort(np.divide(dy, dx, out=np.full(len(dx), np.inf), where=dx > 0)[beyond])
            truth = np.searchsorted(slope, vertical / a, side="right")
            worst.append(np.abs(side[q][:, j] - truth).max())
    assert max(worst) < line_px


def test_absent_faces_hold_nothing(rng: np.random.Generator) -> None:
    grid = compute_ray_grid(FULL, rotation((12.0, 8.0, 3.0)))
    counts = count_cells(grid, np.zeros((480, 640), np.int32), 1)
    a, b, c, d = (int(n) - 1 for n in grid.state_counts)
    absent = (a, b, c, d)
    middle = (a // 2, b // 2, c // 2, d // 2)
    for side, face in enumerate((0, 1, 2, 4)):
        a, b, c, d = (absent[s] if s == side else middle[s] for s in range(4))
        held = face_counts(counts, (a, b, c, d))[0]
        assert held[face] == 0.0
        assert held.sum() == pytest.approx(640 * 480)
    assert face_counts(counts, absent)[0].tolist() == [0, 0, 0, 640 * 480, 0]


def test_tables_give_the_cost_of_counting_one_layout(pose: NDArray[np.float64], rng: np.random.Generator) -> None:
    grid = compute_ray_grid(SMALL, pose, rays=9, angle_bins=60)
    atoms = rng.integers(0, 12, (36, 48)).astype(np.int32)
    counts = count_cells(grid, atoms, 12)
    cost = rng.normal(size=(12, 5))
    tables = pair_tables(counts, cost)
    for _ in range(20):
        layout = random_layout(rng, grid)
        assert layout_energy(tables, layout) == pytest.approx(
            float((face_counts(counts, layout) * cost).sum()), abs=1e-9
        )


def test_a_coarse_lattice_counts_the_same_shares(rng: np.random.Generator) -> None:
    grid = compute_ray_grid(FULL, rotation((20.0, 10.0, 3.0)))
    atoms = np.zeros((480, 640), np.int32)
    every, fifth = count_cells(grid, atoms, 1), count_cells(grid, atoms, 1, pixel_step=5)
    assert fifth.pixels[0] == 640 * 480 / 5
    for _ in range(20):
        layout = random_layout(rng, grid)
        a, b = face_counts(every, layout)[0], face_counts(fifth, layout)[0] * 5
        assert np.abs(a - b).max() < 0.001 * 640 * 480


def test_faces_counted_as_inference_counts_them_hold_as_many_pixels_as_the_raster(
    pose: NDArray[np.float64], rng: np.random.Generator
) -> None:
    """Issue 3: below 0.1 % of the image, by the lattice and the bins that the estimator uses."""
    config = EstimatorConfig()
    assert config.layout_pixel_step > 1
    grid = compute_ray_grid(FULL, pose, config.layout_rays, config.layout_angle_bins)
    counts = count_cells(grid, np.zeros((480, 640), np.int32), 1, config.layout_pixel_step)
    for _ in range(12):
        layout = random_layout(rng, grid)
        truth = np.bincount(grid.cuboid(layout).raster(FULL).ravel(), minlength=6)[1:]
        counted = config.layout_pixel_step * face_counts(counts, layout)[0]
        assert np.abs(counted - truth).max() < 0.001 * 640 * 480, layout


def test_lattice_of_one_in_five_is_the_knights_move() -> None:
    assert lattice_shear(5) in (2, 3)
    assert lattice_shear(1) == 0


def test_pixels_left_out_count_nowhere() -> None:
    grid = compute_ray_grid(SMALL, rotation((20.0, 10.0, 3.0)), rays=5)
    atoms = np.zeros((36, 48), np.int32)
    atoms[:10] = -1
    counts = count_cells(grid, atoms, 1)
    assert counts.pixels.tolist() == [26 * 48]
    assert face_counts(counts, (2, 2, 2, 2)).sum() == pytest.approx(26 * 48)


def test_nearest_finds_the_layout_of_its_own_cuboid(pose: NDArray[np.float64], rng: np.random.Generator) -> None:
    grid = compute_ray_grid(FULL, pose)
    layout = random_layout(rng, grid)
    assert grid.nearest(grid.cuboid(layout, 2.5)) == layout


def test_bad_input_is_refused_in_a_sentence() -> None:
    grid = compute_ray_grid(SMALL, np.eye(3), rays=5)
    with pytest.raises(ValueError, match=r"atoms are int32 \(3, 3\); int32 \(36, 48\) is needed"):
        count_cells(grid, np.zeros((3, 3), np.int32), 1)
    with pytest.raises(ValueError, match="an atom has number 4; below 4 was announced"):
        count_cells(grid, np.full((36, 48), 4, np.int32), 4)
    with pytest.raises(ValueError, match="it must be a rotation matrix"):
        compute_ray_grid(SMALL, np.zeros((3, 3)))
    with pytest.raises(ValueError, match="allowed are 2 to 400"):
        compute_ray_grid(SMALL, np.eye(3), rays=1)
    with pytest.raises(ValueError, match="has no state 99 on side 2"):
        grid.cuboid((0, 0, 99, 0))
