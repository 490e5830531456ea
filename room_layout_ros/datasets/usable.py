"""The usable frames of a source, and the reason where there is none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .errors import DataError
from .sample import BadFrame, Sample


def usable_samples(title: str, items: Iterable[Sample | BadFrame]) -> Iterator[Sample]:
    """Yield the usable frames among the items of the source of that title.

    Raises
    ------
    DataError
        At their end, when there was none: with what was wrong with the first.
    """
    first: BadFrame | None = None
    usable = False
    for item in items:
        if isinstance(item, BadFrame):
            first = first or item
            continue
        usable = True
        yield item
    if not usable:
        raise no_usable_frame(title, first)


def no_usable_frame(title: str, first: BadFrame | None) -> DataError:
    """Return the refusal of a source of which no frame can be used: with what was wrong with the first."""
    why = "" if first is None else f": {first.name}: {first.error}"
    return DataError(f"{title} holds no usable frame{why}")
