"""One training run on a folder: its stages, spread over processes or machines, repeatable to the number.

What grows with the data stays with the workers: they read their frames and write and read the examples. The master
holds the rows of the context classifier's table (about 0.2 MB a frame), as its forests are grown there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.layout import RoomCuboid
from ..core.weights import ModelWeights
from ..datasets import BadFrame, FramesFolder, Sample
from ..parallel import Spread
from .example_store import ExampleRef, ExampleStore
from .fingerprint import fingerprint
from .fit_frame import FitJob, fit_item, read_line
from .folds import is_near
from .frames_apart import FrameAt, frames_apart
from .joint_examples import FrameDescription, build_example, describe
from .joint_oracle import JointOracle, Judged, judge
from .oracle import Separation, SpreadSeparator, chunks
from .scene_folds import SceneFolds
from .train import FrameRows, joint_oracle, rows_of, summary
from .working_sample import at_working_size

_CHUNK = 16
"""Examples per item of work."""


@dataclass(frozen=True, slots=True)
class Workplace:
    """Where and how the frames of a run are worked on.

    Attributes
    ----------
    config : of the estimator. store : for the examples. spread : of `parallel.open_workers`.
    networks : scene networks, None to learn without.
    """

    config: EstimatorConfig
    store: ExampleStore
    spread: Spread
    networks: SceneFolds | None = None


def fit_rooms(source: FramesFolder, spread: Spread, progress: Callable[[int], object]) -> dict[str, RoomCuboid]:
    """Fit rooms to all frames and return the accepted ones by name."""
    rooms = {}
    for count, (name, room) in enumerate(spread(_fit_one, frames_apart(source)), 1):
        progress(count)
        if room is not None:
            rooms[name] = room
    return rooms


def _fit_one(item: FrameAt | Sample | BadFrame) -> tuple[str, RoomCuboid | None]:
    return item.name, read_line(fit_item(FitJob(), item).line)


@dataclass(frozen=True, slots=True)
class _Task:
    """What a worker needs for one frame. context : (K, 6) probabilities, None while there are none."""

    frame: FrameAt
    room: RoomCuboid
    context: NDArray[np.float64] | None = None


def _tasks(source: FramesFolder, rooms: Mapping[str, RoomCuboid]) -> Iterator[_Task]:
    for frame in frames_apart(source):
        if isinstance(frame, FrameAt) and frame.name in rooms:
            yield _Task(frame, rooms[frame.name])


def describe_frames(
    source: FramesFolder,
    rooms: Mapping[str, RoomCuboid],
    place: Workplace,
    progress: Callable[[int], object],
    say: Callable[[str], object],
) -> list[FrameRows]:
    """Describe the frames that have a fitted room, in the order of their names; say how many cannot be used and why."""
    found, left_out = [], []
    work = partial(_describe_one, place.config, place.networks)
    for count, (name, rows) in enumerate(place.spread(work, _tasks(source, rooms)), 1):
        progress(count)
        if isinstance(rows, str):
            left_out.append(f"{name}: {rows}")
        else:
            found.append(rows)
    if left_out:
        say(f"{len(left_out)} frames are left out, the first is {left_out[0]}")
    return found


def _describe_one(config: EstimatorConfig, networks: SceneFolds | None, task: _Task) -> tuple[str, FrameRows | str]:
    description = _look(config, networks, task)
    return task.frame.name, description if isinstance(description, str) else rows_of(description)


def _look(config: EstimatorConfig, networks: SceneFolds | None, task: _Task) -> FrameDescription | str:
    """Read and describe a frame, or tell why it cannot be used."""
    cv2.setNumThreads(1)  # processes are the parallelism here
    item = task.frame.read()
    if isinstance(item, BadFrame):
        return item.error
    item = at_working_size(item, config)
    if item.truth is None or item.truth.labels40 is None:
        return "it has no class labels (labels40/NAME.png)"
    found = describe(item.frame, task.room, item.truth.labels40, config, networks)
    return "no usable depth or axes" if found is None else found


def build_examples(
    source: FramesFolder,
    rooms: Mapping[str, RoomCuboid],
    contexts: Mapping[str, NDArray[np.float64]],
    place: Workplace,
    progress: Callable[[int], object],
) -> list[ExampleRef]:
    """State the frames that have a context as joint problems, in files; those that cannot be stated are left out.

    The workers describe the frames once more: that is cheaper than keeping 3 MB of each until the forests are grown.
    """
    place.store.folder.mkdir(parents=True, exist_ok=True)
    tasks = (
        _Task(task.frame, task.room, contexts[task.frame.name])
        for task in _tasks(source, rooms)
        if task.frame.name in contexts
    )
    refs = []
    work = partial(_build_one, place.config, place.networks, place.store)
    for count, ref in enumerate(place.spread(work, tasks), 1):
        progress(count)
        if ref is not None:
            refs.append(ref)
    place.store.keep(refs)
    return refs


def _build_one(
    config: EstimatorConfig, networks: SceneFolds | None, store: ExampleStore, task: _Task
) -> ExampleRef | None:
    description = _look(config, networks, task)
    if isinstance(description, str) or task.context is None:
        return None
    example = build_example(description, task.context, config)
    return None if example is None else store.write(example)


def choose_names(names: Sequence[str], held_out: Sequence[str], limit: int | None) -> list[str]:
    """Return the names to learn from: none held out or within `MARGIN` of such, at most `limit`, evenly spread."""
    far = [name for name, near in zip(names, is_near(names, held_out), strict=True) if not near]
    if limit is None or len(far) <= limit:
        return far
    return [far[i] for i in np.linspace(0, len(far) - 1, limit).round().astype(int)]


def make_separator(refs: Sequence[ExampleRef], place: Workplace) -> SpreadSeparator[ExampleRef]:
    """Return the oracle over the examples, each worker reading what it is asked for."""
    oracle = joint_oracle(place.config)
    known = fingerprint(oracle, [ref.digest for ref in refs])
    return SpreadSeparator(partial(answer_from_files, place.store, oracle), refs, place.spread, known, _CHUNK)


def answer_from_files(
    store: ExampleStore, oracle: JointOracle, weights: NDArray[np.float64], refs: Sequence[ExampleRef]
) -> list[Separation]:
    """Answer a chunk in a worker."""
    cv2.setNumThreads(1)
    return [oracle(weights, store.load(ref)) for ref in refs]


def validate(weights: ModelWeights, refs: Sequence[ExampleRef], place: Workplace) -> dict[str, float]:
    """Return the means over the examples of the model's own answers (`train.summary`)."""
    work = partial(_judge_chunk, place.store, place.config, weights.vector)
    judged = [one for chunk in place.spread(work, chunks(refs, _CHUNK)) for one in chunk]
    return summary(judged, [ref.attainable for ref in refs])


def _judge_chunk(
    store: ExampleStore, config: EstimatorConfig, vector: NDArray[np.float64], refs: Sequence[ExampleRef]
) -> list[Judged]:
    cv2.setNumThreads(1)
    return [judge(ModelWeights(vector), store.load(ref), config) for ref in refs]
