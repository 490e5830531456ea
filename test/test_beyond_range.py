"""Faces beyond the sensor's reach or the picture: placed by the picture and trusted less, or without a distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks._free_space import MOUNTS, random_views
from benchmarks.beyond_range import cut_off, view_along
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.labels import FRONT_FACE, N_FACES


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator()


@pytest.mark.parametrize("reach", [0.8, 0.6])
@pytest.mark.parametrize("seed", [0, 1, 4, 5])
def test_a_wall_beyond_the_sensors_range_is_where_the_picture_has_it(
    estimator: LayoutEstimator, seed: int, reach: float
) -> None:
    frame, front_m = view_along(seed)
    seen, inferred = estimator.estimate(frame), estimator.estimate(cut_off(frame, reach * front_m))
    assert inferred.cuboid is not None
    assert abs(inferred.cuboid.distances[FRONT_FACE] / front_m - 1.0) < 0.05
    assert inferred.face_confidence[FRONT_FACE] <= 0.55 * seen.face_confidence[FRONT_FACE], "no depth lies on it"


def test_a_face_of_which_no_pixel_is_in_view_has_no_distance() -> None:
    by_color = LayoutEstimator(EstimatorConfig(use_depth=False))
    hidden = 0
    for _, sample in random_views(range(12), 5, "kinect", mount=MOUNTS["high"]):
        estimate = by_color.estimate(sample.frame)
        assert estimate.cuboid is not None
        pixels = np.bincount(estimate.layout.ravel(), minlength=N_FACES + 1)[1:]
        np.testing.assert_array_equal(np.isfinite(estimate.cuboid.distances), pixels > 0)
        hidden += int((pixels == 0).sum())
    assert hidden > 12


@pytest.mark.parametrize(("width", "height"), [(320, 240), (161, 121)])
def test_no_face_without_a_pixel_has_confidence_in_small_pictures(width: int, height: int) -> None:
    camera = CameraIntrinsics(width, height, 0.82 * width, 0.82 * width, width / 2 - 0.5, height / 2 - 0.5)
    by_color = LayoutEstimator(EstimatorConfig(use_depth=False))
    for _, sample in random_views(range(6), 5, "clean", mount=replace(MOUNTS["high"], camera=camera)):
        estimate = by_color.estimate(sample.frame)
        assert estimate.cuboid is not None
        pixels = np.bincount(estimate.layout.ravel(), minlength=N_FACES + 1)[1:]
        assert not estimate.face_confidence[pixels == 0].any()
        assert np.isinf(estimate.cuboid.distances[pixels == 0]).all()
