"""Geometric context: how likely each superpixel is each face of the room, or clutter ([H09]; docs/evidence.md).

Two boosted forests: the first says whether a superpixel belongs to the room itself or to what stands in it (where
nearly all mistakes are made, so it gets nearly all trees), the second which face it is if it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..forest import Forest
from ..labels import N_FACES, N_LABELS
from ..model_file import WeightsError, read_arrays, write_arrays
from .features import SuperpixelFeatures

_KIND = "room_layout geometric context"
MAX_FEATURES = 1000


@dataclass(frozen=True, slots=True)
class ContextModel:
    """A trained classifier of superpixels.

    Attributes
    ----------
    names : features the forests read, in the order of their columns.
    structure : Forest with one output, log odds of being structure.
    face : Forest with five outputs, softmax scores of the faces among structure.
    card : what the trainer says about it; JSON values.

    Raises
    ------
    ValueError
        When the forests have other numbers of outputs or read more columns than there are names.
    """

    names: tuple[str, ...]
    structure: Forest
    face: Forest
    card: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.structure.outputs, self.face.outputs) != (1, N_FACES):
            outputs = f"{self.structure.outputs} and {self.face.outputs}"
            raise ValueError(f"context forests have {outputs} outputs; 1 and {N_FACES} are needed")
        needed = max(self.structure.feature_count, self.face.feature_count)
        if not needed <= len(self.names) <= MAX_FEATURES:
            raise ValueError(f"context model names {len(self.names)} features; {needed} to {MAX_FEATURES} are needed")


def compute_geometric_context(features: SuperpixelFeatures, model: ContextModel) -> NDArray[np.float64]:
    """Classify superpixels.

    Parameters
    ----------
    features : SuperpixelFeatures
    model : ContextModel
        Trained with the same features; one with depth for features with depth.

    Returns
    -------
    (K, 6) float64
        Probabilities of ceiling, floor, left, front, right wall and clutter; rows sum to 1.

    Raises
    ------
    ValueError
        When the features lack a column of the model.
    """
    columns = np.ascontiguousarray(select_columns(features, model.names).T)
    return np.asarray(_join(model.structure.evaluate_columns(columns)[0], model.face.evaluate_columns(columns)))


@njit(cache=True, nogil=True)
def _join(log_odds, scores):  # type: ignore[no-untyped-def]
    """(K, 6) probabilities for (K,) log odds of structure and (5, K) scores of the faces."""
    context = np.empty((len(log_odds), N_LABELS))
    for k in range(len(log_odds)):
        inside = 1.0 / (1.0 + np.exp(-float(log_odds[k])))
        highest, total = scores[:, k].max(), 0.0
        for f in range(N_FACES):
            context[k, f] = np.exp(float(scores[f, k]) - highest)
            total += context[k, f]
        for f in range(N_FACES):
            context[k, f] *= inside / total
        context[k, N_FACES] = 1.0 - inside
    return context


def select_columns(features: SuperpixelFeatures, names: tuple[str, ...]) -> NDArray[np.float32]:
    """Return the columns of a table by name, (K, len(names)) float32.

    Raises
    ------
    ValueError
        When one is missing.
    """
    if features.names == names:
        return features.values
    place = {name: k for k, name in enumerate(features.names)}
    missing = [name for name in names if name not in place]
    if missing:
        more = len(missing) - 1
        raise ValueError(f"the classifier needs the feature {missing[0]} (and {more} more); it was not computed")
    return np.ascontiguousarray(features.values[:, [place[name] for name in names]])


def save_context(model: ContextModel, path: Path) -> None:
    """Write a context model; the same model gives the same bytes."""
    arrays = model.structure.to_arrays("structure_") | model.face.to_arrays("face_")
    write_arrays(path, _KIND, arrays, {**model.card, "features": list(model.names)})


def load_context(path: Path) -> ContextModel:
    """Read a context model.

    Raises
    ------
    WeightsError
        When the file is missing, damaged, of another kind, or does not describe forests.
    """
    arrays, card = read_arrays(path, _KIND)
    names = card.pop("features", None)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise WeightsError(f"{path} does not name its features; it is no context model of this version")
    try:
        structure, face = Forest.from_arrays(arrays, "structure_"), Forest.from_arrays(arrays, "face_")
        return ContextModel(tuple(names), structure, face, card)
    except ValueError as error:
        raise WeightsError(f"{path}: {error}") from error
