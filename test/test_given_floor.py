"""A camera pose that is given a few degrees or a hand's breadth off: the floor that is seen is found all the same."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks._free_space import MOUNTS, random_views, score_free_space, true_free_space
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.floor.floor_plane import FloorFit, FloorPlane, fit_floor
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import SyntheticRoom
from room_layout_ros.floor_check import FloorCheck

CONFIG = EstimatorConfig()
SEEDS = range(3, 9)


@cache
def views() -> list[tuple[SyntheticRoom, Sample]]:
    return list(random_views(SEEDS, 31, "kinect", mount=MOUNTS["high"]))


def given(sample: Sample, pitch_deg: float, higher_m: float = 0.0) -> FloorPlane:
    """The camera's true pose, steeper by so much and higher."""
    assert sample.truth is not None
    assert sample.truth.down_camera is not None
    assert sample.truth.camera_height_m is not None
    c, s = np.cos(np.deg2rad(pitch_deg)), np.sin(np.deg2rad(pitch_deg))
    down = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ sample.truth.down_camera
    return FloorPlane(down, sample.truth.camera_height_m + higher_m, "parameters")


def fitted(estimator: LayoutEstimator, sample: Sample, floor: FloorPlane) -> tuple[FloorFit, RoomEstimate]:
    estimate = estimator.estimate(sample.frame, TemporalPrior(gravity=floor.normal))
    geometry = compute_depth_geometry(sample.frame, CONFIG)
    assert geometry is not None
    fit = fit_floor(geometry, estimate, CONFIG, floor)
    assert fit is not None
    return fit, estimate


def angle_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.rad2deg(np.arccos(min(float(a @ b), 1.0))))


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator(CONFIG)


@pytest.mark.parametrize(("pitch_deg", "higher_m"), [(4.0, 0.0), (5.0, 0.0), (-4.0, 0.0), (4.0, -0.1), (0.0, 0.12)])
def test_within_the_tolerance_the_floor_that_is_seen_is_found(
    estimator: LayoutEstimator, pitch_deg: float, higher_m: float
) -> None:
    for _, sample in views():
        assert sample.truth is not None
        fit, _ = fitted(estimator, sample, given(sample, pitch_deg, higher_m))
        assert fit.source == "parameters+depth", sample.name
        assert sample.truth.down_camera is not None
        assert angle_deg(fit.normal, sample.truth.down_camera) < 0.5, sample.name


def test_a_pose_that_is_too_far_off_is_no_reason_for_floor_in_things(estimator: LayoutEstimator) -> None:
    """Pitch + 6 degrees: a plane through beds and cabinets is near enough to what was given, and no floor."""
    false_free = free = 0
    for room, sample in views():
        floor = given(sample, 6.0)
        fit, estimate = fitted(estimator, sample, floor)
        assert sample.truth is not None
        assert sample.truth.down_camera is not None
        off_deg = angle_deg(fit.normal, sample.truth.down_camera)
        assert off_deg < 0.5 or fit.source == "parameters", sample.name
        if fit.source == "parameters":
            geometry = compute_depth_geometry(sample.frame, CONFIG)
            assert geometry is not None
            assert FloorCheck(geometry, estimate.labels, floor, CONFIG).denies_floor, sample.name
            continue
        space = free_space_of_frame(sample.frame, estimate, CONFIG, floor)
        truth = true_free_space(
            room, sample, CONFIG.free_space_resolution_m, CONFIG.free_space_forward_m, CONFIG.free_space_side_m
        )
        score = score_free_space(truth, space)
        false_free, free = false_free + score.false_free, free + score.free
    assert free > 1000
    assert false_free <= 0.002 * free


def test_depth_does_not_deny_the_floor_on_which_it_lies(estimator: LayoutEstimator) -> None:
    for _, sample in views():
        floor = given(sample, 0.0)
        _, estimate = fitted(estimator, sample, floor)
        geometry = compute_depth_geometry(sample.frame, CONFIG)
        assert geometry is not None
        assert not FloorCheck(geometry, estimate.labels, floor, CONFIG).denies_floor, sample.name
        higher = given(sample, 0.0, 0.4)
        assert FloorCheck(geometry, estimate.labels, higher, CONFIG).denies_floor, sample.name
