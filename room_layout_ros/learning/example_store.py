"""Examples on disk, where the workers that learn from them find them; each file is named by its content."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import joblib

from .fingerprint import fingerprint
from .joint_examples import JointExample
from .losses import JointLoss

_CACHED_EXAMPLES = 1024
"""Examples a process keeps in memory, about 2 MB each."""


@dataclass(frozen=True, slots=True)
class ExampleRef:
    """What travels in an example's place.

    Attributes
    ----------
    name : of the frame. digest : fingerprint of the example. attainable : loss of the truth, as the example states it.
    """

    name: str
    digest: str
    attainable: JointLoss


@dataclass(frozen=True, slots=True)
class ExampleStore:
    """A folder of examples; on several machines it must be on all of them under the same path.

    The files are joblib pickles that a training run makes and reads itself; nothing of them is shipped. A file's name
    holds its content's fingerprint, so neither the disk nor the memory of a worker that stays can give an older run's.
    """

    folder: Path

    def path(self, ref: ExampleRef) -> Path:
        """Return the file of an example."""
        return self.folder / f"{ref.name}.{ref.digest[:16]}.joblib"

    def write(self, example: JointExample) -> ExampleRef:
        """Keep an example; its file appears whole or not at all."""
        ref = ExampleRef(example.name, fingerprint(example, example.truth_features), example.attainable)
        path = self.path(ref)
        if not path.exists():
            partial = path.with_name(f".{path.name}.{os.getpid()}")
            joblib.dump(example, partial)
            partial.replace(path)
        return ref

    def load(self, ref: ExampleRef) -> JointExample:
        """Return an example; it stays in this process's memory for the next round.

        Raises
        ------
        OSError
            When the file is not there.
        TypeError
            When it holds something else.
        """
        return _load(self.path(ref))

    def keep(self, refs: Iterable[ExampleRef]) -> None:
        """Remove all other examples: those of earlier runs on other data."""
        wanted = {self.path(ref) for ref in refs}
        for path in set(self.folder.glob("*.joblib")) - wanted:
            path.unlink()


@lru_cache(maxsize=_CACHED_EXAMPLES)
def _load(path: Path) -> JointExample:
    example = joblib.load(path)
    if not isinstance(example, JointExample):
        raise TypeError(f"{path} holds a {type(example).__name__}; it is no example of this run")
    return example
