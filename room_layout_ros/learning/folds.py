"""How frames are shared out between learning and judging: blocks of their numbers, with a margin between neighbours."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

MARGIN = 5
"""Frames whose numbers differ by this or less may show the same room (docs/data.md)."""
_NUMBERED = re.compile(r"(.*?)(\d*)", re.DOTALL | re.ASCII)


SYNTHETIC_FIRST = 1_000_000
"""Number of the first synthetic frame in a table. A recorded frame's name that is such a number is a time, no count."""


def frame_number(name: str, ordinal: int) -> int:
    """Return the number by which a frame's neighbours are told: its name where that counts frames, else its place."""
    counts = name.isascii() and name.isdigit() and len(name.lstrip("0")) < len(str(SYNTHETIC_FIRST))
    return int(name) if counts else ordinal


def frame_numbers(names: Sequence[str]) -> list[int]:
    """Return the numbers of frames by which neighbours are told: the names where they count frames, else the order."""
    return [frame_number(name, i) for i, name in enumerate(names)]


def is_near(names: Sequence[str], others: Collection[str]) -> NDArray[np.bool_]:
    """Return of each name whether it is one of the others or within `MARGIN` numbers of one.

    A frame's number is what its name ends in; frames are neighbours only where all before it is equal. A name without
    a number has no neighbours.
    """
    known, numbers = set(others), dict[str, list[int]]()
    for name in others:
        stem, number = _split(name)
        if number is not None:
            numbers.setdefault(stem, []).append(number)

    def near(name: str) -> bool:
        stem, number = _split(name)
        return name in known or (number is not None and any(abs(number - n) <= MARGIN for n in numbers.get(stem, ())))

    return np.array([near(name) for name in names], bool)


def _split(name: str) -> tuple[str, int | None]:
    stem, digits = _NUMBERED.fullmatch(name).groups()  # type: ignore[union-attr]
    return stem, int(digits) if digits else None


def is_near_block(numbers: NDArray[np.int64], first: int, last: int) -> NDArray[np.bool_]:
    """Return of each frame number whether it is in the block first..last or within `MARGIN` of it."""
    return (numbers >= first - MARGIN) & (numbers <= last + MARGIN)


def number_blocks(numbers: Sequence[int], count: int) -> list[tuple[int, int]]:
    """Cut frame numbers into `count` blocks of about as many frames each; return the first and last number of each.

    Raises
    ------
    ValueError
        When there are fewer frames than folds or less than two folds.
    """
    distinct = np.unique(np.asarray(numbers, np.int64))
    check_folds(count, len(distinct))
    return _cut(distinct, count)


def check_folds(count: int, frames: int) -> None:
    """Refuse what cannot be cut: fewer frames than folds, or less than two folds."""
    if not 2 <= count <= frames:
        raise ValueError(f"folds is {count}; 2 to the number of frames ({frames}) are possible")


def _cut(distinct: NDArray[np.int64], count: int) -> list[tuple[int, int]]:
    """First and last number of each block; fewer blocks where there are fewer numbers."""
    return [(int(block[0]), int(block[-1])) for block in np.array_split(distinct, count) if len(block)]


def folds_of(names: Sequence[str], folds: int) -> Iterator[tuple[list[int], list[int]]]:
    """Yield (train, validate) positions: blocks of frame numbers with `MARGIN` numbers between them.

    Raises
    ------
    ValueError
        As `number_blocks`.
    """
    numbers = np.array(frame_numbers(names), np.int64)
    for block in number_blocks(numbers.tolist(), folds):
        train, validate = _apart(numbers, block)
        yield np.flatnonzero(train).tolist(), np.flatnonzero(validate).tolist()


def row_folds(frame: NDArray[np.int64], folds: int) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Yield (train, validate) masks of the rows of a table, by the number of each one's frame.

    As `folds_of`, but synthetic frames are blocks of their own, so that each fold has its share of both kinds, and
    there may be fewer frames of a kind than folds.
    """
    numbers = np.unique(frame)
    kinds = (_cut(numbers[numbers < SYNTHETIC_FIRST], folds), _cut(numbers[numbers >= SYNTHETIC_FIRST], folds))
    for k in range(folds):
        yield _apart(frame, *(blocks[k] for blocks in kinds if k < len(blocks)))


def _apart(numbers: NDArray[np.int64], *blocks: tuple[int, int]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of the numbers that are near none of the blocks, and of those in one of them."""
    train, validate = np.ones(len(numbers), bool), np.zeros(len(numbers), bool)
    for first, last in blocks:
        train &= ~is_near_block(numbers, first, last)
        validate |= (numbers >= first) & (numbers <= last)
    return train, validate
