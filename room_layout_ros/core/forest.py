"""Boosted regression trees from plain arrays: no training library at run time, no pickle in files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

_FIELDS: tuple[tuple[str, np.dtype[np.generic]], ...] = (
    ("feature", np.dtype(np.int16)),
    ("threshold", np.dtype(np.float32)),
    ("missing_left", np.dtype(np.bool_)),
    ("left", np.dtype(np.int16)),
    ("right", np.dtype(np.int16)),
    ("root", np.dtype(np.int32)),
    ("output", np.dtype(np.int16)),
    ("baseline", np.dtype(np.float32)),
)
MAX_NODES = 2_000_000


@dataclass(frozen=True, slots=True)
class Forest:
    """Additive trees with several outputs.

    A node sends a row to `left` when its value is <= `threshold` or, for NaN, when `missing_left`. A leaf has
    feature -1 and keeps its value in `threshold`. Children are relative to the tree's root.

    Parameters
    ----------
    feature, threshold, missing_left, left, right : (n,) arrays over nodes, tree after tree.
    root : (t,) int32 first node of each tree, ascending. output : (t,) int16 output each tree adds to.
    baseline : (c,) float32 constant of each output.

    Raises
    ------
    ValueError
        When the arrays do not describe trees: evaluation reads without checks, so every index is checked here.
    """

    feature: NDArray[np.int16]
    threshold: NDArray[np.float32]
    missing_left: NDArray[np.bool_]
    left: NDArray[np.int16]
    right: NDArray[np.int16]
    root: NDArray[np.int32]
    output: NDArray[np.int16]
    baseline: NDArray[np.float32]

    def __post_init__(self) -> None:
        for name, dtype in _FIELDS:
            array = getattr(self, name)
            if not isinstance(array, np.ndarray) or array.ndim != 1 or array.dtype != dtype:
                raise ValueError(f"forest field {name} must be a 1-D {dtype} array")
            object.__setattr__(self, name, np.ascontiguousarray(array))
        nodes, trees = len(self.feature), len(self.root)
        if not 0 < nodes <= MAX_NODES or trees == 0:
            raise ValueError(f"forest has {nodes} nodes in {trees} trees; 1 to {MAX_NODES} nodes are allowed")
        if any(len(getattr(self, name)) != nodes for name in ("threshold", "missing_left", "left", "right")):
            raise ValueError("forest arrays over nodes differ in length")
        if len(self.output) != trees or self.output.min() < 0 or self.output.max() >= len(self.baseline):
            raise ValueError(f"forest outputs must be one per tree and lie in 0..{len(self.baseline) - 1}")
        if not (np.isfinite(self.threshold).all() and np.isfinite(self.baseline).all()):
            raise ValueError("forest values must be finite")
        self._check_links()

    def _check_links(self) -> None:
        nodes = len(self.feature)
        if self.root[0] != 0 or (np.diff(self.root) <= 0).any() or self.root[-1] >= nodes:
            raise ValueError("forest roots must rise from 0 and stay below the number of nodes")
        size = np.diff(np.append(self.root, nodes))
        start, own_size = np.repeat(self.root, size), np.repeat(size, size)
        place = np.arange(nodes) - start
        inner = self.feature >= 0
        for child in (self.left, self.right):
            if (inner & ((child <= place) | (child >= own_size))).any():
                raise ValueError("forest children must follow their parent within the tree")

    @property
    def feature_count(self) -> int:
        """Least number of columns that rows must have."""
        return int(self.feature.max()) + 1

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return len(self.baseline)

    def evaluate(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Sum the trees' values: (k, outputs) float32 for rows (k, f) float32.

        Raises
        ------
        ValueError
            When rows are not float32 of enough columns.
        """
        if rows.ndim != 2 or rows.dtype != np.float32 or rows.shape[1] < self.feature_count:
            raise ValueError(
                f"rows are {rows.dtype} of shape {rows.shape}; float32 with {self.feature_count} columns is needed"
            )
        return np.asarray(
            _evaluate(
                np.ascontiguousarray(rows),
                self.feature,
                self.threshold,
                self.missing_left,
                self.left,
                self.right,
                self.root,
                self.output,
                self.baseline,
            )
        )

    def to_arrays(self, prefix: str = "") -> dict[str, NDArray[Any]]:
        """Return the arrays by name, for `numpy.savez`."""
        return {prefix + name: getattr(self, name) for name, _ in _FIELDS}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str = "") -> Forest:
        """Make a forest of arrays named as `to_arrays` names them.

        Raises
        ------
        ValueError
            When one is missing or wrong.
        """
        missing = [name for name, _ in _FIELDS if prefix + name not in arrays]
        if missing:
            raise ValueError(f"forest arrays {', '.join(prefix + name for name in missing)} are missing")
        return cls(**{name: arrays[prefix + name] for name, _ in _FIELDS})


def softmax(scores: NDArray[np.float32]) -> NDArray[np.float32]:
    """(k, c) probabilities of rows of scores."""
    shifted = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(shifted / shifted.sum(axis=1, keepdims=True), np.float32)


@njit(cache=True, nogil=True)
def _evaluate(rows, feature, threshold, missing_left, left, right, root, output, baseline):  # type: ignore[no-untyped-def]
    out = np.empty((rows.shape[0], baseline.size), np.float32)
    out[:] = baseline
    for tree in range(root.size):  # trees outside: one tree stays in the cache while all rows pass
        first, k = root[tree], output[tree]
        for i in range(rows.shape[0]):
            node = first
            f = feature[node]
            while f >= 0:
                value = rows[i, f]
                if value <= threshold[node] or (value != value and missing_left[node]):
                    node = first + left[node]
                else:
                    node = first + right[node]
                f = feature[node]
            out[i, k] += threshold[node]
    return out
