"""The slow obvious twins of `evaluation.measures` and `evaluation.geometry`."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
WALLS = (3, 4, 5)


def naive_error(truth: Image, estimate: Image) -> float:
    wrong = total = 0
    for t, e in zip(truth.ravel(), estimate.ravel(), strict=True):
        if t:
            total += 1
            wrong += t != e
    return wrong / total


def naive_renamed(image: Image, names: tuple[int, ...]) -> Image:
    out = image.copy()
    for wall, name in zip(WALLS, names, strict=True):
        out[image == wall] = name
    return out


def naive_permuted_error(truth: Image, estimate: Image) -> float:
    return min(naive_error(truth, naive_renamed(estimate, names)) for names in itertools.permutations(WALLS))


def naive_iou(truths: list[Image], estimates: list[Image], label: int) -> float:
    both = either = 0
    for truth, estimate in zip(truths, estimates, strict=True):
        for t, e in zip(truth.ravel(), estimate.ravel(), strict=True):
            if t:
                both += t == label and e == label
                either += t == label or e == label
    return both / either if either else float("nan")


def naive_ece(confidence: NDArray[np.float64], correct: NDArray[np.float64], bins: int) -> float:
    total = 0.0
    for b in range(bins):
        inside = [i for i, c in enumerate(confidence) if b / bins <= c < (b + 1) / bins or (b == bins - 1 and c == 1)]
        if inside:
            total += float(len(inside) * abs(np.mean(correct[inside]) - np.mean(confidence[inside])))
    return total / len(confidence)
