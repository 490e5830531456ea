"""What the structured SVM asks of a model, and how the question is spread over examples, processes and machines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..parallel import Spread

Example = TypeVar("Example")
ExampleIn = TypeVar("ExampleIn", contravariant=True)


@dataclass(frozen=True, slots=True)
class Separation:
    """The most violated output of one example.

    Attributes
    ----------
    feature_difference : (d,) phi(x, y_hat) - phi(x, y): what the energy of the wrong output has over the true one's.
    loss : loss of y_hat, 0 or more.
    """

    feature_difference: NDArray[np.float64]
    loss: float

    def violation(self, weights: NDArray[np.float64]) -> float:
        """Return loss - w . (phi(y_hat) - phi(y)): the slack this output needs."""
        return self.loss - float(weights @ self.feature_difference)


class Oracle(Protocol[ExampleIn]):
    """Loss-augmented inference: argmax over y_hat of loss(y, y_hat) - w . (phi(x, y_hat) - phi(x, y)).

    An inexact oracle makes a valid but weaker constraint: the dual stays a lower bound, but the objective is then
    measured too low.
    """

    def __call__(self, weights: NDArray[np.float64], example: ExampleIn, /) -> Separation:
        """Return the most violated output of one example."""


class Separator(Protocol):
    """Answers for all examples, or for chosen ones, in order."""

    @property
    def count(self) -> int:
        """Number of examples."""

    def separate(self, weights: NDArray[np.float64], indices: Sequence[int] | None = None) -> list[Separation]:
        """Return the separations of the examples with these indices (None: all)."""


@dataclass(frozen=True, slots=True)
class LocalSeparator(Generic[Example]):
    """Examples in memory, asked one after another in this process."""

    oracle: Oracle[Example]
    examples: Sequence[Example]

    @property
    def count(self) -> int:
        """Number of examples."""
        return len(self.examples)

    def separate(self, weights: NDArray[np.float64], indices: Sequence[int] | None = None) -> list[Separation]:
        """Return the separations of the examples with these indices (None: all)."""
        chosen = range(self.count) if indices is None else indices
        return [self.oracle(weights, self.examples[i]) for i in chosen]


@dataclass(frozen=True, slots=True)
class SpreadSeparator:
    """Examples that workers load themselves; only indices and weights travel out, feature vectors back.

    Attributes
    ----------
    answer : picklable `answer(weights, indices) -> list[Separation]` that loads and caches examples by index.
    count : number of examples. spread : of `parallel.open_workers`.
    chunk : examples per item of work.
    """

    answer: Callable[[NDArray[np.float64], Sequence[int]], list[Separation]]
    count: int
    spread: Spread
    chunk: int = 16

    def separate(self, weights: NDArray[np.float64], indices: Sequence[int] | None = None) -> list[Separation]:
        """Return the separations of the examples with these indices (None: all)."""
        chosen = list(range(self.count) if indices is None else indices)
        chunks = [chosen[i : i + self.chunk] for i in range(0, len(chosen), self.chunk)]
        return [one for answers in self.spread(partial(self.answer, weights), chunks) for one in answers]
