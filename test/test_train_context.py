"""Training of the context classifier end to end, on a folder of a few small frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import write_folder

pytest.importorskip("sklearn")

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.evidence.features import SuperpixelFeatures
from room_layout_ros.core.evidence.geometric_context import compute_geometric_context, load_context
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import Sample
from room_layout_ros.datasets.folder import FramesFolder, open_folder
from room_layout_ros.datasets.sample import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.learning.context import (
    ContextSettings,
    domain_errors,
    structure_error,
    train_context,
)
from room_layout_ros.learning.context_table import ContextTable, collect_table, join_tables
from room_layout_ros.learning.folds import SYNTHETIC_FIRST, folds_of, row_folds
from room_layout_ros.learning.forest_export import BINS
from room_layout_ros.learning.synthetic_frames import random_frames

CONFIG = EstimatorConfig(superpixel_count=70)
CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
SETTINGS = ContextSettings(
    trees=8, leaves=8, face_trees=3, face_leaves=6, learning_rate=0.3, synthetic_frames=10, degraded_every=4
)
Folder = tuple[FramesFolder, dict[str, RoomCuboid]]


@pytest.fixture(scope="module", autouse=True)
def _few_bins() -> Iterator[None]:
    """The bins of a feature are nine tenths of the time of so small a training."""
    with pytest.MonkeyPatch.context() as patch:
        for forest in BINS:
            patch.setitem(BINS, forest, 4)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Frames 0010, 0020, ... of synthetic rooms in the place of recorded ones, and their rooms."""
    samples: list[Sample] = []
    rooms: dict[str, RoomCuboid] = {}
    for i, sample in enumerate(good_samples(SyntheticSource(9, 3, noise="kinect", walk=False, camera=CAMERA))):
        name = f"{10 * (i + 1):04d}"
        samples.append(replace(sample, frame=replace(sample.frame, name=name)))
        assert sample.truth is not None
        assert sample.truth.cuboid is not None
        rooms[name] = sample.truth.cuboid
    return open_folder(write_folder(tmp_path_factory.mktemp("frames") / "f", samples)), rooms


@pytest.fixture(scope="module")
def trained(folder: Folder, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return two files, written by two calls."""
    paths = tmp_path_factory.mktemp("models") / "a.npz", tmp_path_factory.mktemp("models") / "b.npz"
    for path in paths:
        train_context(*folder, path, CONFIG, ("0040",), settings=SETTINGS, folds=2, facts={"date": "2013-12-01"})
    return paths


def test_one_call_makes_the_same_file_twice_and_it_says_what_it_is(trained: tuple[Path, Path]) -> None:
    assert trained[0].read_bytes() == trained[1].read_bytes()
    model = load_context(trained[0])
    assert model.card["frames"] == 8  # 40 is held out
    assert model.card["degraded"] == 2  # of 10, 20, 30, 50 .. 90 the first and the fifth
    assert model.card["synthetic"] == 10
    assert model.card["date"] == "2013-12-01"
    assert set(model.card["cross_validation"]) >= {"real", "degraded", "synthetic_clean", "synthetic_nyu8"}
    assert 0.0 < model.card["cross_validation"]["real"]["structure"] < 45.0


def test_the_model_learned_something_about_a_frame_held_out(folder: Folder, trained: tuple[Path, Path]) -> None:
    source, rooms = folder
    model = load_context(trained[0])
    table = collect_table(good_samples(source.subset(("0040",))), rooms, CONFIG, degraded_every=0)
    context = compute_geometric_context(SuperpixelFeatures(table.features, table.names), model)
    every = np.ones(len(table.frame), bool)
    majority = np.zeros_like(context)
    majority[:, 1 if table.structure.sum() > table.pixels.sum() / 2 else 5] = 1.0
    assert structure_error(table, context, every) < 0.8 * structure_error(table, majority, every)


def test_without_depth_a_model_of_colour_is_learned(folder: Folder, tmp_path: Path) -> None:
    config, settings = replace(CONFIG, use_depth=False), replace(SETTINGS, synthetic_frames=0)
    model, table = train_context(*folder, tmp_path / "rgb.npz", config, settings=settings)
    assert load_context(tmp_path / "rgb.npz").card["depth"] is False
    assert (table.variant == 0).all(), "depth that is not used cannot be degraded"
    assert 0 < len(model.names) < len(names_with_depth(folder))


def names_with_depth(folder: Folder) -> tuple[str, ...]:
    source, rooms = folder
    return collect_table(good_samples(source.subset(("0010",))), rooms, CONFIG, degraded_every=0).names


def test_every_second_frame_comes_again_with_other_depth(folder: Folder) -> None:
    source, rooms = folder
    few = source.subset(("0010", "0020", "0030"))
    table = collect_table(good_samples(few), rooms, CONFIG, degraded_every=2)
    assert set(table.frame[table.variant == 1]) == {10, 30}
    assert set(table.frame[table.variant == 0]) == {10, 20, 30}


def test_a_video_of_odd_numbers_alone_has_as_many_degraded_frames_with_noise_of_their_own(folder: Folder) -> None:
    source, rooms = folder

    def odd() -> Iterator[Sample]:
        for sample in good_samples(source.subset(("0010", "0020", "0030", "0040"))):
            yield replace(sample, frame=replace(sample.frame, name=f"{int(sample.name) + 1:04d}"))

    named = {f"{int(name) + 1:04d}": room for name, room in rooms.items()}
    table = collect_table(odd(), named, CONFIG, degraded_every=2)
    assert set(table.frame[table.variant == 1]) == {11, 31}
    alone = collect_table((sample for sample in odd() if sample.name == "0031"), named, CONFIG, degraded_every=2)
    rows = (table.frame == 31) & (table.variant == 1)
    np.testing.assert_array_equal(table.features[rows], alone.features[alone.variant == 1])


def test_the_place_of_a_frame_is_that_among_labelled_ones(folder: Folder) -> None:
    source, rooms = folder

    def every_second_labelled() -> Iterator[Sample]:
        for i, sample in enumerate(good_samples(source.subset(("0010", "0020", "0030", "0040")))):
            yield sample if i % 2 else replace(sample, truth=None)

    table = collect_table(every_second_labelled(), rooms, CONFIG, degraded_every=2)
    assert set(table.frame[table.variant == 1]) == {20}
    assert set(table.frame[table.variant == 0]) == {20, 40}


def test_folds_are_blocks_apart_and_synthetic_frames_have_their_own() -> None:
    frame = np.array([1, 2, 8, 20, 21, 30, SYNTHETIC_FIRST, SYNTHETIC_FIRST + 1, SYNTHETIC_FIRST + 6])
    folds = list(row_folds(frame, 2))
    assert (folds[0][1] | folds[1][1]).all()
    assert not (folds[0][1] & folds[1][1]).any()
    assert folds[0][1].tolist() == [True, True, True, False, False, False, True, True, False]
    for train, validate in folds:
        assert np.abs(frame[train][:, None] - frame[validate]).min() > 5
    # the margin keeps synthetic neighbours apart too: of the last, five numbers away and six
    assert folds[1][0][6:].tolist() == [True, False, False]


def test_rows_of_fewer_frames_than_folds_are_shared_out_while_as_few_names_are_refused() -> None:
    frame = np.array([10, 10, 30, SYNTHETIC_FIRST])
    held = [validate.tolist() for _, validate in row_folds(frame, 3)]
    assert held == [[True, True, False, True], [False, False, True, False], [False] * 4]
    for names in (["0010", "0030"], ["0010", "0010", "0030"]):
        with pytest.raises(ValueError, match=r"folds is 3; 2 to the number of frames \(2\)"):
            list(folds_of(names, 3))


def test_random_rooms_are_the_same_for_every_count_and_differ_by_seed() -> None:
    three, two = list(random_frames(3, 1)), list(random_frames(2, 1))
    other = next(iter(random_frames(1, 2)))
    for a, b in zip(three, two, strict=False):
        assert a.frame.color is not None
        assert np.array_equal(a.frame.color, b.frame.color)  # type: ignore[arg-type]
        assert a.frame.camera == b.frame.camera
    assert other.frame.color is not None
    assert not np.array_equal(other.frame.color, three[0].frame.color)  # type: ignore[arg-type]


def test_tables_of_other_features_are_not_joined(folder: Folder) -> None:
    source, rooms = folder
    table = collect_table(good_samples(source.subset(("0010",))), rooms, CONFIG, degraded_every=0)
    renamed = ContextTable(
        names=("other", *table.names[1:]),
        **{name: getattr(table, name) for name in ContextTable.__slots__ if name != "names"},
    )
    with pytest.raises(ValueError, match="different features"):
        join_tables([table, renamed])
    both = join_tables([table, table])
    assert len(both.frame) == 2 * len(table.frame)
    errors = domain_errors(both, np.eye(6)[np.zeros(len(both.frame), int)])
    assert set(errors) == {"real"}
