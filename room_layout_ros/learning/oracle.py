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

    @property
    def fingerprint(self) -> str:
        """What tells these examples and this oracle from others: a checkpoint belongs to one of them."""

    def separate(self, weights: NDArray[np.float64], indices: Sequence[int] | None = None) -> list[Separation]:
        """Return the separations of the examples with these indices (None: all)."""


@dataclass(frozen=True, slots=True)
class SpreadSeparator(Generic[Example]):
    """Examples that workers load themselves; only references and weights travel out, feature vectors back.

    Attributes
    ----------
    answer : picklable `answer(weights, references) -> list[Separation]` that loads and caches the examples meant.
    examples : a small picklable reference to each example. spread : of `parallel.open_workers`.
    fingerprint : of what the references stand for and the oracle's settings.
    chunk : examples per item of work.
    """

    answer: Callable[[NDArray[np.float64], Sequence[Example]], list[Separation]]
    examples: Sequence[Example]
    spread: Spread
    fingerprint: str
    chunk: int = 16

    @property
    def count(self) -> int:
        """Number of examples."""
        return len(self.examples)

    def separate(self, weights: NDArray[np.float64], indices: Sequence[int] | None = None) -> list[Separation]:
        """Return the separations of the examples with these indices (None: all)."""
        chosen = [self.examples[i] for i in (range(self.count) if indices is None else indices)]
        answers = self.spread(partial(self.answer, weights), chunks(chosen, self.chunk))
        return [one for answer in answers for one in answer]


def chunks(items: Sequence[Example], size: int) -> list[Sequence[Example]]:
    """Cut a sequence into pieces of `size` items; the last may be shorter."""
    return [items[i : i + size] for i in range(0, len(items), size)]
