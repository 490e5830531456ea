"""Free space by the estimator's own planes and labels, against the construction of rooms and of walks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import pytest
from furnished import CONFIG, free_space_of

from benchmarks._free_space import (
    found_things,
    random_views,
    scene_with_small_things,
    score_free_space,
    true_free_space,
    views_of_walk,
)
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import KINECT, NOISES, SyntheticRoom, SyntheticSource, render
from room_layout_ros.evaluation.geometry import plane_errors
from room_layout_ros.evaluation.measures import best_wall_names, confusion

ROOMS, STREAM, WALK = range(4), 21, 5


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator(CONFIG)


@dataclass(frozen=True)
class Views:
    """Four rooms from random poses and six seconds of a walk; more of them in docs/free_space_measured.md."""

    noise: str
    frames: list[tuple[SyntheticRoom, Sample, RoomEstimate]]


@pytest.fixture(scope="module", params=NOISES)
def views(request: pytest.FixtureRequest, estimator: LayoutEstimator) -> Views:
    noise: str = request.param
    seen = chain(random_views(ROOMS, STREAM, noise), views_of_walk(WALK, noise, 6))
    return Views(noise, [(room, sample, estimator.estimate(sample.frame)) for room, sample in seen])


def test_free_floor_is_found_and_nothing_before_a_thing_is_called_free(views: Views) -> None:
    """The truth is not free where depth is missing (pool_measured)."""
    both = either = 0
    for room, sample, estimate in views.frames:
        truth = true_free_space(room, sample, 0.05, 6.0, 4.0)
        score = score_free_space(truth, free_space_of(sample.frame, estimate))
        both, either = both + score.pool_measured[0], either + score.pool_measured[1]
        assert score.too_near == 0, f"view {sample.name}"
    assert both / either >= (0.95 if views.noise == "clean" else 0.90)


def test_planes_are_within_three_centimetres_and_half_a_degree(views: Views) -> None:
    within = []
    for _, sample, estimate in views.frames:
        assert sample.truth is not None
        assert sample.truth.cuboid is not None
        assert sample.truth.layout is not None
        assert estimate.cuboid is not None
        names = best_wall_names(confusion(sample.truth.layout, estimate.layout))
        errors = plane_errors(sample.truth.cuboid, estimate.cuboid, names)
        seen = np.isfinite(errors.offset_m)
        within += ((errors.offset_m <= 0.03) & (errors.angle_deg <= 0.5))[seen].tolist()
    assert len(within) > 25
    assert np.mean(within) >= (0.9 if views.noise == "stereo" else 0.95)


@pytest.mark.parametrize("size_m", [0.03, 0.05])
@pytest.mark.parametrize("noise", NOISES)
def test_cubes_of_three_and_five_centimetres_are_found(estimator: LayoutEstimator, noise: str, size_m: float) -> None:
    """At a metre and a half, in nine of ten."""
    found = total = 0
    for seed in range(4):
        rng = np.random.default_rng([seed, 12])
        room, pose, places = scene_with_small_things(rng, size_m)
        frame = render(room, KINECT, pose, NOISES[noise], rng).frame
        found += found_things(free_space_of(frame, estimator.estimate(frame)), places)
        total += len(places)
    assert found >= 0.9 * total


def test_the_views_of_a_walk_are_those_of_the_source() -> None:
    (_, first), *_ = views_of_walk(WALK, "kinect", 1, rate_hz=30.0)
    options = {"small_objects": 12, "furniture": 0.6}
    (same,) = SyntheticSource(frames=1, seed=WALK, noise="kinect", walk=True, options=options)
    assert isinstance(same, Sample)
    assert first.frame.depth_m is not None
    assert same.frame.depth_m is not None
    np.testing.assert_array_equal(first.frame.depth_m, same.frame.depth_m)
