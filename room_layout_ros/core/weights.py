"""The weights of the joint model: the blocks of its feature vector, which of them a variant has, and their file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .model_file import WeightsError, read_arrays, write_arrays

_KIND = "room_layout joint model"

BLOCKS: Mapping[str, tuple[int, ...]] = {
    "layout_om": (5, 5),
    "layout_gc": (5, 6),
    "label_gc": (6, 6),
    "label_depth": (12,),
    "pair": (6, 6),
    "compatibility": (5, 6),
    "label_om": (5, 6),
    "label_bias": (6,),
    "smoothness": (3,),
    "plane_support": (5,),
    "plane_violation": (5,),
    "plane_fit": (5, 3),
    "face_absent": (4,),
    "front_axis": (1,),
    "layout_scene": (5, 5),
}
"""Blocks of the feature vector in order (docs/method.md, section 6); the first six are the paper's, the others ours."""

PAPER_BLOCKS = tuple(BLOCKS)[:6]


def _slices() -> dict[str, slice]:
    result, start = {}, 0
    for name, shape in BLOCKS.items():
        stop = start + int(np.prod(shape))
        result[name] = slice(start, stop)
        start = stop
    return result


SLICES: Mapping[str, slice] = _slices()
N_FEATURES = max(s.stop for s in SLICES.values())

VARIANTS: Mapping[str, tuple[str, ...]] = {
    "full": (),
    "paper": tuple(b for b in BLOCKS if b not in PAPER_BLOCKS),
    "rgb": ("label_depth", "plane_support", "plane_violation", "plane_fit"),
    "om_only": ("layout_gc", "label_gc", "layout_scene"),
    "gc_only": ("layout_om", "label_om", "layout_scene"),
    "no_compatibility": ("compatibility", "plane_fit"),
    "no_planes": ("plane_support", "plane_violation", "plane_fit"),
    "no_pairs": ("pair", "smoothness"),
    "no_scene": ("layout_scene",),
}
"""Blocks that are off in each variant of the model (lambda_d = 0 and one alternation are settings, not blocks).

Evidence whose `layout_` block is off is not gathered at all (`uses`), so it cannot come in by another way: context by
the profiles of the planes or the refinement, orientation maps by the features of the context."""


def uses(variant: str, block: str) -> bool:
    """Whether a variant of the model has a block."""
    return block not in VARIANTS[variant]


def blocks_off(variant: str, with_depth: bool = True, with_scene: bool = True) -> tuple[str, ...]:
    """Blocks of a variant of the model that are off, also for want of depth or of the scene network."""
    ways = (variant, "full" if with_depth else "rgb", "full" if with_scene else "no_scene")
    return tuple(block for block in BLOCKS if not all(uses(way, block) for way in ways))


@dataclass(frozen=True, slots=True)
class ModelWeights:
    """Weights w of the joint energy E = w . phi.

    Parameters
    ----------
    vector : (N_FEATURES,) float64
    card : what the trainer says about them; JSON values.

    Raises
    ------
    ValueError
        When the vector has another shape or a value is not finite.
    """

    vector: NDArray[np.float64]
    card: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.vector.shape != (N_FEATURES,) or self.vector.dtype != np.float64:
            raise ValueError(f"weights are {self.vector.dtype} {self.vector.shape}; float64 ({N_FEATURES},) is needed")
        if not np.isfinite(self.vector).all():
            raise ValueError(f"weight {int(np.flatnonzero(~np.isfinite(self.vector))[0])} is not finite; all must be")

    def block(self, name: str) -> NDArray[np.float64]:
        """Return one block in its shape."""
        return self.vector[SLICES[name]].reshape(BLOCKS[name])

    def variant(self, name: str) -> ModelWeights:
        """Return the weights with the blocks of a variant switched off.

        Raises
        ------
        ValueError
            When there is no such variant.
        """
        if name not in VARIANTS:
            raise ValueError(f"model variant is {name!r}; allowed are {', '.join(VARIANTS)}")
        return self.without(*VARIANTS[name])

    def used(self, variant: str, with_depth: bool = True, with_scene: bool = True) -> ModelWeights:
        """Return the weights as they count: without the blocks that are off (`blocks_off`)."""
        return self.without(*blocks_off(variant, with_depth, with_scene))

    def without(self, *blocks: str) -> ModelWeights:
        """Return the weights with these blocks set to 0."""
        vector = self.vector.copy()
        for name in blocks:
            vector[SLICES[name]] = 0.0
        return replace(self, vector=vector)


def pack_blocks(blocks: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the (N_FEATURES,) vector of named blocks; absent ones are 0.

    Raises
    ------
    ValueError
        When a name is unknown or a shape is not the block's.
    """
    vector = np.zeros(N_FEATURES)
    for name, values in blocks.items():
        if name not in BLOCKS:
            raise ValueError(f"block {name!r} is unknown; allowed are {', '.join(BLOCKS)}")
        if np.shape(values) != BLOCKS[name]:
            raise ValueError(f"block {name} has shape {np.shape(values)}; {BLOCKS[name]} is needed")
        vector[SLICES[name]] = np.ravel(values)
    return vector


def start_weights() -> ModelWeights:
    """Return hand-set weights: the model's structure with plausible signs, for use until learned ones are there.

    Energies are in shares of the image: 1 is every pixel.
    """
    pull = -np.eye(6)
    structure = np.eye(5, 6)
    clutter = np.eye(6)[5]
    disagree = (1.0 - structure) * (1.0 - clutter)
    table = physical_table().any(axis=2).astype(np.float64)
    blocks = {
        "layout_om": -0.15 * np.eye(5),
        "layout_gc": -0.8 * structure,
        "label_gc": 1.0 * pull,
        "label_depth": np.concatenate([np.full(5, -0.15), [-0.05], np.full(5, 0.1), [0.0]]),
        "pair": 0.15 * table,
        "compatibility": 0.6 * disagree - 0.1 * structure,
        "label_om": -0.05 * structure,
        "smoothness": np.array([0.01, 0.05, 0.08]),
        "plane_support": np.full(5, -1.2),
        "plane_violation": np.full(5, 3.6),
        "plane_fit": np.tile([-0.3, 0.5, 0.3], (5, 1)),
        "face_absent": np.array([-0.01, 0.0, -0.01, -0.01]),
        "front_axis": np.array([0.05]),
        "layout_scene": -0.8 * np.eye(5),
    }
    return ModelWeights(pack_blocks(blocks), {"name": "start", "origin": "set by hand"})


def physical_table() -> NDArray[np.bool_]:
    """(6, 6, 6) bool, [a, b, r]: a superpixel of label a cannot stand in relation r to a neighbour of label b (paper,
    Table 1).

    Relations r: above, below, right of, left of, in front of (farther along Z), behind.
    """
    rows = (
        ("", "2", "24", "25", "23", "2"),
        ("1", "", "14", "15", "13", "1"),
        ("13", "23", "", "35", "3", "3"),
        ("16", "26", "46", "", "36", "6"),
        ("14", "24", "4", "45", "", "4"),
        ("1", "2", "4", "5", "3", ""),
    )
    order = (0, 1, 2, 3, 4, 5)  # rows and columns: ceiling, floor, left, front, right, clutter: the order of the labels
    table = np.zeros((6, 6, 6), dtype=bool)
    for a in order:
        for b in order:
            for r in rows[a][b]:
                table[a, b, int(r) - 1] = True
    return table


def save_weights(weights: ModelWeights, path: Path) -> None:
    """Write a model file."""
    write_arrays(path, _KIND, {name: weights.block(name) for name in BLOCKS}, weights.card)


def load_weights(path: Path) -> ModelWeights:
    """Read a model file.

    Raises
    ------
    WeightsError
        When the file is missing, cut, too large, of another kind or version, changed, or holds a wrong or non-finite
        array.
    """
    arrays, card = read_arrays(path, _KIND)
    for name, shape in BLOCKS.items():
        if name not in arrays:
            raise WeightsError(f"{path} has no block {name}; all of {', '.join(BLOCKS)} are needed")
        if arrays[name].shape != shape or arrays[name].dtype != np.float64:
            raise WeightsError(
                f"block {name} of {path} is {arrays[name].dtype} {arrays[name].shape}; float64 {shape} is needed"
            )
    unknown = set(arrays) - set(BLOCKS)
    if unknown:
        raise WeightsError(f"{path} has the unknown block {min(unknown)}; allowed are {', '.join(BLOCKS)}")
    return ModelWeights(pack_blocks(arrays), card)
