"""Boosted trees: equal to their naive twin and to scikit-learn, and refused when they are not trees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import naive_evidence as naive
import numpy as np
import pytest
from scipy.special import softmax

from room_layout_ros.core.forest import MAX_LEAVES, Forest
from room_layout_ros.learning.forest_export import export_forest

Fitted = tuple[np.ndarray, Any, Forest]
HistGradientBoostingClassifier = pytest.importorskip("sklearn.ensemble").HistGradientBoostingClassifier


def _rows(rng: np.random.Generator, n: int = 600) -> tuple[np.ndarray, np.ndarray]:
    x = rng.normal(size=(n, 6)).astype(np.float32)
    y = (x[:, 0] > 0.3).astype(int) + (x[:, 1] * x[:, 2] > 0)
    x[rng.random(x.shape) < 0.15] = np.nan
    x[:, 5] = np.round(x[:, 5])  # ties at thresholds
    return x, y


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    x, y = _rows(np.random.default_rng(7))
    model = HistGradientBoostingClassifier(max_iter=12, max_leaf_nodes=9, early_stopping=False).fit(x, y)
    return x, model, export_forest(model, 3)


def test_kernel_equals_the_naive_twin(fitted: Fitted) -> None:
    x, _, forest = fitted
    assert np.allclose(forest.evaluate(x[:100]), naive.evaluate_forest(forest, x[:100]), atol=1e-5)


def test_export_gives_the_probabilities_of_the_trainer(fitted: Fitted) -> None:
    x, model, forest = fitted
    assert np.abs(softmax(forest.evaluate(x), axis=1) - model.predict_proba(x)).max() < 1e-5


def test_binary_export_gives_log_odds() -> None:
    x, y = _rows(np.random.default_rng(8))
    model = HistGradientBoostingClassifier(max_iter=10, early_stopping=False).fit(x, y > 0)
    odds = export_forest(model, 1).evaluate(x)[:, 0]
    assert np.abs(1 / (1 + np.exp(-odds)) - model.predict_proba(x)[:, 1]).max() < 1e-5


@pytest.mark.parametrize("classes", ([0, 2, 5], [1, 4]))
def test_a_class_that_was_not_there_to_learn_from_is_never_the_answer(classes: list[int]) -> None:
    x, y = _rows(np.random.default_rng(9))
    y = np.array(classes)[np.minimum(y, len(classes) - 1)]
    model = HistGradientBoostingClassifier(max_iter=10, early_stopping=False).fit(x, y)
    probability = softmax(export_forest(model, 6).evaluate(x), axis=1)
    assert np.abs(probability[:, classes] - model.predict_proba(x)).max() < 1e-5
    assert np.delete(probability, classes, axis=1).max() < 1e-6


def test_arrays_round_trip_through_a_file_without_pickle(fitted: Fitted, tmp_path: Path) -> None:
    x, _, forest = fitted
    np.savez(tmp_path / "f.npz", allow_pickle=False, **forest.to_arrays("a_"))
    with np.load(tmp_path / "f.npz", allow_pickle=False) as archive:
        again = Forest.from_arrays(dict(archive), "a_")
    assert np.array_equal(again.evaluate(x), forest.evaluate(x))


def test_more_columns_are_allowed_and_fewer_refused(fitted: Fitted) -> None:
    x, _, forest = fitted
    wide = np.concatenate([x, np.zeros((len(x), 2), np.float32)], axis=1)
    assert np.array_equal(forest.evaluate(wide), forest.evaluate(x))
    with pytest.raises(ValueError, match="columns"):
        forest.evaluate(np.ascontiguousarray(x[:, :2]))
    with pytest.raises(ValueError, match="float64"):
        forest.evaluate(x.astype(np.float64))


@pytest.mark.parametrize("field", ["left", "right"])
@pytest.mark.parametrize("value", [0, -3, 30000])
def test_links_that_leave_the_tree_or_loop_are_refused(fitted: Fitted, field: str, value: int) -> None:
    forest = fitted[2]
    links = getattr(forest, field).copy()
    links[0] = value
    with pytest.raises(ValueError, match="children"):
        replace(forest, **{field: links})


def test_every_malformed_array_is_refused(fitted: Fitted) -> None:
    forest = fitted[2]
    bad: list[dict[str, Any]] = [
        {"threshold": np.where(np.arange(len(forest.threshold)) == 3, np.nan, forest.threshold).astype(np.float32)},
        {"output": np.full_like(forest.output, 9)},
        {"root": forest.root[::-1].copy()},
        {"feature": forest.feature.astype(np.int64)},
        {"left": forest.left[:-1]},
        {"baseline": np.zeros(0, np.float32)},
    ]
    for change in bad:
        with pytest.raises(ValueError, match="forest"):
            replace(forest, **change)
    with pytest.raises(ValueError, match="missing"):
        Forest.from_arrays({})


def _comb(leaves: int) -> Forest:
    """One tree of that many leaves: x <= 0, else x <= 1, else x <= 2, ..."""
    inner, leaf = np.arange(leaves - 1), np.arange(leaves)
    left, right = leaves - 1 + inner, np.append(inner[1:], 2 * leaves - 2)
    return Forest(
        np.concatenate([np.zeros_like(inner), np.full_like(leaf, -1)]).astype(np.int16),
        np.concatenate([inner, leaf]).astype(np.float32),
        np.zeros(2 * leaves - 1, bool),
        np.concatenate([left, np.zeros_like(leaf)]).astype(np.int16),
        np.concatenate([right, np.zeros_like(leaf)]).astype(np.int16),
        np.array([0], np.int32),
        np.array([0], np.int16),
        np.zeros(1, np.float32),
    )


def test_every_leaf_of_the_largest_tree_is_found_and_a_larger_one_is_refused() -> None:
    rows = np.arange(MAX_LEAVES, dtype=np.float32)[:, None]
    assert np.array_equal(_comb(MAX_LEAVES).evaluate(rows), rows)
    with pytest.raises(ValueError, match="33 leaves"):
        _comb(MAX_LEAVES + 1)


def test_a_node_with_two_parents_is_refused() -> None:
    forest = _comb(3)
    with pytest.raises(ValueError, match="one parent"):
        replace(forest, right=np.where(np.arange(5) == 1, forest.left[0], forest.right).astype(np.int16))
