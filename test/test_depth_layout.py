"""The baseline "depth": scores equal to the naive ones, exact on empty rooms, labels by distance to the room."""

from __future__ import annotations

import naive_room
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF, ROOM, SMALL, TINY, look, seen_from_inside

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import DepthGeometry, compute_depth_geometry
from room_layout_ros.core.depth_cells import gather_depth_cells
from room_layout_ros.core.depth_estimator import best_layout, estimate_from_depth
from room_layout_ros.core.depth_layout import (
    VIOLATION_WEIGHT,
    LayoutEvidence,
    ScoredLayout,
    _histogram_peaks,
    score_face,
    search_layout,
)
from room_layout_ros.core.estimate import Status
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.geometric_labelling import _votes, label_by_geometry
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.manhattan import estimate_manhattan_frame
from room_layout_ros.core.superpixels import compute_superpixels

CONFIG = EstimatorConfig()


def geometry_of(frame: RgbdFrame) -> DepthGeometry:
    geometry = compute_depth_geometry(frame, CONFIG)
    assert geometry is not None
    return geometry


def random_evidence(rng: np.random.Generator, n: int) -> LayoutEvidence:
    points = np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)), np.ones(n)]) @ look(30, 10).T
    points *= rng.uniform(0.5, 5.0, (n, 1))
    points[rng.random(n) < 0.2] = np.nan
    return LayoutEvidence(points, rng.random((n, 3)), rng.uniform(0.01, 0.1, n))


def test_the_score_of_each_trial_equals_the_score_of_that_cuboid(rng: np.random.Generator) -> None:
    for _ in range(10):
        e = random_evidence(rng, 60)
        distances = rng.uniform(0.5, 4.0, 5)
        distances[rng.random(5) < 0.2] = np.inf
        for face in range(5):
            trials = np.append(rng.uniform(0.3, 5.0, 4), np.inf)
            fast = score_face(e, distances, face, trials)
            for trial, score in zip(trials, fast, strict=True):
                room = np.where(np.arange(5) == face, trial, distances)
                slow = naive_room.score_face(e.points, e.agreement, e.sigma, room, VIOLATION_WEIGHT)
                assert score == pytest.approx(slow, abs=1e-10)


@pytest.mark.parametrize("R", [look(20, 8, 1.5), look(-40, 5), look(3, 15, -2)])
def test_an_empty_room_is_found(R: NDArray[np.float64]) -> None:
    frame, room = seen_from_inside(HALF, R)
    raster = room.raster(HALF)
    seen = np.bincount(raster.ravel(), minlength=6)[1:] > 1500
    found = search_layout(gather_depth_cells(geometry_of(frame)), R)
    assert np.abs(found.distances - ROOM)[seen].max() < 0.04
    assert (RoomCuboid(R, found.distances).raster(HALF) != raster).mean() < 0.02
    large = np.bincount(raster.ravel(), minlength=6)[1:] > 0.1 * raster.size  # narrow strips have no normals
    assert (found.support[large] > 0.5).all()
    assert (found.violation[seen] < 0.05).all()


def test_a_wall_is_not_drawn_through_what_is_seen_behind_it() -> None:
    """A cupboard door before the wall: the plane with support wins, and the wall behind is violated by no one."""
    frame, room = seen_from_inside(HALF, look(0, 5))
    assert frame.depth_m is not None
    depth = frame.depth_m.copy()
    depth[80:170, 130:200] = 2.4
    found = search_layout(gather_depth_cells(geometry_of(RgbdFrame(HALF, None, depth))), room.R_room_camera)
    assert found.distances[3] == pytest.approx(3.5, abs=0.05)


def test_the_peaks_of_a_histogram_are_the_planes_in_it(rng: np.random.Generator) -> None:
    offsets = np.concatenate([rng.normal(2.0, 0.01, 300), rng.normal(3.1, 0.01, 100), [-1.0, 0.1]])
    peaks = _histogram_peaks(offsets, np.ones(len(offsets)))
    assert peaks[:2] == pytest.approx([2.0, 3.1], abs=0.02)
    assert len(_histogram_peaks(np.array([-1.0, 0.05]), np.ones(2))) == 0


def test_near_ties_go_to_the_first_hypothesis() -> None:
    def scored(score: float) -> ScoredLayout:
        return ScoredLayout(np.eye(3), ROOM, score, np.zeros(5), np.zeros(5))

    first, tied, better = scored(0.5), scored(0.5005), scored(0.502)
    assert best_layout([first, tied]) is first
    assert best_layout([first, tied, better]) is better


@pytest.mark.parametrize("R", [look(20, 8), look(-40, 20, 3)])
def test_votes_equal_counting_pixel_by_pixel(R: NDArray[np.float64], rng: np.random.Generator) -> None:
    room = RoomCuboid(R, np.array([np.inf, 1.3, 1.8, 3.5, 2.2]))
    layout = room.raster(TINY)
    depth = room.depth(TINY) * rng.uniform(0.7, 1.1, layout.shape)
    depth[rng.random(depth.shape) < 0.3] = np.nan
    geometry = geometry_of(RgbdFrame(TINY, None, depth.astype(np.float32)))
    index = rng.integers(0, 12, layout.shape).astype(np.int32)
    fast = _votes(room.inverse_normals, layout, geometry.inverse_depth, TINY.rays(), index, 12)
    slow = naive_room.votes(R, room.distances, layout, geometry.inverse_depth, TINY, index, 12)
    np.testing.assert_allclose(fast, slow, rtol=1e-9, atol=1e-9)


def test_labels_are_faces_on_the_planes_and_clutter_before_them() -> None:
    frame, room = seen_from_inside(SMALL, look(15, 8))
    assert frame.depth_m is not None
    layout = room.raster(SMALL)
    index = (layout - 1).astype(np.int32)
    index[60:90, 60:90] = 5
    index[30:50, 100:120] = 6
    depth = frame.depth_m.copy()
    depth[60:90, 60:90] -= 0.5
    depth[30:50, 100:120] = np.nan
    labels = label_by_geometry(room, layout, geometry_of(RgbdFrame(SMALL, None, depth)), index, 7)
    present = np.unique(layout)
    np.testing.assert_array_equal(labels[present - 1], present)
    assert labels[5] == 6
    assert labels[6] == np.bincount(layout[30:50, 100:120].ravel()).argmax(), "no depth: the face of the layout"


def test_the_baseline_estimates_a_whole_frame() -> None:
    frame, room = seen_from_inside(HALF, look(20, 8))
    geometry = geometry_of(frame)
    axes = estimate_manhattan_frame(geometry)
    assert axes is not None
    superpixels = compute_superpixels(frame.color, geometry.inverse_depth, CONFIG)
    estimate = estimate_from_depth(frame, geometry, axes, superpixels, {"depth": 1.0})
    truth = room.raster(HALF)
    assert estimate.status is Status.OK
    assert (estimate.layout != truth).mean() < 0.02
    assert (estimate.labels != truth).mean() < 0.03
    assert estimate.confidence > 0.6
    seen = np.bincount(truth.ravel(), minlength=6)[1:] > 1500
    assert (estimate.face_confidence[seen] > 0.7).all()
    assert (estimate.face_confidence[np.isinf(estimate.cuboid.distances)] == 0).all()  # type: ignore[union-attr]
    assert {p.face for p in estimate.polygons} == set(np.unique(estimate.layout).tolist())
    assert estimate.timings_ms == {"depth": 1.0}
