"""How well a segmentation fits labelled regions (paper 4, Table 3; docs/method.md, section 11). Natural logarithms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class SegmentationScores:
    """The measures of one image over its labelled pixels.

    Attributes
    ----------
    mean_error : share of pixels that are not of their segment's majority class (the paper's ME; 1 - ASA).
    covering, variation_of_information : of the true classes by the *oracle's* regions, that is by the segments
        labelled with their majority class. The paper's 89.36 % and 0.58 can only be these: 200 raw segments cover
        a wall by a few per cent at best.
    pixels : labelled pixels.
    """

    mean_error: float
    covering: float
    variation_of_information: float
    pixels: int


def segmentation_scores(segments: NDArray[np.integer], truth: NDArray[np.integer]) -> SegmentationScores:
    """Compare a segmentation with class labels; pixels of label 0 are ignored.

    Parameters
    ----------
    segments : (H, W) integer array
        Segment ids, 0 or above.
    truth : (H, W) integer array
        Class ids, 0 where unlabelled.

    Raises
    ------
    ValueError
        When the shapes differ, an id is negative or no pixel is labelled.
    """
    if segments.shape != truth.shape:
        raise ValueError(f"segments are {segments.shape} and labels {truth.shape}; they must agree")
    if min(segments.min(), truth.min()) < 0:
        raise ValueError(f"smallest id is {min(segments.min(), truth.min())}; ids must be 0 or above")
    known = truth > 0
    if not known.any():
        raise ValueError("no pixel is labelled; at least one is needed")
    table = contingency(segments[known], truth[known])
    oracle = oracle_table(table)
    return SegmentationScores(
        mean_error=1.0 - float(table.max(axis=1).sum() / table.sum()),
        covering=covering(oracle),
        variation_of_information=variation_of_information(oracle),
        pixels=int(table.sum()),
    )


def contingency(segments: NDArray[np.integer], truth: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the (segments, classes) int64 table of common pixels of two equally long lists of ids."""
    columns = int(truth.max()) + 1
    rows = int(segments.max()) + 1
    pair = segments.astype(np.int64).ravel() * columns + truth.astype(np.int64).ravel()
    return np.bincount(pair, minlength=rows * columns).reshape(rows, columns)


def oracle_table(table: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the table after the rows (segments) of the same majority class became one row."""
    merged = np.zeros((table.shape[1], table.shape[1]), np.int64)
    np.add.at(merged, table.argmax(axis=1), table)
    return merged


def covering(table: NDArray[np.int64]) -> float:
    """Return C(S' -> S) = 1/N sum over classes R of |R| max over segments R' of |R and R'| / |R or R'|."""
    row, column = table.sum(axis=1, keepdims=True), table.sum(axis=0, keepdims=True)
    overlap = table / np.maximum(row + column - table, 1)
    return float((column[0] * overlap.max(axis=0)).sum() / table.sum())


def variation_of_information(table: NDArray[np.int64]) -> float:
    """Return H(S) + H(S') - 2 I(S, S') in nats."""
    joint = table / table.sum()
    return 2.0 * _entropy(joint) - _entropy(joint.sum(axis=0)) - _entropy(joint.sum(axis=1))


def _entropy(p: NDArray[np.float64]) -> float:
    p = p[p > 0]
    return -float((p * np.log(p)).sum())
