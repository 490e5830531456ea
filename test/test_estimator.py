"""The whole estimate against rooms whose truth is known; on real frames; on whatever else a camera may deliver."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from furnished import GREY, empty
from numpy.typing import NDArray
from scenes import HALF, SMALL, ask, look

from benchmarks._floor_width import floor_width
from benchmarks.clutter import half_hidden_views, layout_errors
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.freespace import compute_free_space
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.room_axes import angle_between_axes
from room_layout_ros.core.stage_clock import StageClock
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.datasets import good_samples, open_folder
from room_layout_ros.datasets.sample import FrameTruth, Sample
from room_layout_ros.datasets.synthetic import KINECT, SyntheticSource, camera_pose, render
from room_layout_ros.datasets.synthetic.shapes import Solid
from room_layout_ros.evaluation.measures import score_pixels

FLOOR_MAT = 20
WIDTH_M, WIDTH_TOLERANCE_M = 2.15, 0.10


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator()


@pytest.fixture(scope="module")
def furnished() -> list[Sample]:
    return rooms(8, 31, camera=HALF)


def rooms(frames: int, seed: int, camera: CameraIntrinsics | None = None, **options: float) -> list[Sample]:
    """Views without noise, each of another room."""
    source = SyntheticSource(frames, seed, noise="clean", walk=False, options=dict(options))
    return list(good_samples(source if camera is None else replace(source, camera=camera)))


def truth_of(sample: Sample) -> tuple[FrameTruth, NDArray[np.uint8], NDArray[np.uint8], RoomCuboid]:
    truth = sample.truth
    assert truth is not None
    assert truth.layout is not None
    assert truth.labels is not None
    assert truth.cuboid is not None
    return truth, truth.layout, truth.labels, truth.cuboid


def layout_error(sample: Sample, estimate: RoomEstimate) -> float:
    return score_pixels(truth_of(sample)[1], estimate.layout).layout_error


# --- rooms whose truth is known -----------------------------------------------------------------------------------


def test_empty_rooms_without_noise_are_exact(estimator: LayoutEstimator) -> None:
    """Issue 2: axes within 0.1 degrees, planes of faces in view within 5 mm, layout error below 0.5 %."""
    found = 0
    for sample in rooms(10, 11, furniture=0.0):
        truth, layout, labels, cuboid = truth_of(sample)
        if truth.labels40 is not None and (truth.labels40 == FLOOR_MAT).any():
            continue  # a rug lies 8 mm above the floor's plane
        estimate = ask(estimator, sample.frame)
        seen = np.bincount(layout.ravel(), minlength=6)[1:] > 500
        assert estimate.cuboid is not None
        assert estimate.status is Status.OK
        assert estimate.metric
        assert np.rad2deg(angle_between_axes(estimate.R_room_camera, cuboid.R_room_camera)) < 0.1
        assert np.abs(estimate.cuboid.distances[seen] - cuboid.distances[seen]).max() < 0.005
        assert (estimate.layout != layout).mean() < 0.005, "names of the walls included"
        assert (estimate.labels != labels).mean() < 0.02
        assert estimate.confidence > 0.9
        found += 1
    assert found >= 6


def test_furnished_rooms_without_noise(estimator: LayoutEstimator) -> None:
    """What stands before a wall from end to end hides it: no method sees that wall, and the mean holds such rooms."""
    views = [sample for seed in (11, 12, 13) for sample in rooms(6, seed, furniture=1.0)]
    errors = [layout_error(sample, ask(estimator, sample.frame)) for sample in views]
    assert np.mean(errors) < 0.015, np.round(100 * np.array(errors), 2)


@pytest.mark.parametrize("turn_deg", [20, 30, 40])
@pytest.mark.parametrize(("height", "pitch"), [(0.6, -0.1), (1.0, -0.2)])
def test_a_block_that_stands_askew_does_not_turn_the_room(
    estimator: LayoutEstimator, height: float, pitch: float, turn_deg: float
) -> None:
    """It fills more of the picture than any wall."""
    block = Solid(0.4, 0.0, np.deg2rad(turn_deg), 0.8, 1.8, 0.0, 0.8, 6, GREY, thing=1)
    sample = render(empty(block), KINECT, camera_pose(-1.6, 0.0, height, 0.0, pitch))
    assert sample.truth is not None
    assert np.mean(estimator.estimate(sample.frame).layout != sample.truth.layout) < 0.01


def test_clutter_before_half_of_every_wall_hides_no_room(estimator: LayoutEstimator) -> None:
    """Issue 3: layout error below 1 % where clutter hides 45 to 55 % of each wall in view, at full size."""
    errors = np.array(layout_errors(estimator, 0.45, 0.55, views=12, seed=7))
    assert len(errors) == 12
    assert errors.mean() < 0.01, np.round(100 * errors, 2)
    assert np.median(errors) < 0.005, np.round(100 * errors, 2)


def test_views_of_half_hidden_walls_are_what_they_say() -> None:
    for sample in islice(half_hidden_views(0.45, 0.55, seed=3), 4):
        _, layout, labels, _ = truth_of(sample)
        assert layout.shape == (480, 640)
        walls = [layout == wall for wall in (3, 4, 5)]
        shares = [(labels[wall] == CLUTTER).mean() for wall in walls if wall.mean() > 0.02]
        assert shares
        assert all(0.45 <= share <= 0.55 for share in shares)


def test_the_same_frame_gives_the_same_bytes(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    first = [ask(estimator, s.frame) for s in furnished[:3]]
    again = [ask(LayoutEstimator(), s.frame) for s in reversed(furnished[:3])][::-1]  # no state, no order
    for a, b in zip(first, again, strict=True):
        assert a.cuboid is not None
        assert b.cuboid is not None
        for name in ("layout", "labels", "superpixels", "face_confidence", "R_room_camera"):
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name
        assert a.cuboid.distances.tobytes() == b.cuboid.distances.tobytes()
        assert (a.confidence, a.energy) == (b.confidence, b.energy)


def test_the_gap_is_the_energy_above_a_bound_where_one_was_computed(
    estimator: LayoutEstimator, furnished: list[Sample]
) -> None:
    frame = furnished[0].frame
    proved = ask(LayoutEstimator(EstimatorConfig(joint_bound=True)), frame)
    assert proved.lower_bound <= proved.energy
    assert proved.gap == proved.energy - proved.lower_bound
    unproved = ask(estimator, frame)
    assert (unproved.lower_bound, unproved.gap) == (-np.inf, np.inf)
    assert unproved.energy == proved.energy
    assert np.isnan(ask(LayoutEstimator(EstimatorConfig(method="depth")), frame).gap)


def test_the_input_is_left_as_it_was(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    frame = furnished[0].frame
    assert frame.color is not None
    assert frame.depth_m is not None
    color, depth_m = frame.color.copy(), frame.depth_m.copy()
    color.setflags(write=False)
    depth_m.setflags(write=False)
    ask(estimator, replace(frame, color=color, depth_m=depth_m))
    np.testing.assert_array_equal(color, frame.color)
    np.testing.assert_array_equal(depth_m, frame.depth_m)


def test_a_warm_start_finds_the_same_room(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    for sample in furnished[:5]:
        cold = ask(estimator, sample.frame)
        warm = estimator.estimate(sample.frame, next_prior(cold))
        assert (warm.layout != cold.layout).mean() < 0.003
        assert np.rad2deg(angle_between_axes(warm.R_room_camera, cold.R_room_camera)) < 0.05


def test_a_deadline_leaves_the_next_frame_its_warm_start(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    cut_short = estimator.estimate(furnished[0].frame, expired=lambda: True)
    assert cut_short.status is Status.DEADLINE
    handed_on = next_prior(cut_short).R_room_camera
    assert handed_on is not None
    np.testing.assert_array_equal(handed_on, cut_short.R_room_camera)


@pytest.mark.parametrize("index", range(4))
def test_without_depth_the_front_wall_is_at_one(
    estimator: LayoutEstimator, furnished: list[Sample], index: int
) -> None:
    estimate = estimator.estimate(furnished[index].frame.without_depth())
    assert estimate.cuboid is not None
    distances = estimate.cuboid.distances
    front = distances[3] if np.isfinite(distances[3]) else distances[np.isfinite(distances)].max()
    assert front == pytest.approx(1.0)


def test_a_prior_of_another_room_does_no_harm(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    sample = furnished[0]
    cold = ask(estimator, sample.frame)
    wrong = look(30, 40, 25) @ cold.R_room_camera
    assert layout_error(sample, estimator.estimate(sample.frame, TemporalPrior(wrong))) < 0.02


def test_a_failed_estimate_hands_on_nothing(estimator: LayoutEstimator) -> None:
    dark = RgbdFrame(SMALL, np.zeros((120, 160, 3), np.uint8))
    assert next_prior(ask(estimator, dark)) == TemporalPrior()


# --- parts of the input -------------------------------------------------------------------------------------------


def test_depth_alone_finds_the_same_rooms(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    errors = [layout_error(s, ask(estimator, replace(s.frame, color=None))) for s in furnished]
    assert np.mean(errors) < 0.04, np.round(100 * np.array(errors), 2)
    blind = LayoutEstimator(EstimatorConfig(use_color=False))
    a, b = ask(blind, furnished[0].frame), ask(estimator, replace(furnished[0].frame, color=None))
    np.testing.assert_array_equal(a.layout, b.layout)
    np.testing.assert_array_equal(a.labels, b.labels)


def test_colour_alone_gives_rooms_without_scale(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    errors = []
    for sample in furnished:
        estimate = ask(estimator, sample.frame.without_depth())
        assert estimate.status is Status.OK
        assert not estimate.metric
        errors.append(layout_error(sample, estimate))
    assert np.mean(errors) < 0.25, np.round(100 * np.array(errors), 2)
    unwanted = ask(LayoutEstimator(EstimatorConfig(use_depth=False)), furnished[0].frame)
    np.testing.assert_array_equal(unwanted.layout, ask(estimator, furnished[0].frame.without_depth()).layout)
    assert not unwanted.metric, "depth that is not used gives no scale"


def test_the_baseline_runs_by_its_name(furnished: list[Sample]) -> None:
    baseline = LayoutEstimator(EstimatorConfig(method="depth"))
    errors = [layout_error(s, ask(baseline, s.frame)) for s in furnished[:4]]
    assert np.mean(errors) < 0.10


def test_every_stage_is_timed_in_its_order(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    timings = ask(estimator, furnished[0].frame).timings_ms
    assert list(timings)[:5] == ["depth", "scene", "superpixels", "lines", "axes"]
    assert {"joint", "refinement"} <= set(timings)
    assert all(time_ms > 0 for time_ms in timings.values())
    clock = StageClock()
    assert clock("sum", max, 3, 5) == 5
    assert list(clock.timings_ms) == ["sum"]


# --- time and real frames --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hand_made(data_root: Path) -> list[Sample]:
    """The 37 frames with hand-made layouts."""
    folder = open_folder(data_root / "nyuv2")
    listed = json.loads((data_root / "nyuv2" / "splits.json").read_text("utf-8"))["layout_dev"]
    names = tuple(f"{n:04d}" if isinstance(n, int) else str(n) for n in listed)
    samples = list(good_samples(folder.subset(names)))
    assert len(samples) == 37
    return samples


def test_real_rooms_of_nyu(estimator: LayoutEstimator, hand_made: list[Sample]) -> None:
    """The paper: 8.04 and 13.65 %, on other frames."""
    errors = []
    for sample in hand_made:
        assert sample.truth is not None
        assert sample.truth.layout is not None
        estimate = ask(estimator, sample.frame)
        score = score_pixels(sample.truth.layout, estimate.layout, sample.truth.labels, estimate.labels)
        errors.append((score.layout_error, score.labelling_error))
    layout, labelling = np.mean(errors, axis=0)
    assert layout < 0.065
    assert labelling < 0.09


def test_real_rooms_without_depth_all_have_a_layout_and_most_their_axes(
    estimator: LayoutEstimator, hand_made: list[Sample]
) -> None:
    """Issue 3: a layout for all of them; axes within 5 degrees of those with depth on 70 %."""
    apart = []
    for sample in hand_made:
        estimate = ask(estimator, sample.frame.without_depth())
        assert estimate.status is Status.OK, sample.name
        assert ((estimate.layout >= 1) & (estimate.layout <= 5)).all(), sample.name
        with_depth = estimator.estimate(sample.frame)
        apart.append(np.rad2deg(angle_between_axes(estimate.R_room_camera, with_depth.R_room_camera)))
    assert np.mean(np.array(apart) < 5.0) >= 0.7, np.round(apart, 1)


def test_the_real_corridor_has_walls_floor_ceiling_and_its_true_width(
    estimator: LayoutEstimator, data_root: Path
) -> None:
    folder = open_folder(data_root / "corridor")
    widths = []
    for sample in good_samples(folder.subset(tuple(sorted(folder.names)[:20]))):
        estimate = ask(estimator, sample.frame)
        shares = np.bincount(estimate.layout.ravel(), minlength=6) / estimate.layout.size
        assert (shares[[1, 2, 3, 5]] > 0.02).all(), f"{sample.name}: ceiling, floor, left and right {shares}"
        geometry = compute_depth_geometry(sample.frame, estimator.config)
        assert geometry is not None
        widths.append(floor_width(geometry, compute_free_space(geometry, estimate, estimator.config)))
    assert len(widths) == 20
    assert np.median(widths) == pytest.approx(WIDTH_M, abs=WIDTH_TOLERANCE_M)
    assert np.mean(np.abs(np.array(widths) - WIDTH_M) < WIDTH_TOLERANCE_M) >= 0.9, np.round(widths, 2)
