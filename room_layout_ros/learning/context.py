"""Training of the geometric context classifier, with honest (out-of-fold) probabilities (docs/evidence.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.evidence.features import SuperpixelFeatures
from ..core.evidence.geometric_context import ContextModel, compute_geometric_context, save_context
from ..core.labels import N_FACES, N_LABELS
from ..core.layout import RoomCuboid
from ..datasets.folder import FramesFolder
from ..datasets.sample import good_samples
from ..datasets.synthetic import NOISES
from .context_table import ContextTable, collect_table, join_tables
from .folds import MARGIN, SYNTHETIC_FIRST, is_near, row_folds
from .forest_export import BINS, export_forest
from .scene_folds import SceneFolds
from .synthetic_frames import random_frames


@dataclass(frozen=True, slots=True)
class ContextSettings:
    """How the forests are grown; found by cross-validation (docs/evidence.md has the table).

    Attributes
    ----------
    trees, learning_rate, leaves : of the forest that tells structure from clutter.
    face_trees, face_leaves : of the forest that tells the faces apart.
    synthetic_frames : how many synthetic frames to learn from besides; colour of theirs is of little use without depth.
    synthetic_weight : of a synthetic superpixel against a real one. synthetic_seed : of the rooms.
    degraded_every : every how many-th frame is learned from a second time, with degraded depth.
    seed : of the columns that each tree may look at and of the degraded depth.
    """

    trees: int = 120
    learning_rate: float = 0.1
    leaves: int = 24
    face_trees: int = 40
    face_leaves: int = 12
    synthetic_frames: int = 480
    synthetic_weight: float = 0.5
    synthetic_seed: int = 6
    degraded_every: int = 2
    seed: int = 0


RGB_SETTINGS = ContextSettings(trees=150, synthetic_frames=0)
"""Without depth."""


def train_context(
    source: FramesFolder,
    rooms: Mapping[str, RoomCuboid],
    out: Path,
    config: EstimatorConfig,
    held_out: Sequence[str] = (),
    settings: ContextSettings | None = None,
    folds: int = 0,
    facts: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] = lambda _: None,
    networks: SceneFolds | None = None,
) -> tuple[ContextModel, ContextTable]:
    """Train on a folder of labelled frames and write the model; returns the table too, for `furniture.train_furniture`.

    The same data, arguments and libraries give the same bytes.

    Parameters
    ----------
    source : frames with NYU40 labels.
    rooms : fitted rooms by frame name (`learning.fit_frame.read_fits`), for the names of walls.
    out : file to write (.npz).
    config : `use_depth` False trains the RGB variant.
    held_out : names of frames to keep out, with their neighbours (`folds.is_near`).
    settings : by default those that ship.
    folds : of the cross-validation whose errors go on the card, 0 for none; takes `folds` times as long.
    facts : more for the card (command, date).
    networks : scene networks whose features to add.
    """
    settings = settings or (ContextSettings() if config.use_depth else RGB_SETTINGS)
    names = tuple(name for name, near in zip(source.names, is_near(source.names, held_out), strict=True) if not near)
    progress(f"features of {len(names)} frames and {settings.synthetic_frames} synthetic ones")
    table = context_examples(source.subset(names), rooms, config, settings, networks)
    card: dict[str, Any] = {
        "frames": len(np.unique(table.frame[table.variant >= 0])),
        "degraded": len(np.unique(table.frame[table.variant > 0])),
        "synthetic": len(np.unique(table.frame[table.variant < 0])),
        "superpixels": len(table.frame),
        "source": source.path.name,
        "held_out": list(held_out),
        "margin": MARGIN,
        "depth": config.use_depth,
        "settings": {name: getattr(settings, name) for name in settings.__slots__},
        **(facts or {}),
    }
    if folds:
        progress(f"cross-validation in {folds} folds")
        card["folds"] = folds
        card["cross_validation"] = domain_errors(table, out_of_fold(table, settings, folds))
    progress(f"growing trees on {len(table.frame)} superpixels")
    model = grow(table, np.ones(len(table.frame), bool), settings)
    model = ContextModel(model.names, model.structure, model.face, card)
    save_context(model, out)
    return model, table


def context_examples(
    source: FramesFolder,
    rooms: Mapping[str, RoomCuboid],
    config: EstimatorConfig,
    settings: ContextSettings,
    networks: SceneFolds | None = None,
) -> ContextTable:
    """Collect the rows to learn from: real frames, the same with degraded depth, synthetic rooms."""
    table = collect_table(
        good_samples(source), rooms, config, settings.degraded_every, settings.seed, networks=networks
    )
    if settings.synthetic_frames == 0:
        return table
    samples = random_frames(settings.synthetic_frames, settings.synthetic_seed)
    unseen = None if networks is None else SceneFolds(networks.folder)  # the network of all frames did not see them
    synthetic = collect_table(samples, {}, config, degraded_every=0, synthetic=True, networks=unseen)
    return join_tables([table, synthetic])


def domain_errors(table: ContextTable, probability: NDArray[np.float64]) -> dict[str, dict[str, float]]:
    """Errors in percent of real, degraded and synthetic frames; rows without a probability (NaN) are left out."""
    done = np.isfinite(probability[:, 0])
    named = table.labels[:, 1:].sum(axis=1) > 0
    domains = {"real": table.variant == 0, "degraded": table.variant > 0}
    for k, noise in enumerate(NOISES):
        domains[f"synthetic_{noise}"] = (table.variant < 0) & ((table.frame - SYNTHETIC_FIRST) % len(NOISES) == k)
    errors = {}
    for name, rows in domains.items():
        if (rows & done).any():
            errors[name] = {"structure": round(100.0 * structure_error(table, probability, rows & done), 2)}
        if (rows & done & named).any():
            errors[name]["labels"] = round(100.0 * label_error(table, probability, rows & done), 2)
    return errors


def grow(table: ContextTable, rows: NDArray[np.bool_], settings: ContextSettings) -> ContextModel:
    """Grow both forests on the rows given.

    A superpixel weighs as much as it has labelled pixels, and less the more mixed it is. One thread: the order in which
    threads add up would show in the last digits.

    Raises
    ------
    ValueError
        When among the rows is no frame, no clutter, no structure or fewer than two faces.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "openmp"):
        return _grow(table, rows, settings)


def _grow(table: ContextTable, rows: NDArray[np.bool_], settings: ContextSettings) -> ContextModel:
    from sklearn.ensemble import HistGradientBoostingClassifier

    pixels = np.maximum(table.pixels, 1.0)
    share = table.structure / pixels
    weight = table.pixels / 1500.0 * np.abs(2.0 * share - 1.0)
    use = rows & (weight > 0.05)
    weight *= np.where(table.variant < 0, settings.synthetic_weight, 1.0)
    named = use & (share > 0.5) & (table.labels[:, 1 : N_FACES + 1].sum(axis=1) > 0.5 * table.structure)
    _check_classes(table, use, share > 0.5, named)
    common: dict[str, Any] = {"max_features": 0.4, "early_stopping": False, "random_state": settings.seed}
    structure = HistGradientBoostingClassifier(
        max_iter=settings.trees,
        learning_rate=settings.learning_rate,
        max_leaf_nodes=settings.leaves,
        min_samples_leaf=60,
        l2_regularization=2.0,
        max_bins=BINS["structure"],
        **common,
    ).fit(table.features[use], share[use] > 0.5, sample_weight=weight[use])
    face = HistGradientBoostingClassifier(
        max_iter=settings.face_trees,
        learning_rate=0.2,
        max_leaf_nodes=settings.face_leaves,
        min_samples_leaf=40,
        l2_regularization=1.0,
        max_bins=BINS["face"],
        **common,
    ).fit(
        table.features[named],
        table.labels[named, 1 : N_FACES + 1].argmax(axis=1),
        sample_weight=weight[named],
    )
    return ContextModel(table.names, export_forest(structure, 1), export_forest(face, N_FACES))


def _check_classes(
    table: ContextTable, use: NDArray[np.bool_], structural: NDArray[np.bool_], named: NDArray[np.bool_]
) -> None:
    frames = len(np.unique(table.frame))
    if not use.any():
        raise ValueError(
            f"of {frames} frames none is left to learn from beside a fold and its neighbours ({MARGIN} numbers, or "
            "frames where names are no numbers, to each side); more frames are needed"
        )
    faces = len(np.unique(table.labels[named, 1 : N_FACES + 1].argmax(axis=1)))
    for what, there in (
        ("structure", (use & structural).any()),
        ("clutter", (use & ~structural).any()),
        ("two faces of rooms", faces > 1),
    ):
        if not there:
            raise ValueError(f"{frames} frames show no {what} to learn from; more frames, or other ones, are needed")


def out_of_fold(
    table: ContextTable,
    settings: ContextSettings | None = None,
    folds: int = 4,
    progress: Callable[[str], object] = lambda _: None,
) -> NDArray[np.float64]:
    """(n, 6) probabilities of each row from forests that have not seen its frame or a neighbour of it."""
    probability = np.full((len(table.frame), N_LABELS), np.nan)
    for number, (train, validate) in enumerate(row_folds(table.frame, folds), 1):
        progress(f"context: fold {number} of {folds}")
        model = grow(table, train, settings or ContextSettings())
        rows = SuperpixelFeatures(np.ascontiguousarray(table.features[validate]), table.names)
        probability[validate] = compute_geometric_context(rows, model)
    return probability


def structure_error(table: ContextTable, probability: NDArray[np.float64], rows: NDArray[np.bool_]) -> float:
    """Share of labelled pixels on the wrong side of structure against clutter."""
    clutter = probability[rows].argmax(axis=1) == N_LABELS - 1
    pixels, structure = table.pixels[rows], table.structure[rows]
    return float(np.where(clutter, structure, pixels - structure).sum() / max(pixels.sum(), 1.0))


def label_error(table: ContextTable, probability: NDArray[np.float64], rows: NDArray[np.bool_]) -> float:
    """Share of labelled pixels with a wrong label, walls by their names in the axes of the features."""
    known = rows & (table.labels[:, 1:].sum(axis=1) > 0)
    chosen = probability[known].argmax(axis=1) + 1
    labels = table.labels[known]
    return float(1.0 - labels[np.arange(len(labels)), chosen].sum() / labels[:, 1:].sum())
