"""Furniture: the class of each clutter superpixel (paper 4; docs/evidence.md).

The paper pools six kernel descriptors, which `kernel_furniture.py` does as an option. Here a boosted forest reads the
features that the geometric context already has: height over the floor, size of the plane, what stands out from what,
colour and texture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import softmax

from .evidence.features import SuperpixelFeatures
from .evidence.geometric_context import MAX_FEATURES, select_columns
from .forest import Forest
from .labels import CLUTTER, FURNITURE_IDS, N_CLUTTER_CLASSES
from .model_file import WeightsError, read_arrays, write_arrays
from .superpixels import Superpixels

_KIND = "room_layout furniture"

_PASSES, _TAKE, _ALIKE_LAB, _OTHER = 8, 4.0, 15.0, 0.6
"""Of `group_furniture`: rounds, weight of all neighbours together against the own score, difference in Lab that counts
for 0.6 of the border, prior of "anything else" (below 1: a class missed costs as much as one seen wrongly)."""


@dataclass(frozen=True, slots=True)
class FurnitureModel:
    """A trained classifier of clutter superpixels.

    Attributes
    ----------
    names : features the forest reads. forest : softmax scores of the six classes and "other".
    card : what the trainer says about it; JSON values.

    Raises
    ------
    ValueError
        When the forest has another number of outputs or reads more columns than there are names.
    """

    names: tuple[str, ...]
    forest: Forest
    card: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.forest.outputs != N_CLUTTER_CLASSES:
            raise ValueError(f"furniture forest has {self.forest.outputs} outputs; {N_CLUTTER_CLASSES} are needed")
        if not self.forest.feature_count <= len(self.names) <= MAX_FEATURES:
            raise ValueError(
                f"furniture model names {len(self.names)} features; its forest reads {self.forest.feature_count}"
            )


def classify_furniture(features: SuperpixelFeatures, model: FurnitureModel) -> NDArray[np.float64]:
    """(K, 7) float64 probabilities of the classes `FURNITURE_IDS` and of anything else, for clutter superpixels.

    Raises
    ------
    ValueError
        When the features lack a column of the model.
    """
    scores = model.forest.evaluate(select_columns(features, model.names))
    return np.asarray(softmax(scores, axis=1), np.float64)


def group_furniture(
    superpixels: Superpixels, clutter: NDArray[np.bool_], probability: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Let touching clutter of like colour agree: things are made of several superpixels.

    The scores (log probabilities) of a superpixel take on a weighted mean of those of its clutter neighbours, `_PASSES`
    times over; the weight falls with the difference in colour and grows with the common border.

    Parameters
    ----------
    clutter : (K,) bool; others neither give nor take. probability : (K, 7) of `classify_furniture`.

    Returns
    -------
    (K, 7) float64
        Rows sum to 1.
    """
    length = superpixels.edge_length
    score = _group(superpixels.edges, length, superpixels.mean_lab, clutter, np.log(np.maximum(probability, 1e-6)))
    score[:, -1] += np.log(_OTHER)
    return np.asarray(softmax(score.astype(np.float32), axis=1), np.float64)


@njit(cache=True, nogil=True)
def _group(edges, length, lab, clutter, own):  # type: ignore[no-untyped-def]
    """(K, 7) scores after `_PASSES` rounds of taking on the neighbours'."""
    nodes, classes = own.shape
    weight, weights, border = np.zeros(len(edges)), np.zeros(nodes), np.zeros(nodes)
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        if clutter[i] and clutter[j]:
            difference = (lab[i, 0] - lab[j, 0]) ** 2 + (lab[i, 1] - lab[j, 1]) ** 2 + (lab[i, 2] - lab[j, 2]) ** 2
            weight[e] = length[e] * np.exp(-0.5 * difference / _ALIKE_LAB**2)
            for node in (i, j):
                weights[node] += weight[e]
                border[node] += length[e]
    score, taken = own.copy(), np.empty_like(own)
    for _ in range(_PASSES):
        taken[:] = 0.0
        for e in range(len(edges)):
            if weight[e] > 0.0:
                i, j = edges[e, 0], edges[e, 1]
                for c in range(classes):
                    taken[i, c] += weight[e] * score[j, c]
                    taken[j, c] += weight[e] * score[i, c]
        for k in range(nodes):
            strength = _TAKE / max(border[k], 1.0)
            for c in range(classes):
                score[k, c] = (own[k, c] + strength * taken[k, c]) / (1.0 + strength * weights[k])
    return score


def paint_furniture(
    superpixels: Superpixels, labels: NDArray[np.uint8], probability: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Draw the classes where there is clutter.

    Parameters
    ----------
    labels : (K,) uint8 label id of each superpixel. probability : (K, 7) of `classify_furniture`.

    Returns
    -------
    (H, W) uint8
        NYU40 id of the most likely class on clutter, 0 where that is "other" or there is no clutter.
    """
    ids = np.array([*FURNITURE_IDS, 0], np.uint8)[probability.argmax(axis=1)]
    return np.asarray(_paint(superpixels.index, np.where(labels == CLUTTER, ids, np.uint8(0))))


@njit(cache=True, nogil=True)
def _paint(index, ids):  # type: ignore[no-untyped-def]
    """The image of superpixels with each one's id."""
    image = np.empty(index.shape, ids.dtype)
    for y in range(index.shape[0]):
        for x in range(index.shape[1]):
            image[y, x] = ids[np.uint32(index[y, x])]
    return image


def find_furniture(
    superpixels: Superpixels, labels: NDArray[np.uint8], features: SuperpixelFeatures, model: FurnitureModel
) -> NDArray[np.uint8]:
    """Classify clutter and draw it: (H, W) uint8 NYU40 id on furniture of the six classes, 0 elsewhere.

    Parameters
    ----------
    labels : (K,) uint8 label ids 1..6 of the superpixels.
    """
    alone = classify_furniture(features, model)
    return paint_furniture(superpixels, labels, group_furniture(superpixels, labels == CLUTTER, alone))


def save_furniture(model: FurnitureModel, path: Path) -> None:
    """Write a furniture model; the same model gives the same bytes."""
    write_arrays(path, _KIND, model.forest.to_arrays("class_"), {**model.card, "features": list(model.names)})


def load_furniture(path: Path) -> FurnitureModel:
    """Read a furniture model.

    Raises
    ------
    WeightsError
        When the file is missing, damaged, of another kind, or does not describe a forest.
    """
    arrays, card = read_arrays(path, _KIND)
    names = card.pop("features", None)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise WeightsError(f"{path} does not name its features; it is no furniture model of this version")
    try:
        return FurnitureModel(tuple(names), Forest.from_arrays(arrays, "class_"), card)
    except ValueError as error:
        raise WeightsError(f"{path}: {error}") from error
