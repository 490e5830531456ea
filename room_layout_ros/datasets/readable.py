"""What can be read of a damaged source, and the damage beside it as a value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .errors import DataError
from .sample import BadFrame, FrameSource, Sample


@dataclass(slots=True)
class ReadablePart:
    """The items of a source until it can be read no further; `damage` then says why, None where it came to its end."""

    source: FrameSource
    damage: DataError | None = None

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield the items; damage ends them without an exception."""
        try:
            yield from self.source
        except DataError as error:
            self.damage = error
