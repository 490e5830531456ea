"""The edges of the picture say where the planes are when the depth cannot; where it can, nothing moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF, ROOM, look, seen_from_inside

from room_layout_ros.core import cuboid_refinement
from room_layout_ros.core import estimator as estimator_module
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.edge_refinement import RoomPicture, refine_on_edges
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.joint import JointEstimate, estimate_joint
from room_layout_ros.core.layout import RoomCuboid, plane_rows
from room_layout_ros.core.lines import LineSegments, compute_line_segments
from room_layout_ros.core.room_axes import angle_between_axes
from room_layout_ros.core.room_cells import RoomCells, room_cells
from room_layout_ros.core.room_edges import edge_candidates
from room_layout_ros.core.slow_depth import depth_equations, measure_errors, structure_cells
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation.geometry import plane_errors
from room_layout_ros.evaluation.measures import best_wall_names, confusion

F64 = NDArray[np.float64]
FULL = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
SLOW_ERROR = 0.003
"""1/m: 5 cm at 4 m."""


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator()


@pytest.fixture(scope="module")
def by_depth() -> LayoutEstimator:
    return LayoutEstimator(EstimatorConfig(refinement="depth"))


def view(slow_error: float, rng: np.random.Generator) -> tuple[RgbdFrame, F64, F64]:
    """A plain room, each face in a colour of its own, its inverse depth wrong by a slow error; rotation, distances."""
    R = look(28.0, 12.0, 1.0)
    frame, room = seen_from_inside(FULL, R)
    assert frame.depth_m is not None
    ys, xs = np.mgrid[: FULL.height, : FULL.width]
    phase_x, phase_y = rng.uniform(0, 2 * np.pi, 2)
    wave = np.sqrt(2.0) * (np.sin(xs / 50.0 + phase_x) + np.sin(ys / 50.0 + phase_y)) / np.sqrt(2.0)
    depth_m = (1.0 / (1.0 / frame.depth_m + slow_error * wave)).astype(np.float32)
    seen = np.bincount(room.raster(FULL).ravel(), minlength=6)[1:] > 500
    return RgbdFrame(FULL, frame.color, depth_m), R, np.where(seen, ROOM, np.inf)


def cells_and_picture(frame: RgbdFrame, labels: NDArray[np.uint8]) -> tuple[RoomCells, RoomPicture]:
    """What the refinement reads, the labels being true."""
    geometry = compute_depth_geometry(frame, EstimatorConfig())
    assert geometry is not None
    assert frame.color is not None
    index = labels.astype(np.int32) - 1
    picture = RoomPicture(frame.color, compute_line_segments(frame.color, EstimatorConfig()), index, np.arange(6) == 5)
    return room_cells(geometry, np.eye(6), index), picture


def raster(R: F64, distances: F64) -> NDArray[np.uint8]:
    return RoomCuboid(R, distances).raster(FULL)


def off(R: F64, distances: F64, true_R: F64, true_distances: F64) -> tuple[float, float]:
    """Degrees of the rotation, largest offset in m."""
    seen = np.isfinite(true_distances)
    turn = np.rad2deg(angle_between_axes(R, true_R))
    return float(turn), float(np.abs(distances[seen] - true_distances[seen]).max())


def met(samples: list[Sample], estimator: LayoutEstimator) -> float:
    """Share of the planes within 3 cm and 0.5 degrees."""
    within: list[bool] = []
    for sample in samples:
        truth, estimate = sample.truth, estimator.estimate(sample.frame)
        assert truth is not None
        assert truth.cuboid is not None
        assert truth.layout is not None
        assert estimate.cuboid is not None
        names = best_wall_names(confusion(truth.layout, estimate.layout))
        errors = plane_errors(truth.cuboid, estimate.cuboid, names)
        seen = np.isfinite(errors.offset_m)
        within += ((errors.offset_m <= 0.03) & (errors.angle_deg <= 0.5))[seen].tolist()
    return float(np.mean(within))


# --- whole estimates -----------------------------------------------------------------------------------------------


def test_planes_that_stereo_misses_are_met(estimator: LayoutEstimator, by_depth: LayoutEstimator) -> None:
    samples = list(good_samples(SyntheticSource(6, 71, noise="stereo", walk=False)))
    assert met(samples, estimator) > 0.9
    assert met(samples, by_depth) < 0.75


def test_exact_depth_is_believed(estimator: LayoutEstimator, by_depth: LayoutEstimator) -> None:
    frame = next(iter(good_samples(SyntheticSource(1, 5, noise="clean", walk=False)))).frame
    after, before = estimator.estimate(frame), by_depth.estimate(frame)
    assert after.cuboid is not None
    assert before.cuboid is not None
    np.testing.assert_array_equal(after.cuboid.R_room_camera, before.cuboid.R_room_camera)
    np.testing.assert_array_equal(after.cuboid.distances, before.cuboid.distances)


def test_without_colour_nothing_is_looked_for(estimator: LayoutEstimator, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = next(iter(good_samples(SyntheticSource(1, 6, noise="stereo", walk=False)))).frame

    def fail(*_: object) -> None:
        raise AssertionError("there is no picture")

    monkeypatch.setattr(cuboid_refinement, "refine_on_edges", fail)
    assert estimator.estimate(replace(frame, color=None)).cuboid is not None
    no_color = LayoutEstimator(EstimatorConfig(use_color=False))
    assert no_color.estimate(frame).cuboid is not None


@pytest.mark.parametrize("use_depth", [True, False])
def test_without_refinement_the_room_is_that_of_the_joint_solution(
    use_depth: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = next(iter(good_samples(SyntheticSource(1, 6, noise="stereo", walk=False)))).frame
    solved: list[JointEstimate] = []

    def keep(*args: Any, **kwargs: Any) -> JointEstimate:
        solved.append(estimate_joint(*args, **kwargs))
        return solved[0]

    monkeypatch.setattr(estimator_module, "estimate_joint", keep)
    found = LayoutEstimator(EstimatorConfig(refinement="none", use_depth=use_depth)).estimate(frame)
    assert found.cuboid is not None
    joint = solved[0].cuboid
    assert angle_between_axes(found.cuboid.R_room_camera, joint.R_room_camera) < 1e-6
    np.testing.assert_array_equal(found.cuboid.raster(frame.camera) > 0, joint.raster(frame.camera) > 0)
    ratio = np.sort(found.cuboid.distances[np.isfinite(found.cuboid.distances)])
    in_view = joint.in_view(joint.view(frame.camera)[1]).distances
    joint_distances = np.sort(in_view[np.isfinite(in_view)])
    np.testing.assert_allclose(ratio / ratio[0], joint_distances / joint_distances[0])
    refined = LayoutEstimator(EstimatorConfig(refinement="depth", use_depth=use_depth)).estimate(frame)
    assert refined.cuboid is not None
    assert not np.array_equal(refined.cuboid.distances, found.cuboid.distances)


# --- the step by itself --------------------------------------------------------------------------------------------


def test_a_room_off_by_the_slow_error_comes_to_its_edges(rng: np.random.Generator) -> None:
    for _ in range(3):
        frame, R, distances = view(SLOW_ERROR, rng)
        cells, picture = cells_and_picture(frame, raster(R, distances))
        start = look(*rng.uniform(-0.8, 0.8, 3)) @ R, distances * rng.uniform(0.985, 1.015, 5)
        turn, offset = off(*refine_on_edges(cells, FULL, picture, *start), R, distances)
        assert turn < 0.1
        assert offset < 0.02


def test_the_result_is_the_same_each_time_and_its_start_is_left_alone(rng: np.random.Generator) -> None:
    frame, R, distances = view(SLOW_ERROR, rng)
    cells, picture = cells_and_picture(frame, raster(R, distances))
    start = look(0.5, -0.3, 0.4) @ R, distances * 1.01
    before = start[0].copy(), start[1].copy()
    first, second = (refine_on_edges(cells, FULL, picture, *start) for _ in range(2))
    for k in range(2):
        np.testing.assert_array_equal(first[k], second[k])
        np.testing.assert_array_equal(start[k], before[k])
    np.testing.assert_allclose(first[0] @ first[0].T, np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(np.isinf(first[1]), np.isinf(distances))


@pytest.mark.parametrize("hidden", ("no contrast", "all clutter"))
def test_where_no_edge_is_seen_the_depth_decides(hidden: str, rng: np.random.Generator) -> None:
    frame, R, distances = view(SLOW_ERROR, rng)
    cells, picture = cells_and_picture(frame, raster(R, distances))
    no_lines = LineSegments(np.empty((0, 4), np.float32))
    if hidden == "no contrast":
        picture = replace(picture, color=np.full_like(picture.color, 90), segments=no_lines)
    else:
        picture = replace(picture, clutter=np.ones(6, np.bool_), segments=no_lines)
    moved = refine_on_edges(cells, FULL, picture, look(0.6, 0.4, 0.0) @ R, distances * 1.01)
    turn, offset = off(*moved, R, distances)
    assert turn < 0.6
    assert offset < 0.08


def test_a_line_beside_an_edge_does_not_take_it(rng: np.random.Generator) -> None:
    """A dark baseboard of 8 cm along every wall: its upper rim is an edge too."""
    frame, R, distances = view(SLOW_ERROR, rng)
    labels = raster(R, distances)
    cells, _ = cells_and_picture(frame, labels)
    raised = distances.copy()
    raised[1] -= 0.08
    color = np.array(frame.color)
    color[(raster(R, raised) == 2) & (labels != 2)] = 40
    _, picture = cells_and_picture(replace(frame, color=color), labels)
    turn, offset = off(*refine_on_edges(cells, FULL, picture, look(0.3, 0.3, 0.2) @ R, distances * 1.01), R, distances)
    assert turn < 0.15
    assert offset < 0.03


@pytest.mark.parametrize("camera", (HALF, CameraIntrinsics(40, 30, 33.0, 34.0, 18.2, 15.7)))
def test_small_pictures_do_no_harm(camera: CameraIntrinsics, rng: np.random.Generator) -> None:
    frame, room = seen_from_inside(camera, look(28.0, 12.0))
    assert frame.depth_m is not None
    noisy = replace(frame, depth_m=(frame.depth_m * rng.uniform(0.99, 1.01, frame.depth_m.shape)).astype(np.float32))
    geometry = compute_depth_geometry(noisy, EstimatorConfig())
    assert geometry is not None
    assert frame.color is not None
    index = room.raster(camera).astype(np.int32) - 1
    segments = compute_line_segments(frame.color, EstimatorConfig())
    picture = RoomPicture(frame.color, segments, index, np.zeros(6, np.bool_))
    moved = refine_on_edges(room_cells(geometry, np.eye(6), index), camera, picture, room.R_room_camera, ROOM)
    assert off(*moved, room.R_room_camera, ROOM)[1] < 0.05


# --- its parts -----------------------------------------------------------------------------------------------------


def test_the_slow_error_is_measured_on_the_frame(rng: np.random.Generator) -> None:
    measured = []
    for slow in (0.001, 0.003):
        frame, R, distances = view(slow, rng)
        structure = structure_cells(cells_and_picture(frame, raster(R, distances))[0], FULL)
        measured.append(measure_errors(structure.cells, structure.nodes, R, distances)[0])
        assert measured[-1] == pytest.approx(slow, rel=0.5)
    assert measured[1] / measured[0] == pytest.approx(3.0, rel=0.4)


def test_the_depth_equations_are_those_of_the_full_covariance(rng: np.random.Generator) -> None:
    """Naive twin: (J' C^-1 J, J' C^-1 r), C the noise of each cell and the slow error that they share."""
    frame, R, distances = view(0.0005, rng)
    structure = structure_cells(cells_and_picture(frame, raster(R, distances))[0], FULL)
    cells, (columns, rows) = structure.cells[::3].copy(), structure.nodes
    slow, cell = 0.001, 0.002
    A, g = depth_equations(cells, structure.nodes, (slow, cell), R, distances)
    m = plane_rows(R, distances)
    J, B = np.zeros((len(cells), 8)), np.zeros((len(cells), columns * rows))
    residual, variance = np.empty(len(cells)), np.empty(len(cells))
    for i, (x, y, w, *kinds, across, down) in enumerate(cells):
        ray = np.array([x, y, 1.0])
        face = int(np.argmax(m @ ray))
        residual[i] = w - m[face] @ ray
        robust = 1.0 + (residual[i] / (1.3 * (slow + cell))) ** 2
        variance[i] = cell**2 * robust / kinds[min(face, 2)] if kinds[min(face, 2)] >= 0.5 else np.inf
        J[i, :3], J[i, 3 + face] = np.cross(m[face], ray), -m[face] @ ray
        column, row = int(across), int(down)
        for i_x, share_x in ((column, 1 - across + column), (column + 1, across - column)):
            for i_y, share_y in ((row, 1 - down + row), (row + 1, down - row)):
                B[i, i_y * columns + i_x] = share_x * share_y
    on = np.isfinite(variance)
    C = np.diag(variance[on]) + slow**2 * B[on] @ B[on].T
    np.testing.assert_allclose(A, J[on].T @ np.linalg.solve(C, J[on]), rtol=1e-6, atol=1e-6 * np.abs(A).max())
    np.testing.assert_allclose(g, J[on].T @ np.linalg.solve(C, residual[on]), rtol=1e-6, atol=1e-6 * np.abs(g).max())


def test_the_edges_of_a_picture_are_found_to_a_part_of_a_pixel(rng: np.random.Generator) -> None:
    frame, R, distances = view(0.0, rng)
    cells_and_picture(frame, raster(R, distances))
    assert frame.color is not None
    m = plane_rows(R, distances)
    intrinsics = FULL.fx, FULL.fy, FULL.cx, FULL.cy
    index, none = np.zeros((FULL.height, FULL.width), np.int32), np.zeros(1, np.bool_)
    found = edge_candidates(frame.color[..., 0], index, none, intrinsics, m, 6)
    pairs = {(int(a), int(b)) for a, b in found[:, 1:3]}
    assert {(1, 3), (1, 4), (3, 4)} <= pairs
    for _, a, b, x, y in found:
        across = m[int(a)] - m[int(b)]
        pixels = (across @ [x, y, 1.0]) / np.hypot(across[0] / FULL.fx, across[1] / FULL.fy)
        assert abs(pixels) < 0.5
    assert len(edge_candidates(frame.color[..., 0], index, ~none, intrinsics, m, 6)) == 0
