"""The stages of a training run on a folder: what is stale is never used, what workers do is what one process does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("sklearn", reason="scikit-learn is in the extra train")
pytest.importorskip("joblib", reason="joblib is in the extra train")

from frames_on_disk import write_folder

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.weights import start_weights
from room_layout_ros.datasets import FramesFolder, good_samples, open_folder
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.learning.example_store import ExampleRef, ExampleStore
from room_layout_ros.learning.structured_svm import SvmConfig
from room_layout_ros.learning.train import FrameRows, TrainConfig, checkpoint_name, learn_weights
from room_layout_ros.learning.train_run import (
    Workplace,
    build_examples,
    describe_frames,
    fit_rooms,
    make_separator,
    validate,
)
from room_layout_ros.parallel import Spread, open_workers

CAMERA = CameraIntrinsics(240, 180, 140.0, 140.0, 119.5, 89.5)
CONFIG = EstimatorConfig(superpixel_count=60)
LEARNING = TrainConfig(svm=SvmConfig(100.0, 0.01, 2))
START = start_weights().variant("full")
Rooms = Mapping[str, RoomCuboid]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> FramesFolder:
    source = SyntheticSource(frames=4, seed=5, noise="kinect", walk=False, camera=CAMERA)
    return open_folder(write_folder(tmp_path_factory.mktemp("frames") / "f", list(good_samples(source))))


def silent(_: object) -> None:
    """Take no notice."""


@pytest.fixture(scope="module")
def rooms(folder: FramesFolder) -> Rooms:
    with open_workers() as spread:
        return fit_rooms(folder, spread, silent)


def described(folder: FramesFolder, rooms: Rooms, place: Workplace) -> list[FrameRows]:
    return describe_frames(folder, rooms, place, silent, silent)


def stated(folder: FramesFolder, rooms: Rooms, place: Workplace, doubt: float = 0.4) -> list[ExampleRef]:
    """Examples with a context that is the truth mixed with nothing known."""
    contexts: dict[str, NDArray[np.float64]] = {}
    for rows in described(folder, rooms, place):
        share = rows.labels[:, 1:].astype(np.float64) + 1.0
        contexts[rows.name] = (1 - doubt) * share / share.sum(axis=1, keepdims=True) + doubt / 6
    return build_examples(folder, rooms, contexts, place, silent)


def workplace(path: Path, spread: Spread) -> Workplace:
    return Workplace(CONFIG, ExampleStore(path / "examples"), spread)


def here(path: Path) -> Workplace:
    return workplace(path, lambda function, items: map(function, items))


def learned(refs: list[ExampleRef], place: Workplace, folder: Path | None = None) -> NDArray[np.float64]:
    separator = make_separator(refs, place)
    checkpoint = None if folder is None else folder / checkpoint_name(separator, LEARNING, START)
    return learn_weights(separator, LEARNING, START, checkpoint=checkpoint).weights


def test_two_processes_fit_describe_state_learn_and_judge_as_one_does(
    folder: FramesFolder, rooms: Rooms, tmp_path: Path
) -> None:
    alone = here(tmp_path / "alone")
    refs = stated(folder, rooms, alone)
    assert len(refs) >= 3
    weights = learned(refs, alone)
    with open_workers(2) as spread:
        place = workplace(tmp_path / "spread", spread)
        assert {n: r.distances.tolist() for n, r in fit_rooms(folder, spread, silent).items()} == {
            n: r.distances.tolist() for n, r in rooms.items()
        }
        for mine, theirs in zip(described(folder, rooms, alone), described(folder, rooms, place), strict=True):
            assert mine.name == theirs.name
            np.testing.assert_array_equal(mine.features.values, theirs.features.values)
            np.testing.assert_array_equal(mine.labels, theirs.labels)
        assert stated(folder, rooms, place) == refs, "examples are known by their content"
        np.testing.assert_array_equal(learned(refs, place), weights)
        assert validate(START, refs, place) == validate(START, refs, alone)


def moved_room(folder: FramesFolder, rooms: Rooms, place: Workplace) -> list[ExampleRef]:
    name = next(iter(rooms))
    return stated(folder, {**rooms, name: replace(rooms[name], distances=rooms[name].distances * 1.03)}, place)


def other_context(folder: FramesFolder, rooms: Rooms, place: Workplace) -> list[ExampleRef]:
    return stated(folder, rooms, place, doubt=0.5)


@pytest.mark.parametrize("change", [moved_room, other_context])
def test_a_second_training_in_the_same_folder_learns_from_its_own_data(
    change: Callable[[FramesFolder, Rooms, Workplace], list[ExampleRef]],
    folder: FramesFolder,
    rooms: Rooms,
    tmp_path: Path,
) -> None:
    """The same frames, as many of them, the same settings: only what is known about them is other."""
    place = here(tmp_path)
    refs = stated(folder, rooms, place)
    first = learned(refs, place, tmp_path)
    np.testing.assert_array_equal(learned(refs, place, tmp_path), first)
    changed = change(folder, rooms, place)
    assert [ref.name for ref in changed] == [ref.name for ref in refs]
    second = learned(changed, place, tmp_path)
    elsewhere = here(tmp_path / "new")
    np.testing.assert_array_equal(second, learned(change(folder, rooms, elsewhere), elsewhere))
    assert not np.array_equal(second, first)
    stale = tmp_path / checkpoint_name(make_separator(refs, place), LEARNING, START)
    with pytest.raises(ValueError, match="other examples or settings"):
        learn_weights(make_separator(changed, place), LEARNING, START, checkpoint=stale)


def test_only_the_examples_of_the_last_run_are_kept(folder: FramesFolder, rooms: Rooms, tmp_path: Path) -> None:
    place = here(tmp_path)
    stated(folder, rooms, place)
    refs = other_context(folder, rooms, place)
    assert {path.name for path in place.store.folder.iterdir()} == {place.store.path(ref).name for ref in refs}
    place.store.path(refs[0]).unlink()
    with pytest.raises(OSError, match="joblib"):
        place.store.load(refs[0])


def test_other_settings_of_the_oracle_are_another_problem(folder: FramesFolder, rooms: Rooms, tmp_path: Path) -> None:
    place = here(tmp_path)
    refs = stated(folder, rooms, place)
    names = {
        checkpoint_name(make_separator(refs, place), LEARNING, START),
        checkpoint_name(make_separator(refs[:-1], place), LEARNING, START),
        checkpoint_name(make_separator(refs[::-1], place), LEARNING, START),
        checkpoint_name(make_separator(refs, replace(place, config=replace(CONFIG, use_depth=False))), LEARNING, START),
        checkpoint_name(make_separator(refs, place), replace(LEARNING, seed=1), START),
        checkpoint_name(make_separator(refs, place), replace(LEARNING, svm=SvmConfig(50.0)), START),
        checkpoint_name(make_separator(refs, place), LEARNING, START.variant("no_scene")),
    }
    assert len(names) == 7
    longer = replace(LEARNING, svm=replace(LEARNING.svm, max_rounds=9))
    assert checkpoint_name(make_separator(refs, place), longer, START) in names, "more rounds go on with the same"


def test_workers_are_sent_one_room_and_no_pictures(folder: FramesFolder, rooms: Rooms, tmp_path: Path) -> None:
    """What goes out per frame does not grow with the number of frames; what comes back is the rows alone."""
    import pickle

    sizes: dict[str, list[int]] = {}

    def weigh(function: Callable[[object], object], items: object) -> object:
        for item in items:  # type: ignore[attr-defined]
            result = function(item)
            sizes.setdefault(str(function.func.__name__), []).append(  # type: ignore[attr-defined]
                len(pickle.dumps((function, item))) + 10**6 * (len(pickle.dumps(result)) > 200_000)
            )
            yield result

    place = workplace(tmp_path, weigh)  # type: ignore[arg-type]
    refs = stated(folder, rooms, place)
    learned(refs, place)
    validate(START, refs, place)
    assert set(sizes) == {"_describe_one", "_build_one", "answer_from_files", "_judge_chunk"}
    assert max(sizes["_describe_one"]) < 4_000
    assert max(sizes["_build_one"]) < 4_000 + 60 * 6 * 8 * 3
    assert max(sizes["answer_from_files"] + sizes["_judge_chunk"]) < 8_000


def test_frames_that_cannot_be_used_are_counted_and_named(folder: FramesFolder, rooms: Rooms, tmp_path: Path) -> None:
    copy = open_folder(write_folder(tmp_path / "f", list(good_samples(folder))))
    bad = sorted(rooms)[1]
    (copy.path / "depth" / f"{bad}.png").write_bytes(b"no picture")
    told: list[str] = []
    rows = describe_frames(copy, rooms, here(tmp_path), silent, told.append)
    assert [one.name for one in rows] == [name for name in rooms if name != bad]
    assert len(told) == 1
    assert told[0].startswith(f"1 frames are left out, the first is {bad}: ")
