"""Furniture by kernel descriptors and a linear classifier, the paper's own way (paper 4, Table 5; docs/evidence.md).

An option beside `furniture.py` (parameter `furniture_features`), as accurate and far slower. One model serves all ways
of operation: it has a classifier for superpixels with colour and depth, one for colour alone, one for depth alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from .depth import DepthGeometry
from .evidence.kernel_descriptors import COLOR, DEPTH, DESCRIPTORS, DescriptorModel, describe_superpixels
from .evidence.match_kernels import CompactBasis, Floats, MatchKernel
from .evidence.surrounding_means import REACHES, with_surroundings
from .furniture import group_furniture, paint_furniture
from .labels import CLUTTER, N_CLUTTER_CLASSES
from .model_file import WeightsError, read_arrays, write_arrays
from .models import KERNEL_FURNITURE_FILE, config_folder
from .superpixels import Superpixels

SETS = {"color_depth": DESCRIPTORS, "color": COLOR, "depth": DEPTH}
"""Descriptors that each classifier reads, by its name."""

_KIND = "room_layout kernel furniture"


@dataclass(frozen=True, slots=True)
class LinearClassifier:
    """Scores of the six classes and of "other", softmax of which is their probability.

    Attributes
    ----------
    weights : (7, D) float32. intercepts : (7,) float32.
    """

    weights: Floats
    intercepts: Floats


@dataclass(frozen=True, slots=True)
class KernelFurnitureModel:
    """A trained linear classifier of clutter superpixels by their kernel descriptors.

    Attributes
    ----------
    descriptors : kernels and visual words. classifiers : by the names of `SETS`.
    prior : (7,) float32 share of each class among clutter, for superpixels of which nothing is known.
    card : what the trainer says about it; JSON values.

    Raises
    ------
    ValueError
        When a classifier is missing or does not read as many columns as its descriptors have.
    """

    descriptors: DescriptorModel
    classifiers: dict[str, LinearClassifier]
    prior: Floats
    card: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.prior.shape != (N_CLUTTER_CLASSES,) or not (self.prior > 0).all():
            raise ValueError(
                f"prior of the furniture has shape {self.prior.shape}; ({N_CLUTTER_CLASSES},) above 0 is needed"
            )
        for name, read in SETS.items():
            if name not in self.classifiers:
                raise ValueError(f"furniture model has no classifier {name!r}")
            one, columns = self.classifiers[name], len(columns_of(self.descriptors, read))
            if one.weights.shape != (N_CLUTTER_CLASSES, columns) or one.intercepts.shape != (N_CLUTTER_CLASSES,):
                raise ValueError(
                    f"classifier {name!r} has weights {one.weights.shape} and intercepts {one.intercepts.shape}; "
                    f"({N_CLUTTER_CLASSES}, {columns}) and ({N_CLUTTER_CLASSES},) are needed"
                )


def describe_clutter(
    color: NDArray[np.uint8] | None,
    geometry: DepthGeometry | None,
    superpixels: Superpixels,
    clutter: NDArray[np.bool_],
    model: DescriptorModel,
) -> Floats:
    """(K, n D) float32 descriptors of clutter superpixels and of their surroundings; NaN where nothing is known."""
    features = describe_superpixels(color, geometry, superpixels, clutter, model)
    return with_surroundings(superpixels, clutter, features)


def columns_of(model: DescriptorModel, names: tuple[str, ...]) -> NDArray[np.intp]:
    """Return the columns of these descriptors in the rows of `describe_clutter`."""
    whole, own = len(model.columns(DESCRIPTORS)), model.columns(names)
    return np.concatenate([part * whole + own for part in range(1 + len(REACHES))])


def classify_by_kernels(features: Floats, model: KernelFurnitureModel) -> NDArray[np.float64]:
    """(K, 7) float64 probabilities of the classes `FURNITURE_IDS` and of anything else.

    Parameters
    ----------
    features : (K, n D) float32 of `describe_clutter`. A row is judged by the classifier of what is known of it;
        where that is nothing, it gets the prior.
    """
    probability = np.repeat(model.prior[None].astype(np.float64), len(features), axis=0)
    for name in ("depth", "color", "color_depth"):  # the one that knows most comes last
        one, read = model.classifiers[name], features[:, columns_of(model.descriptors, SETS[name])]
        rows = np.isfinite(read).all(axis=1)
        scores = read[rows] @ one.weights.T + one.intercepts
        probability[rows] = softmax(scores.astype(np.float64), axis=1)
    return probability


def find_furniture_by_kernels(
    color: NDArray[np.uint8] | None,
    geometry: DepthGeometry | None,
    superpixels: Superpixels,
    labels: NDArray[np.uint8],
    model: KernelFurnitureModel,
) -> NDArray[np.uint8]:
    """Classify clutter and draw it: (H, W) uint8 NYU40 id on furniture of the six classes, 0 elsewhere.

    Parameters
    ----------
    color : (H, W, 3) uint8 RGB, or None. geometry : DepthGeometry or None.
    labels : (K,) uint8 label ids 1..6 of the superpixels.
    """
    clutter = labels == CLUTTER
    features = describe_clutter(color, geometry, superpixels, clutter, model.descriptors)
    alone = classify_by_kernels(features, model)
    return paint_furniture(superpixels, labels, group_furniture(superpixels, clutter, alone))


def save_kernel_furniture(model: KernelFurnitureModel, path: Path) -> None:
    """Write a model; the same model gives the same bytes."""
    arrays: dict[str, NDArray[Any]] = {"prior": model.prior}
    for name, kernel in model.descriptors.kernels.items():
        arrays |= _basis_arrays(f"{name}.attribute", kernel.attribute) | _basis_arrays(f"{name}.place", kernel.position)
        arrays[f"{name}.pairs"] = kernel.pairs
    for name, words in model.descriptors.words.items():
        arrays |= _basis_arrays(f"{name}.words", words)
    for name, one in model.classifiers.items():
        arrays |= {f"svm_{name}.weights": one.weights, f"svm_{name}.intercepts": one.intercepts}
    write_arrays(path, _KIND, arrays, model.card)


def load_kernel_classifier(folder: Path | None = None) -> KernelFurnitureModel:
    """Load the model from a folder of models, the installation's own by default; each file is read once.

    Raises
    ------
    WeightsError
        As `load_kernel_furniture`.
    """
    return _load((folder or config_folder()) / KERNEL_FURNITURE_FILE)


@cache
def _load(path: Path) -> KernelFurnitureModel:
    return load_kernel_furniture(path)


def load_kernel_furniture(path: Path) -> KernelFurnitureModel:
    """Read a model.

    Raises
    ------
    WeightsError
        When the file is missing, damaged, of another kind, or does not describe such a model.
    """
    arrays, card = read_arrays(path, _KIND)
    try:
        kernels = {
            name: MatchKernel(
                _basis(arrays, f"{name}.attribute"), _basis(arrays, f"{name}.place"), arrays[f"{name}.pairs"]
            )
            for name in DESCRIPTORS
            if name != "self_similarity"
        }
        words = {name: _basis(arrays, f"{name}.words") for name in DESCRIPTORS}
        classifiers = {
            name: LinearClassifier(arrays[f"svm_{name}.weights"], arrays[f"svm_{name}.intercepts"]) for name in SETS
        }
        return KernelFurnitureModel(DescriptorModel(kernels, words), classifiers, arrays["prior"], card)
    except KeyError as error:
        raise WeightsError(f"{path} has no array {error}; it is no kernel furniture model of this version") from None
    except (ValueError, TypeError, IndexError) as error:
        raise WeightsError(f"{path}: {error}") from error


def _basis_arrays(prefix: str, basis: CompactBasis) -> dict[str, NDArray[Any]]:
    parts = {"points": basis.points, "projection": basis.projection, "gamma": np.array([basis.gamma])}
    return {f"{prefix}.{name}": array for name, array in parts.items()}


def _basis(arrays: Mapping[str, NDArray[Any]], prefix: str) -> CompactBasis:
    gamma = arrays[f"{prefix}.gamma"]
    if gamma.shape != (1,):
        raise ValueError(f"gamma of {prefix} has {gamma.size} values; one is needed")
    return CompactBasis(arrays[f"{prefix}.points"], arrays[f"{prefix}.projection"], float(gamma[0]))
