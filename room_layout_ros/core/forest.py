"""Boosted regression trees from plain arrays: no training library at run time, no pickle in files.

Evaluated as QuickScorer does (Lucchese et al., SIGIR 2015): a test that fails rules out the leaves on its left, and
the first leaf that no test rules out is the row's. So every test is asked of all rows at once, without a branch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
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
MAX_LEAVES = 32
"""Per tree: the leaves that are still open are bits of one number."""

_ALL = np.uint32(0xFFFFFFFF)
_DE_BRUIJN = np.uint32(0x077CB531)
"""(bit * this) >> 27 is another number, 0..31, for each of the 32 bits."""
_PLACES = 32 - 5


@dataclass(frozen=True, slots=True)
class _Tests:
    """The same trees as tests that rule out leaves.

    Attributes
    ----------
    start : (t + 1,) int32 where the tests of each tree start. feature, threshold, missing_left : (m,) as in `Forest`.
    still_open : (m,) uint32 leaves that stay open when a row goes right.
    leaf : (t, 32) float32 values of the leaves, in the order of the de Bruijn hash of their bits.
    """

    start: NDArray[np.int32]
    feature: NDArray[np.int16]
    threshold: NDArray[np.float32]
    missing_left: NDArray[np.bool_]
    still_open: NDArray[np.uint32]
    leaf: NDArray[np.float32]


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
    _tests: _Tests = field(init=False, repr=False, compare=False)

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
        start, test, still_open, leaf = _arrange(self.feature, self.threshold, self.left, self.right, self.root)
        split = self.feature[test], self.threshold[test], self.missing_left[test]
        object.__setattr__(self, "_tests", _Tests(start, *split, still_open, leaf))

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
        children = np.sort(np.concatenate([(start + self.left)[inner], (start + self.right)[inner]]))
        if not np.array_equal(children, np.delete(np.arange(nodes), self.root)):
            raise ValueError("forest nodes must be the child of one parent each")
        leaves = np.add.reduceat(~inner, self.root, dtype=np.int64)
        if leaves.max() > MAX_LEAVES:
            raise ValueError(f"forest has a tree of {leaves.max()} leaves; at most {MAX_LEAVES} are allowed")

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
        return np.ascontiguousarray(self.evaluate_columns(np.ascontiguousarray(rows.T)).T)

    def evaluate_columns(self, columns: NDArray[np.float32]) -> NDArray[np.float32]:
        """(outputs, k) float32 for contiguous columns (f, k) of rows, which are not checked; forests can share them."""
        t = self._tests
        tests = t.start, t.feature, t.threshold, t.missing_left, t.still_open
        return np.asarray(_evaluate(columns, *tests, t.leaf, self.output, self.baseline))

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


@njit(cache=True, nogil=True)
def _arrange(feature, threshold, left, right, root):  # type: ignore[no-untyped-def]
    """Starts of the trees' tests, their nodes, the leaves each leaves open on failing, and the leaves' values."""
    nodes, trees = len(feature), len(root)
    start, test = np.zeros(trees + 1, np.int32), np.empty(nodes, np.int32)
    still_open, leaf = np.empty(nodes, np.uint32), np.zeros((trees, MAX_LEAVES), np.float32)
    below, first_leaf = np.zeros(nodes, np.int64), np.zeros(nodes, np.int64)
    n = 0
    for tree in range(trees):
        first, end = root[tree], root[tree + 1] if tree + 1 < trees else nodes
        for node in range(end - 1, first - 1, -1):  # children follow their parent
            below[node] = 1 if feature[node] < 0 else below[first + left[node]] + below[first + right[node]]
        for node in range(first, end):
            if feature[node] < 0:
                bit = np.uint32(1 << first_leaf[node])
                leaf[tree, np.uint32(bit * _DE_BRUIJN) >> _PLACES] = threshold[node]
                continue
            on_left = below[first + left[node]]
            first_leaf[first + left[node]] = first_leaf[node]
            first_leaf[first + right[node]] = first_leaf[node] + on_left
            test[n], still_open[n] = node, ~np.uint32(((1 << on_left) - 1) << first_leaf[node])
            n += 1
        start[tree + 1] = n
    return start, test[:n].copy(), still_open[:n].copy(), leaf


@njit(cache=True, nogil=True)
def _evaluate(columns, start, feature, threshold, missing_left, still_open, leaf, output, baseline):  # type: ignore[no-untyped-def]
    k = columns.shape[1]
    out = np.empty((len(baseline), k), np.float32)
    for c in range(len(baseline)):
        out[c] = baseline[c]
    open_ = np.empty(k, np.uint32)
    for tree in range(len(output)):
        open_[:] = _ALL
        for t in range(start[tree], start[tree + 1]):
            column, limit, rest = columns[feature[t]], threshold[t], still_open[t]
            if missing_left[t]:
                for i in range(k):
                    open_[i] &= rest if column[i] > limit else _ALL
            else:
                for i in range(k):
                    open_[i] &= _ALL if column[i] <= limit else rest
        total, value = out[output[tree]], leaf[tree]
        for i in range(k):
            first = np.uint32(open_[i] & (~open_[i] + np.uint32(1)))
            total[i] += value[np.uint32(first * _DE_BRUIJN) >> _PLACES]
    return out
