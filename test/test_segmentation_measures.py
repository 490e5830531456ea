"""ME, covering and variation of information against their definitions and hand-counted cases."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import naive_superpixels as naive
import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation.published import TABLE_3
from room_layout_ros.evaluation.segmentation import (
    contingency,
    covering,
    segmentation_scores,
    variation_of_information,
)
from room_layout_ros.evaluation.superpixel_table import SETTINGS, TRUTHS, row_name, segmentation_of


def test_a_perfect_segmentation_has_no_error(rng: np.random.Generator) -> None:
    truth = rng.integers(1, 6, (20, 30))
    scores = segmentation_scores(truth, truth)
    assert scores.mean_error == 0
    assert scores.covering == 1
    assert scores.variation_of_information == pytest.approx(0, abs=1e-12)


def test_hand_counted_case() -> None:
    truth = np.array([[1, 1, 1, 2], [1, 1, 1, 2]])
    segments = np.array([[0, 0, 1, 1], [0, 0, 1, 1]])  # the second segment ties; its majority is class 1
    scores = segmentation_scores(segments, truth)
    assert scores.mean_error == pytest.approx(2 / 8)
    assert scores.covering == pytest.approx((6 * 6 / 8 + 2 * 2 / 8) / 8)  # the oracle says 1 everywhere
    assert scores.variation_of_information == pytest.approx(-(0.75 * np.log(0.75) + 0.25 * np.log(0.25)))
    assert covering(contingency(segments, truth)) == pytest.approx((6 * 4 / 6 + 2 * 2 / 4) / 8)


def test_splitting_a_segment_costs_the_segments_but_not_the_oracle() -> None:
    truth = np.repeat([1, 2], 50).reshape(10, 10)
    segments = np.arange(100).reshape(10, 10)
    scores = segmentation_scores(segments, truth)
    assert (scores.mean_error, scores.covering) == (0, 1)
    assert scores.variation_of_information == pytest.approx(0, abs=1e-12)
    assert covering(contingency(segments, truth)) == pytest.approx(1 / 50)
    assert variation_of_information(contingency(segments, truth)) == pytest.approx(np.log(50))


def test_measures_equal_their_naive_twins_and_ignore_unlabelled_pixels(rng: np.random.Generator) -> None:
    truth, segments = rng.integers(0, 5, (24, 24)), rng.integers(0, 9, (24, 24))
    scores = segmentation_scores(segments, truth)
    known = truth > 0
    t, s = truth[known], segments[known]
    majority = np.array([np.bincount(t[s == k]).argmax() for k in range(9)])
    assert scores.pixels == known.sum()
    assert scores.mean_error == pytest.approx((majority[s] != t).mean())
    table = contingency(s, t)
    for found, labels in ((scores.covering, majority[s]), (covering(table), s)):
        assert found == pytest.approx(naive.covering(labels, t))
    for found, labels in ((scores.variation_of_information, majority[s]), (variation_of_information(table), s)):
        assert found == pytest.approx(naive.variation_of_information(labels, t))


@pytest.mark.parametrize(
    ("segments", "truth", "sentence"),
    [
        (np.zeros((2, 2), int), np.ones((2, 3), int), "segments are (2, 2) and labels (2, 3)"),
        (np.full((2, 2), -1), np.ones((2, 2), int), "smallest id is -1"),
        (np.zeros((2, 2), int), np.zeros((2, 2), int), "no pixel is labelled"),
    ],
)
def test_unusable_input_is_refused_in_a_sentence(segments: np.ndarray, truth: np.ndarray, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        segmentation_scores(segments, truth)


def test_the_rows_of_table_3_vary_what_their_names_say() -> None:
    """The paper's ratios for the residual to the plane, our depth term, and for the gradient, the paper's."""
    default = EstimatorConfig()
    found = {setting.name: setting.apply(default) for setting in SETTINGS}
    assert found["colour × 1, plane × 1"] == default
    assert len(found) == len(SETTINGS) == 2 * len(TABLE_3) - 1  # without depth there is one row
    for (color, depth), term in itertools.product(TABLE_3, ("plane", "gradient")):
        name = f"colour × {color}, {term} × {depth}"
        if name == "colour × 1, gradient × 0":
            assert name not in found
            continue
        config, weight = found[name], depth * default.superpixel_lambda_depth
        assert config.superpixel_lambda_color == color * default.superpixel_lambda_color
        weights = (config.superpixel_lambda_depth, config.superpixel_lambda_gradient)
        assert weights == ((weight, 0.0) if term == "plane" else (0.0, weight))


def test_table_3_is_measured_against_both_truths() -> None:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=3, walk=False, noise="clean"))
    rows = segmentation_of(sample, EstimatorConfig())
    assert set(rows) == {row_name(setting, truth) for setting in SETTINGS for truth in TRUTHS}
    without, with_plane, with_gradient = (
        rows[f"six labels: colour × 1, {term}"][0] for term in ("plane × 0", "plane × 1", "gradient × 1")
    )
    assert with_plane < with_gradient < without
    assert sample.truth is not None
    assert segmentation_of(replace(sample, truth=None), EstimatorConfig()) == {}
