"""Boosted trees of scikit-learn as the plain arrays that ship, with the same scores."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.forest import Forest

BINS = {"structure": 127, "face": 63, "furniture": 63}
"""Bins of a feature per forest. With weights scikit-learn takes 0.3 ms a bin and feature to find them."""

_NEVER = -30.0
"""Score of a class that was not among the rows to learn from: its probability is 1e-13."""


def export_forest(classifier: Any, outputs: int) -> Forest:
    """Turn a fitted scikit-learn HistGradientBoostingClassifier into plain arrays with the same scores.

    Thresholds are rounded down to float32: for float32 rows, x <= threshold then has the same answer.

    Parameters
    ----------
    classifier : fitted to the classes 0..outputs - 1, some of which may be missing; for one output to False and True.
    """
    found = np.ravel(classifier._baseline_prediction).astype(np.float32)
    places = np.zeros(1, np.intp) if outputs == 1 else classifier.classes_.astype(np.intp)
    baseline = np.full(outputs, _NEVER, np.float32)
    baseline[places] = 0.0
    places = places[-len(found) :]  # of two classes there is one score, of the second against the first
    baseline[places] = found
    trees = [(k, p.nodes) for iteration in classifier._predictors for k, p in enumerate(iteration)]
    nodes = np.concatenate([tree for _, tree in trees])
    leaf = nodes["is_leaf"].astype(bool)
    exact = nodes["num_threshold"]
    with np.errstate(over="ignore"):
        threshold = exact.astype(np.float32)
    threshold = np.where(threshold.astype(np.float64) > exact, np.nextafter(threshold, np.float32(-np.inf)), threshold)
    threshold = np.clip(threshold, np.finfo(np.float32).min, np.finfo(np.float32).max)
    return Forest(
        feature=np.where(leaf, -1, nodes["feature_idx"]).astype(np.int16),
        threshold=np.where(leaf, nodes["value"], threshold).astype(np.float32),
        missing_left=nodes["missing_go_to_left"].astype(bool),
        left=nodes["left"].astype(np.int16),
        right=nodes["right"].astype(np.int16),
        root=np.cumsum([0] + [len(tree) for _, tree in trees[:-1]]).astype(np.int32),
        output=np.array([places[k] for k, _ in trees], np.int16),
        baseline=baseline,
    )
