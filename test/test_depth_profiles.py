"""Support and violation of planes, and the fit of labels to them, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from naive_depth_profiles import naive_profiles

from room_layout_ros.core.depth_profiles import (
    FARTHEST_M,
    NEAREST_M,
    OFFSETS,
    compute_depth_profiles,
    curve_positions,
    interpolate,
    read_curve,
)
from room_layout_ros.core.plane_fit import PlaneFit


def test_profiles_are_those_of_every_cell_against_every_offset(rng: np.random.Generator) -> None:
    points = rng.uniform((-3, -2, 0.1), (3, 2, 8), (300, 3))
    points[::17] = np.nan
    agreement, structure, sigma = rng.uniform(size=(300, 3)), rng.uniform(size=(300, 5)), rng.uniform(0, 0.1, 300)
    found = compute_depth_profiles(points, agreement, structure, sigma)
    support, violation = naive_profiles(points, agreement, structure, sigma)
    np.testing.assert_allclose(found.support, support, atol=1e-10)
    np.testing.assert_allclose(found.violation, violation, atol=1e-9)  # sums of (offset / width)^2


def test_a_wall_is_supported_where_it_is_and_violated_before_it() -> None:
    y, x = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20)))
    points = np.column_stack([x, y, np.full(400, 3.0)])
    agreement = np.tile([0.0, 0.0, 1.0], (400, 1))
    found = compute_depth_profiles(points, agreement, np.ones((400, 5)), np.full(400, 0.01))
    support, violation = found.at(3, np.array([2.5, 2.99, 3.0, 3.5, np.inf]))
    assert support[2] > 0.7
    np.testing.assert_allclose(support[[0, 3, 4]], 0.0, atol=1e-10)
    assert violation[0] == pytest.approx(1.0)
    np.testing.assert_allclose(violation[3:], 0.0, atol=1e-9)
    assert np.abs(found.scales - 3.0).min() < 0.05
    assert found.at(2, np.array([0.5]))[0] == 0.0  # the normal is no side wall's


def test_scales_are_within_reach_and_as_many_as_asked_for(rng: np.random.Generator) -> None:
    points = rng.uniform((-3, -2, 0.5), (3, 2, 6), (500, 3))
    for count in (4, 12, 40):
        scales = compute_depth_profiles(points, np.ones((500, 3)), np.ones((500, 5)), np.full(500, 0.02), count).scales
        assert 1 <= len(scales) <= count
        assert ((scales >= NEAREST_M) & (scales <= FARTHEST_M)).all()
        assert (np.diff(scales) > 0).all()


def test_without_a_measured_cell_there_is_no_support_and_still_a_scale() -> None:
    nothing = np.full((10, 3), np.nan)
    found = compute_depth_profiles(nothing, np.ones((10, 3)), np.ones((10, 5)), np.ones(10))
    assert not found.support.any()
    assert not found.violation.any()
    assert len(found.scales) >= 1


def test_interpolation_is_linear_in_log_distance_and_zero_at_infinity() -> None:
    profile = np.arange(len(OFFSETS), dtype=np.float64)
    middle = np.sqrt(OFFSETS[7] * OFFSETS[8])
    np.testing.assert_allclose(interpolate(profile, np.array([OFFSETS[7], middle, np.inf])), [7.0, 7.5, 0.0])


def one_superpixel(offset: float) -> PlaneFit:
    return PlaneFit(np.full((1, 5), offset), np.ones((1, 5)), np.array([0.1]))


@pytest.mark.parametrize(
    ("plane", "on", "front", "beyond"),
    ((3.0, 0.9, 0.0, 0.0), (3.6, 0.0, 1.0, 0.0), (2.4, 0.0, 0.0, 1.0), (np.inf, 0.0, 1.0, 0.0)),
)
def test_a_superpixel_is_on_in_front_of_or_beyond_a_plane(plane: float, on: float, front: float, beyond: float) -> None:
    shares = one_superpixel(3.0).at(np.full(5, plane))[0, 3]
    assert shares[0] >= on
    assert shares[1] == pytest.approx(front)
    assert shares[2] == pytest.approx(beyond)


def test_a_superpixel_without_plane_fits_everywhere_and_nowhere() -> None:
    assert not one_superpixel(float("nan")).at(np.array([1.0, 2.0, 3.0, 4.0, np.inf])).any()


def test_curves_are_the_fit_of_the_labels_at_every_distance(rng: np.random.Generator) -> None:
    fit = PlaneFit(rng.uniform(-0.5, 5, (40, 5)), rng.uniform(size=(40, 5)), rng.uniform(0.05, 0.2, 40))
    labels, area, weights = rng.integers(0, 6, 40), rng.uniform(size=40), rng.normal(size=(5, 3))
    curves, absent = fit.curves(labels, area, weights)
    for distance in (0.21, 0.7, 2.345, 14.0, 20.0, np.inf):
        shares = fit.at(np.full(5, distance))
        for face in range(5):
            mine = labels == face
            expected = float((area[mine] * (shares[mine, face] @ weights[face])).sum())
            found = read_curve(curves[face], float(absent[face]), curve_positions(np.array([distance])))[0]
            assert found == pytest.approx(expected, abs=1e-9)


def test_the_least_fit_is_below_the_fit_at_any_distance(rng: np.random.Generator) -> None:
    fit = PlaneFit(rng.uniform(-0.5, 5, (20, 5)), rng.uniform(size=(20, 5)), rng.uniform(0.05, 0.2, 20))
    weights = rng.normal(size=(5, 3))
    least = fit.least(weights)
    for distance in (*rng.uniform(0.2, 15, 20), np.inf):
        cost = np.einsum("kfr,fr->kf", fit.at(np.full(5, distance)), weights)
        assert (least[:, :5] <= cost + 1e-12).all()
    assert not least[:, 5].any()
