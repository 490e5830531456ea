"""The cuboid fitted to cells: kernels equal their twins, and with the classes known the room is found exactly."""

from __future__ import annotations

import naive_room
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF, ROOM, SMALL, look, seen_from_inside

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import CELL_PX, compute_depth_geometry
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid
from room_layout_ros.core.room_axes import angle_between_axes
from room_layout_ros.core.room_balance import _balance, balance_faces
from room_layout_ros.core.room_cells import RoomCells, _cell_means, room_cells
from room_layout_ros.core.room_cost import COSTS, FittedRoom, cell_costs, mean_cost
from room_layout_ros.core.room_refinement import refine_room
from room_layout_ros.core.room_search import _candidates, search_room
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import SyntheticSource

F64 = NDArray[np.float64]
CONFIG = EstimatorConfig()
CLUTTERED = ((0.25, 0, 25), (0.35, 0, 25))


def cells_of(frame: RgbdFrame, labels: NDArray[np.uint8]) -> RoomCells:
    """Cells whose probabilities are the true labels."""
    geometry = compute_depth_geometry(frame, CONFIG)
    assert geometry is not None
    behind = np.eye(5)[np.where(labels == CLUTTER, 0, labels - 1)]
    return room_cells(geometry, np.eye(6), labels.astype(np.int32) - 1, behind)


def random_cells(rng: np.random.Generator, n: int) -> RoomCells:
    w = rng.uniform(0.1, 1.5, n)
    w[rng.random(n) < 0.2] = 0.0
    rays = np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)), np.ones(n)])
    labels, faces = rng.dirichlet(np.ones(6), n), rng.dirichlet(np.ones(5), n)
    return RoomCells(rays, w, labels * rng.uniform(0.7, 1.0, (n, 1)), faces)


def random_room(rng: np.random.Generator) -> tuple[F64, F64]:
    distances = rng.uniform(0.5, 4.0, 5)
    distances[rng.random(5) < 0.25] = np.inf
    return look(*rng.uniform(-40, 40, 3)), distances


def hidden_walls(sample: Sample) -> list[float]:
    """Share of each visible wall (> 2 % of the image) that clutter hides."""
    assert sample.truth is not None
    assert sample.truth.layout is not None
    assert sample.truth.labels is not None
    walls = [sample.truth.layout == wall for wall in (3, 4, 5)]
    return [float((sample.truth.labels[wall] == CLUTTER).mean()) for wall in walls if wall.mean() > 0.02]


# --- the kernels and their twins ---------------------------------------------------------------------------------


def test_the_cost_equals_the_cost_cell_by_cell(rng: np.random.Generator) -> None:
    costs = rng.uniform(0.05, 1.5, 10)
    for _ in range(30):
        cells = random_cells(rng, 60)
        R, distances = random_room(rng)
        arrays = (cells.rays, cells.inverse_depth, cells.probability, cells.behind, R, distances)
        fast = mean_cost(cell_costs(cells, costs).terms, R, distances, costs, 60, np.inf)
        assert fast == pytest.approx(naive_room.mean_cost(*arrays, costs), rel=1e-10)


def test_a_cost_above_the_limit_is_infinite_and_below_it_is_exact(rng: np.random.Generator) -> None:
    cells = random_cells(rng, 640)
    R, distances = random_room(rng)
    arrays = (cell_costs(cells).terms, R, distances, COSTS, 640)
    cost = mean_cost(*arrays, np.inf)
    assert mean_cost(*arrays, cost * 1.01) == cost
    assert mean_cost(*arrays, cost * 0.5) == np.inf


def test_the_balance_equals_counting_cell_by_cell(rng: np.random.Generator) -> None:
    for _ in range(20):
        cells = random_cells(rng, 80)
        R, distances = random_room(rng)
        m = FACE_SIGN[:, None] * R[FACE_AXIS] / distances[:, None]
        fast = _balance(cells.rays, cells.inverse_depth, cells.probability, m, distances)
        slow = naive_room.balance(cells.rays, cells.inverse_depth, cells.probability, R, distances)
        # the kernel counts 1 - p(clutter), the twin the five faces: the same where probabilities sum to 1
        np.testing.assert_array_equal(fast[:, 1:], slow[:, 1:])
        assert (fast[:, 0] >= slow[:, 0] - 1e-9).all()
        whole = cells.probability / cells.probability.sum(axis=1, keepdims=True)
        fast = _balance(cells.rays, cells.inverse_depth, whole, m, distances)
        slow = naive_room.balance(cells.rays, cells.inverse_depth, whole, R, distances)
        np.testing.assert_allclose(fast, slow, atol=1e-9)


@pytest.mark.parametrize(("height", "width", "size"), ((40, 60, 10), (47, 33, 10), (21, 20, 7)))
def test_cell_means_equal_slicing(height: int, width: int, size: int, rng: np.random.Generator) -> None:
    index = rng.integers(0, 9, (height, width)).astype(np.int32)
    values = rng.random((9, 6))
    fast = _cell_means(index, values, height // size, width // size, size)
    np.testing.assert_allclose(fast, naive_room.cell_means(index, values, size), rtol=1e-12)


@pytest.mark.parametrize("measured", (0, 8, 200))
def test_the_candidates_are_the_modes_and_extents_that_numpy_finds(measured: int, rng: np.random.Generator) -> None:
    cells, R = random_cells(rng, 700), look(*rng.uniform(-20, 20, 3))
    cells.inverse_depth[measured:] = 0.0
    table, sizes = _candidates(cells.rays, cells.inverse_depth, cells.probability, R)
    expected = naive_room.candidates(cells.rays, cells.inverse_depth, cells.probability, R)
    for face in range(5):
        np.testing.assert_allclose(table[face, : sizes[face]], expected[face], rtol=1e-12)


def test_any_first_part_of_the_cells_is_spread_over_the_image() -> None:
    frame, room = seen_from_inside(HALF)
    cells = cells_of(frame, room.raster(HALF))
    assert len(cells.rays) == (HALF.height // CELL_PX) * (HALF.width // CELL_PX)
    part = cells.rays[: len(cells.rays) // 7]
    for axis in (0, 1):
        counts, _ = np.histogram(part[:, axis], 4)
        assert counts.min() > 0.7 * counts.mean()


# --- fits ----------------------------------------------------------------------------------------------------------


def test_an_exact_room_costs_nothing_but_its_faces_and_every_other_room_costs_more(rng: np.random.Generator) -> None:
    frame, room = seen_from_inside(HALF)
    cells = cells_of(frame, room.raster(HALF))
    seen = np.where(np.isin(np.arange(1, 6), room.raster(HALF)), room.distances, np.inf)
    terms, R = cell_costs(cells).terms, room.R_room_camera
    best = mean_cost(terms, R, seen, COSTS, len(cells.rays), np.inf)
    assert best < COSTS[3] * 5 + 0.06  # cells across an edge of the room are of two kinds
    for _ in range(20):
        moved = seen * rng.uniform(0.8, 1.25, 5)
        assert mean_cost(terms, R, moved, COSTS, len(cells.rays), np.inf) > best


@pytest.mark.parametrize("R", [look(20, 8, 1.5), look(-35, 5), look(3, 15, -2)])
def test_search_comes_near_and_refinement_arrives(R: F64) -> None:
    frame, room = seen_from_inside(HALF, R)
    raster = room.raster(HALF)
    seen = np.bincount(raster.ravel(), minlength=6)[1:] > 500
    cells = cell_costs(cells_of(frame, raster))
    start = search_room(cells, look(0.7, -0.4, 0.5) @ R)
    assert np.abs(start.distances - ROOM)[seen].max() < 0.15
    fitted = refine_room(cells, start)
    assert fitted.cost <= start.cost + 1e-9
    assert np.rad2deg(angle_between_axes(fitted.R_room_camera, R)) < 0.1
    assert np.abs(fitted.distances - ROOM)[seen].max() < 0.005
    assert (RoomCuboid(fitted.R_room_camera, fitted.distances).raster(HALF) != raster).mean() < 0.005


def test_faces_out_of_view_are_not_made_up() -> None:
    frame, room = seen_from_inside(HALF, look(0, 5), np.array([np.inf, 1.3, np.inf, 3.0, np.inf]))
    cells = cell_costs(cells_of(frame, room.raster(HALF)))
    fitted = refine_room(cells, search_room(cells, look(0, 5)))
    np.testing.assert_array_equal(np.isinf(fitted.distances), [True, False, True, False, True])


def test_where_nothing_is_measured_and_nothing_known_the_search_still_ends() -> None:
    rays = np.column_stack([np.zeros((60, 2)), np.ones(60)])
    cells = RoomCells(rays, np.zeros(60), np.zeros((60, 6)), np.zeros((60, 5)))
    fitted = refine_room(cell_costs(cells), search_room(cell_costs(cells), np.eye(3)))
    assert np.isfinite(fitted.cost)
    assert not np.isnan(fitted.distances).any()


def test_refinement_does_not_touch_its_start() -> None:
    frame, room = seen_from_inside(SMALL)
    cells = cell_costs(cells_of(frame, room.raster(SMALL)))
    start = FittedRoom(look(19, 8, 1), ROOM + 0.03, 1.0)
    before = start.R_room_camera.copy(), start.distances.copy()
    refine_room(cells, start)
    np.testing.assert_array_equal(start.R_room_camera, before[0])
    np.testing.assert_array_equal(start.distances, before[1])


def test_the_balance_of_an_exact_room_is_all_support() -> None:
    frame, room = seen_from_inside(HALF)
    cells = cells_of(frame, room.raster(HALF))
    balance = balance_faces(cells, room.R_room_camera, room.distances)
    visible = balance[:, 2] > 0.01
    assert (balance[visible, 0] > 0.9).all()
    assert balance[:, 1].max() < 0.02
    assert balance[:, 2].sum() == pytest.approx(1.0)
    nearer = balance_faces(cells, room.R_room_camera, room.distances * [1, 1, 1, 0.8, 1])
    assert nearer[3, 0] < 0.1
    assert nearer[3, 1] > 0.9


def test_where_the_classes_are_known_clutter_before_half_of_every_wall_hides_no_room() -> None:
    """Issue 3: below 1 % with half of each wall hidden; what the fit itself can do, the classifier aside."""
    errors: list[float] = []
    for share, seed, frames in CLUTTERED:
        options = {"furniture": 0.0, "wall_clutter": share}
        rooms = SyntheticSource(frames, seed, noise="clean", walk=False, camera=HALF, options=options)
        for sample in good_samples(rooms):
            if len(errors) == 8 or not all(0.40 <= hidden <= 0.65 for hidden in hidden_walls(sample)):
                continue
            assert sample.truth is not None
            assert sample.truth.cuboid is not None
            assert sample.truth.labels is not None
            cells = cell_costs(cells_of(sample.frame, sample.truth.labels))
            fitted = refine_room(cells, search_room(cells, sample.truth.cuboid.R_room_camera))
            layout = RoomCuboid(fitted.R_room_camera, fitted.distances).raster(HALF)
            errors.append(float((layout != sample.truth.layout).mean()))
    assert len(errors) == 8
    assert np.mean(errors) < 0.005, errors
    assert max(errors) < 0.02, errors
