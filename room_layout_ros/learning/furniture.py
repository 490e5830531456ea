"""Training of the furniture classifier on the table of the context classifier (docs/evidence.md)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.furniture import FurnitureModel, save_furniture
from ..core.labels import FURNITURE_IDS
from .context_table import ContextTable
from .forest_export import BINS, export_forest


def train_furniture(
    table: ContextTable, out: Path, seed: int = 0, facts: Mapping[str, Any] | None = None
) -> FurnitureModel:
    """Train the furniture classifier on the table of `context.context_examples` and write the model.

    The same table, arguments and libraries give the same bytes.
    """
    rows = table.variant >= 0
    model = grow_furniture(table, rows, seed=seed)
    card = {"frames": len(np.unique(table.frame[rows])), "seed": seed, **(facts or {})}
    model = FurnitureModel(model.names, model.forest, card)
    save_furniture(model, out)
    return model


def grow_furniture(
    table: ContextTable, rows: NDArray[np.bool_], trees: int = 40, leaves: int = 16, seed: int = 0
) -> FurnitureModel:
    """Grow the furniture forest on the clutter superpixels among the rows; one thread, as `context.grow`."""
    from sklearn.ensemble import HistGradientBoostingClassifier
    from threadpoolctl import threadpool_limits

    structural = table.structure / np.maximum(table.pixels, 1.0)
    use = rows & (structural < 0.5) & (table.pixels > 50)
    counts = furniture_counts(table)
    classifier = HistGradientBoostingClassifier(
        max_iter=trees,
        learning_rate=0.15,
        max_leaf_nodes=leaves,
        min_samples_leaf=40,
        l2_regularization=2.0,
        max_bins=BINS["furniture"],
        max_features=0.3,
        early_stopping=False,
        random_state=seed,
    )
    with threadpool_limits(1, "openmp"):
        classifier.fit(table.features[use], counts[use].argmax(axis=1), sample_weight=table.pixels[use] / 1500.0)
    return FurnitureModel(table.names, export_forest(classifier, counts.shape[1]))


def furniture_counts(table: ContextTable) -> NDArray[np.float32]:
    """(n, 7) float32 pixels of the six furniture classes and of other clutter."""
    named = table.classes[:, list(FURNITURE_IDS)]
    other = np.maximum(table.pixels - table.structure - named.sum(axis=1), 0.0)
    return np.concatenate([named, other[:, None]], axis=1)
