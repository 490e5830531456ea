"""The obvious separator: examples in memory, asked one after another; what spreads them must give the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.learning.fingerprint import fingerprint
from room_layout_ros.learning.oracle import Oracle, Separation

Example = TypeVar("Example")


@dataclass(frozen=True, slots=True)
class LocalSeparator(Generic[Example]):
    """Examples in memory, asked one after another in this process."""

    oracle: Oracle[Example]
    examples: Sequence[Example]

    @property
    def count(self) -> int:
        """Number of examples."""
        return len(self.examples)

    @property
    def fingerprint(self) -> str:
        """Of the contents of the examples and the settings of the oracle."""
        return fingerprint(self.oracle, *self.examples)

    def separate(self, weights: NDArray[np.float64], indices: Sequence[int] | None = None) -> list[Separation]:
        """Return the separations of the examples with these indices (None: all)."""
        chosen = range(self.count) if indices is None else indices
        return [self.oracle(weights, self.examples[i]) for i in chosen]
