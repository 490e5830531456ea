"""One training run on a folder: its stages on disk, spread over processes or machines, repeatable to the number."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import cv2
import joblib
import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.layout import RoomCuboid
from ..datasets import BadFrame, FramesFolder, Sample
from ..parallel import Spread
from .fit_frame import FitJob, fit_item
from .joint_examples import FrameDescription, JointExample, describe
from .joint_oracle import JointOracle
from .oracle import Separation, Separator, SpreadSeparator
from .scene_folds import SceneFolds
from .train import MARGIN, frame_numbers, local_separator

_CACHED_EXAMPLES = 4096
"""Examples a worker keeps in memory, about 2 MB each."""


@dataclass(frozen=True, slots=True)
class RunStages:
    """Where the files of a run lie that workers share; on several machines this folder must be on all of them.

    The example files are joblib pickles of the run itself, made and read by it alone; nothing of them is shipped.
    """

    folder: Path

    @property
    def examples(self) -> Path:
        """Folder of the examples."""
        return self.folder / "examples"

    def example_path(self, name: str) -> Path:
        """File of one example."""
        return self.examples / f"{name}.joblib"


def fit_rooms(source: FramesFolder, spread: Spread, progress: Callable[[int], object]) -> dict[str, RoomCuboid]:
    """Fit rooms to all frames and return the accepted ones by name."""
    rooms = {}
    for count, (name, room) in enumerate(spread(_fit_one, source), 1):
        progress(count)
        if room is not None:
            rooms[name] = room
    return rooms


def _fit_one(item: Sample | BadFrame) -> tuple[str, RoomCuboid | None]:
    line = fit_item(FitJob(), item).line
    if not line["accepted"]:
        return item.name, None
    distances = np.array([np.inf if d is None else d for d in line["distances_m"]], np.float64)
    U, _, Vt = np.linalg.svd(np.array(line["axes"], np.float64))
    return item.name, RoomCuboid(U @ Vt, distances)


def describe_frames(
    source: FramesFolder,
    rooms: Mapping[str, RoomCuboid],
    config: EstimatorConfig,
    spread: Spread,
    progress: Callable[[int], object],
    networks: SceneFolds | None = None,
) -> list[FrameDescription]:
    """Describe the frames that have a fitted room, in the order of their names; with scene networks where given."""
    names = tuple(name for name in source.names if name in rooms)
    found = []
    for count, one in enumerate(spread(partial(_describe_one, dict(rooms), config, networks), source.subset(names)), 1):
        progress(count)
        if one is not None:
            found.append(one)
    return found


def _describe_one(
    rooms: dict[str, RoomCuboid], config: EstimatorConfig, networks: SceneFolds | None, item: Sample | BadFrame
) -> FrameDescription | None:
    cv2.setNumThreads(1)  # processes are the parallelism here
    if isinstance(item, BadFrame) or item.truth is None or item.truth.labels40 is None:
        return None
    return describe(item.frame, rooms[item.name], item.truth.labels40, config, networks)


def choose_names(names: Sequence[str], held_out: Sequence[str], limit: int | None) -> list[str]:
    """Return the names to learn from: none held out or within `MARGIN` of such, at most `limit`, evenly spread."""
    held = np.array(frame_numbers(held_out), int)
    numbers = frame_numbers(names)
    far = [n for n, number in zip(names, numbers, strict=True) if not (np.abs(held - number) <= MARGIN).any()]
    if limit is None or len(far) <= limit:
        return far
    return [far[i] for i in np.linspace(0, len(far) - 1, limit).round().astype(int)]


def make_separator(
    examples: Sequence[JointExample], estimator: EstimatorConfig, stages: RunStages, spread: Spread | None
) -> Separator:
    """Return the oracle over the examples: in this process, or spread, each worker reading what it is asked for."""
    local = local_separator(examples, estimator)
    if spread is None:
        return local
    stages.examples.mkdir(parents=True, exist_ok=True)
    for example in examples:
        joblib.dump(example, stages.example_path(example.name))
    names = tuple(example.name for example in examples)
    oracle = local.oracle
    if not isinstance(oracle, JointOracle):
        raise TypeError(f"oracle is {type(oracle).__name__}; the joint model's is needed")
    return SpreadSeparator(partial(answer_from_files, stages, names, oracle), len(names), spread)


def answer_from_files(
    stages: RunStages,
    names: tuple[str, ...],
    oracle: JointOracle,
    weights: NDArray[np.float64],
    indices: Sequence[int],
) -> list[Separation]:
    """Answer a chunk in a worker; examples stay in its memory for the next round."""
    cv2.setNumThreads(1)
    return [oracle(weights, _load_example(stages.example_path(names[i]))) for i in indices]


@lru_cache(maxsize=_CACHED_EXAMPLES)
def _load_example(path: Path) -> JointExample:
    example = joblib.load(path)
    if not isinstance(example, JointExample):
        raise TypeError(f"{path} holds a {type(example).__name__}; it is no example of this run")
    return example


def split_by_name(
    items: Sequence[JointExample], positions: Sequence[tuple[list[int], list[int]]]
) -> Iterator[tuple[list[JointExample], list[JointExample]]]:
    """Yield (train, validate) examples of each fold."""
    for train, held in positions:
        yield [items[i] for i in train], [items[i] for i in held]
