"""How frames are shared out between learning and judging: blocks of their numbers, with a margin between neighbours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

MARGIN = 5
"""Frames whose numbers differ by this or less may show the same room (docs/data.md)."""


def frame_numbers(names: Sequence[str]) -> list[int]:
    """Return the numbers of frames by which neighbours are told: the names where they are numbers, else the order."""
    return [int(name) if name.isdigit() else i for i, name in enumerate(names)]


def number_blocks(numbers: Sequence[int], count: int) -> list[tuple[int, int]]:
    """Cut frame numbers into `count` blocks of about as many frames each; return the first and last number of each.

    Raises
    ------
    ValueError
        When there are fewer frames than folds or less than two folds.
    """
    if not 2 <= count <= len(numbers):
        raise ValueError(f"folds is {count}; 2 to the number of frames ({len(numbers)}) are possible")
    return [(int(block[0]), int(block[-1])) for block in np.array_split(np.unique(numbers), count)]


def folds_of(names: Sequence[str], folds: int) -> Iterator[tuple[list[int], list[int]]]:
    """Yield (train, validate) positions: blocks of frame numbers with `MARGIN` numbers between them.

    Raises
    ------
    ValueError
        As `number_blocks`.
    """
    numbers = np.array(frame_numbers(names))
    for first, last in number_blocks(numbers.tolist(), folds):
        held = (numbers >= first) & (numbers <= last)
        near = (numbers >= first - MARGIN) & (numbers <= last + MARGIN)
        yield np.flatnonzero(~near).tolist(), np.flatnonzero(held).tolist()
