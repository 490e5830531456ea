"""The measures of evaluation equal their slow twins and the cases one can do in the head."""

from __future__ import annotations

import numpy as np
import pytest
from naive_measures import (
    naive_ece,
    naive_error,
    naive_iou,
    naive_permuted_error,
    naive_renamed,
)
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.evaluation import geometry, measures

CAMERA = CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)


def random_images(seed: int, low: int = 0, high: int = 7) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    rng = np.random.default_rng(seed)
    truth = rng.integers(low, high, (15, 20)).astype(np.uint8)
    keep = rng.random((15, 20)) < 0.6
    return truth, np.where(keep, truth, rng.integers(0, high, (15, 20))).astype(np.uint8)


def rotation_y(degrees: float) -> NDArray[np.float64]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@pytest.mark.parametrize("seed", range(5))
def test_errors_equal_the_naive_ones(seed: int) -> None:
    truth, estimate = random_images(seed, high=6)
    labels, labels_estimate = random_images(seed + 100)
    score = measures.score_pixels(truth, estimate, labels, labels_estimate)
    assert score.layout_error_fixed == pytest.approx(naive_error(truth, estimate))
    assert score.layout_error == pytest.approx(naive_permuted_error(truth, estimate))
    assert score.labelling_error_fixed == pytest.approx(naive_error(labels, labels_estimate))
    renamed = naive_renamed(labels_estimate, score.wall_names[3:6])
    assert score.labelling_error == pytest.approx(naive_error(labels, renamed))
    for counts, compared in ((score.labels_confusion, renamed), (score.labels_confusion_fixed, labels_estimate)):
        expected = [naive_iou([labels], [compared], label) for label in range(1, 7)]
        np.testing.assert_allclose(measures.iou_per_class(counts), expected)


def test_renamed_walls_cost_the_fixed_error_only() -> None:
    truth = np.repeat(np.array([[2, 3, 4, 5]], np.uint8), 10, axis=0)
    score = measures.score_pixels(truth, naive_renamed(truth, (4, 5, 3)))
    assert (score.layout_error_fixed, score.layout_error) == (0.75, 0.0)


def test_walls_of_the_labelling_are_renamed_as_the_layouts_and_not_on_their_own() -> None:
    layout = np.full((2, 4), 4, np.uint8)
    swapped = np.full((2, 4), 3, np.uint8)  # the labelling calls everything "left"; the layout is right
    score = measures.score_pixels(layout, layout, layout, swapped)
    assert score.layout_error == 0.0
    assert score.labelling_error == 1.0


def test_an_estimate_of_unknown_is_wrong_and_a_pixel_without_truth_is_not_counted() -> None:
    truth = np.array([[0, 0, 2, 2]], np.uint8)
    assert measures.error(measures.confusion(truth, np.array([[1, 2, 0, 2]], np.uint8))) == 0.5
    assert np.isnan(measures.error(measures.confusion(np.zeros((1, 4), np.uint8), truth)))


def test_iou_sums_pixels_over_the_set_before_it_divides() -> None:
    pairs = [random_images(seed) for seed in range(4)]
    truths, estimates = [p[0] for p in pairs], [p[1] for p in pairs]
    counts = np.sum([measures.confusion(t, e) for t, e in pairs], axis=0)
    expected = [naive_iou(truths, estimates, label) for label in range(1, 7)]
    np.testing.assert_allclose(measures.iou_per_class(counts), expected)
    assert measures.mean_iou(counts) == pytest.approx(np.mean(expected))


def test_a_class_that_never_occurs_has_no_iou() -> None:
    counts = measures.confusion(np.full((2, 2), 2, np.uint8), np.full((2, 2), 2, np.uint8))
    assert np.isnan(measures.iou_per_class(counts)).sum() == 5
    assert measures.mean_iou(counts) == 1.0


@pytest.mark.parametrize(("truth", "estimate", "words"), (((2, 2), (2, 3), "shape"), ((2, 2), None, "id 9")))
def test_bad_images_are_refused_with_a_sentence(
    truth: tuple[int, int], estimate: tuple[int, int] | None, words: str
) -> None:
    other = np.full(truth, 9, np.uint8) if estimate is None else np.ones(estimate, np.uint8)
    with pytest.raises(ValueError, match=words):
        measures.confusion(np.ones(truth, np.uint8), other)


def test_calibration_error_equals_the_naive_one_and_is_zero_for_an_honest_forecast() -> None:
    rng = np.random.default_rng(0)
    confidence, correct = rng.random(300), (rng.random(300) < 0.5).astype(float)
    assert measures.reliability(confidence, correct).ece == pytest.approx(naive_ece(confidence, correct, 10))
    honest = np.repeat([0.25, 0.75], 100)
    came_true = np.concatenate([np.arange(100) < 25, np.arange(100) < 75]).astype(float)
    assert measures.reliability(honest, came_true).ece == pytest.approx(0.0)
    assert measures.reliability(np.ones(10), np.zeros(10)).ece == 1.0


def test_bootstrap_interval_of_a_mean_agrees_with_the_normal_law() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    low, high = measures.bootstrap_interval(values, np.mean, np.random.default_rng(2), draws=4000)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert low == pytest.approx(values.mean() - half, abs=0.03)
    assert high == pytest.approx(values.mean() + half, abs=0.03)


def test_bootstrap_of_several_figures_equals_that_of_each_and_absent_ones_have_none() -> None:
    values = np.random.default_rng(1).normal(size=(30, 2))
    low, high = measures.bootstrap_interval(
        values, lambda v: np.append(v.mean(axis=0), np.nan), np.random.default_rng(2)
    )
    for k in range(2):
        own = measures.bootstrap_interval(values[:, k], np.mean, np.random.default_rng(2))
        np.testing.assert_allclose((low[k], high[k]), own)
    assert np.isnan([low[2], high[2]]).all()


def room(*distances: float, degrees: float = 0.0) -> RoomCuboid:
    return RoomCuboid(rotation_y(degrees), np.array(distances))


def test_corners_of_a_room_seen_straight_on_are_the_four_of_the_front_wall_and_the_images() -> None:
    layout = room(1, 1, 1, 3, 1).raster(CAMERA)
    corners = geometry.layout_corners(layout)
    expected = {(79.5 + sx * 130 / 3, 59.5 + sy * 130 / 3) for sx in (-1, 1) for sy in (-1, 1)}
    for x, y in expected:
        assert np.abs(corners - (x, y)).max(axis=1).min() < 1.0
    assert len(corners) == 8  # and the four points where a wall's edge meets the border


def test_corner_error_is_the_shift_of_the_corners_and_a_missing_corner_has_its_price() -> None:
    layout = np.full((100, 100), 4, np.uint8)
    layout[50:] = 2
    shifted = np.full((100, 100), 4, np.uint8)
    shifted[60:] = 2
    assert geometry.corner_error(layout, layout) == 0.0
    assert geometry.corner_error(layout, shifted) == pytest.approx(10 / np.hypot(100, 100))
    assert geometry.corner_error(layout, np.full((100, 100), 4, np.uint8)) == geometry.MISSING_CORNER


def test_planes_are_compared_under_the_layouts_wall_names() -> None:
    truth, turned = room(1, 1, 2, 3, 2.5), room(1, 1.1, np.inf, 2, 3, degrees=92)
    names = (0, 1, 2, 5, 3, 4, 6)  # the estimate's front is the truth's left, its right the truth's front
    errors = geometry.plane_errors(truth, turned, names)
    np.testing.assert_allclose(errors.offset_m, [0, 0.1, 0, 0, np.nan], atol=1e-9)
    np.testing.assert_allclose(errors.angle_deg, [0, 0, 2, 2, np.nan], atol=1e-6)


@pytest.mark.parametrize("quarter_turns", range(4))
def test_axes_error_ignores_the_cubes_own_rotations(quarter_turns: int) -> None:
    R = rotation_y(3.0) @ rotation_y(90.0 * quarter_turns)
    assert geometry.axes_error_deg(np.eye(3), R) == pytest.approx(3.0)


def test_room_iou_of_a_front_wall_alone_is_the_cube_of_the_ratio_of_its_distances() -> None:
    near, far = room(9, 9, 9, 2, 9), room(9, 9, 9, 3, 9)
    assert geometry.room_iou(near, near, CAMERA) == pytest.approx(1.0)
    assert geometry.room_iou(near, far, CAMERA) == pytest.approx((2 / 3) ** 3)
    assert geometry.room_iou(far, room(*[np.inf] * 5), CAMERA, reach_m=6) == pytest.approx((3 / 6) ** 3)


def test_room_iou_is_the_share_of_points_in_view_that_both_rooms_hold() -> None:
    rng = np.random.default_rng(5)
    truth, estimate = room(1, 1.2, 1.0, 3, 1.5, degrees=20), room(1.1, 1.2, 1.2, 2.7, 1.3, degrees=17)
    found = geometry.room_iou(truth, estimate, CAMERA, reach_m=5)
    # Points even in volume: even in the image, depth by the cube root.
    z = 5 * np.cbrt(rng.random(400_000))
    x = (rng.uniform(-0.5, 159.5, z.size) - CAMERA.cx) / CAMERA.fx
    y = (rng.uniform(-0.5, 119.5, z.size) - CAMERA.cy) / CAMERA.fy
    points = np.stack([x * z, y * z, z])
    a, b = ((r.inverse_normals @ points <= 1).all(axis=0) for r in (truth, estimate))
    assert found == pytest.approx((a & b).sum() / (a | b).sum(), abs=0.005)


def test_room_iou_does_not_ask_which_wall_is_called_front_nor_for_walls_out_of_view() -> None:
    truth, turned = room(1, 1, 9, 3, 1.5, degrees=30), room(1, 1, 3, 1.5, np.inf, degrees=-60)
    np.testing.assert_allclose(
        geometry.plane_errors(truth, turned, (0, 1, 2, 4, 5, 3, 6)).angle_deg[[3, 4]], 0, atol=1e-5
    )
    assert geometry.room_iou(truth, turned, CAMERA) == pytest.approx(1.0)


def test_grid_iou_counts_cells() -> None:
    a, b = np.zeros((4, 4), bool), np.zeros((4, 4), bool)
    a[:2], b[1:3] = True, True
    assert geometry.grid_iou(a, b) == pytest.approx(4 / 12)
    assert np.isnan(geometry.grid_iou(np.zeros((2, 2), bool), np.zeros((2, 2), bool)))
