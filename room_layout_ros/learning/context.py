"""Training of the geometric context classifier, with honest (out-of-fold) probabilities (docs/evidence.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.evidence.features import SuperpixelFeatures
from ..core.evidence.geometric_context import ContextModel, compute_geometric_context, save_context
from ..core.forest import Forest
from ..core.furniture import FurnitureModel, save_furniture
from ..core.labels import FURNITURE_IDS, N_FACES, N_LABELS
from ..core.layout import RoomCuboid
from ..datasets.folder import FramesFolder
from ..datasets.sample import good_samples
from ..datasets.synthetic import NOISES
from .context_table import ContextTable, collect_table, join_tables
from .folds import MARGIN, SYNTHETIC_FIRST, is_near, is_near_block
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


BINS = {"structure": 127, "face": 63, "furniture": 63}
"""Bins of a feature per forest. With weights scikit-learn takes 0.3 ms a bin and feature to find them."""


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
    """Train on a folder of labelled frames and write the model; returns the table too, for `train_furniture`.

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


def block_folds(frame: NDArray[np.int64], folds: int) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Yield (train, validate) row masks: contiguous blocks of frame numbers, `folds.MARGIN` numbers apart.

    Synthetic frames are blocks of their own: each fold has its share of both kinds.
    """
    numbers = np.unique(frame)
    real = np.array_split(numbers[numbers < SYNTHETIC_FIRST], folds)
    synthetic = np.array_split(numbers[numbers >= SYNTHETIC_FIRST], folds)
    for blocks in zip(real, synthetic, strict=True):
        train, validate = np.ones(len(frame), bool), np.zeros(len(frame), bool)
        for block in blocks:
            if len(block):
                validate |= (frame >= block[0]) & (frame <= block[-1])
                train &= ~is_near_block(frame, int(block[0]), int(block[-1]))
        yield train, validate


def out_of_fold(table: ContextTable, settings: ContextSettings | None = None, folds: int = 4) -> NDArray[np.float64]:
    """(n, 6) probabilities of each row from forests that have not seen its frame or a neighbour of it."""
    probability = np.full((len(table.frame), N_LABELS), np.nan)
    for train, validate in block_folds(table.frame, folds):
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


def train_furniture(
    table: ContextTable, out: Path, seed: int = 0, facts: Mapping[str, Any] | None = None
) -> FurnitureModel:
    """Train the furniture classifier on the table of `context_examples` and write the model.

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
    """Grow the furniture forest on the clutter superpixels among the rows; one thread, as `grow`."""
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
