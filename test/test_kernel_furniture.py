"""Furniture by kernel descriptors: the classifier, its file, its training, and the option of the estimator."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from frames_on_disk import write_folder
from numpy.typing import NDArray

from room_layout_ros.cli import main as room_layout
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.evidence.kernel_descriptors import COLOR, DEPTH, DESCRIPTORS, DescriptorModel
from room_layout_ros.core.evidence.match_kernels import Floats, compact_basis, standard_kernels
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.kernel_furniture import (
    SETS,
    KernelFurnitureModel,
    LinearClassifier,
    classify_by_kernels,
    columns_of,
    load_kernel_furniture,
    save_kernel_furniture,
)
from room_layout_ros.core.labels import CLUTTER, FURNITURE_IDS, N_CLUTTER_CLASSES
from room_layout_ros.core.model_file import WeightsError, read_arrays, write_arrays
from room_layout_ros.core.models import KERNEL_FURNITURE_FILE, config_folder
from room_layout_ros.datasets import FramesFolder, Sample, good_samples, open_folder
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.learning.kernel_furniture import KernelSettings, train_kernel_furniture
from room_layout_ros.learning.kernel_rows import WordSettings
from room_layout_ros.learning.linear_svm import fit_one_vs_rest

CAMERA = CameraIntrinsics(240, 180, 140.0, 140.0, 119.5, 89.5)
BED = FURNITURE_IDS.index(4)
KERNELS = standard_kernels()


def model(**chosen: int) -> KernelFurnitureModel:
    """Classifiers that find one class whatever they see, by default beds; three words of each descriptor."""
    rng = np.random.default_rng(3)
    kernels = KERNELS
    lengths = {name: len(kernels[name].pairs) if name in kernels else 10 for name in DESCRIPTORS}
    words = {name: compact_basis(rng.random((3, length)), 0.3, 3) for name, length in lengths.items()}
    descriptors = DescriptorModel(kernels, words)
    classifiers = {}
    for name, read in SETS.items():
        sure = np.where(np.arange(N_CLUTTER_CLASSES) == chosen.get(name, BED), 9.0, 0.0).astype(np.float32)
        zeros = np.zeros((N_CLUTTER_CLASSES, len(columns_of(descriptors, read))), np.float32)
        classifiers[name] = LinearClassifier(zeros, sure)
    return KernelFurnitureModel(
        descriptors, classifiers, np.full(N_CLUTTER_CLASSES, 1 / N_CLUTTER_CLASSES, np.float32), {"made": "here"}
    )


def rooms(count: int) -> Iterator[Sample]:
    """Small furnished rooms, numbered so that no two are neighbours."""
    source = SyntheticSource(count, 5, noise="kinect", walk=False, camera=CAMERA, options={"furniture": 0.5})
    for i, sample in enumerate(good_samples(source), 1):
        yield replace(sample, frame=replace(sample.frame, name=f"{10 * i:04d}"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of models with the small one among them."""
    path = tmp_path_factory.mktemp("models")
    for file in config_folder().glob("*_plain.npz"):
        shutil.copy(file, path)
    save_kernel_furniture(model(), path / KERNEL_FURNITURE_FILE)
    return path


def features_of(parts: tuple[tuple[str, ...], ...], learned: KernelFurnitureModel) -> Floats:
    """A row for each set of descriptors that are known."""
    rows = np.full((len(parts), len(columns_of(learned.descriptors, DESCRIPTORS))), np.nan, np.float32)
    for row, names in zip(rows, parts, strict=True):
        if names:
            row[columns_of(learned.descriptors, names)] = 0.5
    return rows


def test_a_superpixel_is_judged_by_what_is_known_of_it() -> None:
    learned = model(color_depth=0, color=1, depth=2)
    probability = classify_by_kernels(features_of((DESCRIPTORS, COLOR, DEPTH, ()), learned), learned)
    assert probability[:3].argmax(axis=1).tolist() == [0, 1, 2]
    np.testing.assert_allclose(probability[3], learned.prior)
    np.testing.assert_allclose(probability.sum(axis=1), 1.0, rtol=1e-6)


def test_a_model_survives_its_file_byte_for_byte(tmp_path: Path) -> None:
    learned = model()
    save_kernel_furniture(learned, tmp_path / "a.npz")
    again = load_kernel_furniture(tmp_path / "a.npz")
    save_kernel_furniture(again, tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    rows = features_of((DESCRIPTORS, COLOR), learned)
    np.testing.assert_array_equal(classify_by_kernels(rows, again), classify_by_kernels(rows, learned))


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("prior", np.zeros(N_CLUTTER_CLASSES, np.float32), "above 0 is needed"),
        ("svm_color.weights", np.zeros((N_CLUTTER_CLASSES, 2), np.float32), "classifier 'color' has weights"),
        ("spin.words.points", np.zeros((3, 4), np.float32), "words of spin have 4 components"),
        ("gradient.pairs", np.full((50, 2), 90, np.int16), "components below"),
        ("spin.attribute.gamma", np.zeros(0), "gamma of spin.attribute has 0 values"),
        ("pattern.pairs", None, "no array 'pattern.pairs'"),
    ],
)
def test_a_file_that_describes_no_such_model_is_refused(
    tmp_path: Path, name: str, value: NDArray[np.generic] | None, said: str
) -> None:
    save_kernel_furniture(model(), tmp_path / "m.npz")
    arrays, card = read_arrays(tmp_path / "m.npz", "room_layout kernel furniture")
    if value is None:
        del arrays[name]
    else:
        arrays[name] = value
    write_arrays(tmp_path / "m.npz", "room_layout kernel furniture", arrays, card)
    with pytest.raises(WeightsError, match=said):
        load_kernel_furniture(tmp_path / "m.npz")


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    save_kernel_furniture(model(), tmp_path / "m.npz")
    whole = (tmp_path / "m.npz").read_bytes()
    (tmp_path / "m.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(WeightsError, match="cut or no"):
        load_kernel_furniture(tmp_path / "m.npz")
    with pytest.raises(WeightsError, match="cannot be read"):
        load_kernel_furniture(tmp_path / "none.npz")
    with pytest.raises(WeightsError, match="'room_layout furniture'"):
        load_kernel_furniture(config_folder() / "furniture_rgbd.npz")


def test_the_option_names_the_clutter_and_changes_nothing_else(folder: Path) -> None:
    kernel = LayoutEstimator(EstimatorConfig(scene_network=False, furniture_features="kernel"), folder)
    usual = LayoutEstimator(EstimatorConfig(scene_network=False), folder)
    assert usual.kernels is None
    for sample in rooms(2):
        estimate, other = kernel.estimate(sample.frame), usual.estimate(sample.frame)
        clutter = estimate.labels == CLUTTER
        assert clutter.any()
        assert (estimate.furniture[~clutter] == 0).all()
        assert np.isin(estimate.furniture[clutter], (0, 4)).all(), "beds wherever anything is known"
        assert (estimate.furniture[clutter] == 4).mean() > 0.9
        np.testing.assert_array_equal(estimate.layout, other.layout)
        np.testing.assert_array_equal(estimate.labels, other.labels)
        assert estimate.confidence == other.confidence


@pytest.mark.parametrize(("color", "depth"), [(True, False), (False, True)])
def test_the_option_works_with_colour_or_depth_alone(folder: Path, color: bool, depth: bool) -> None:
    config = EstimatorConfig(scene_network=False, furniture_features="kernel", use_color=color, use_depth=depth)
    estimate = LayoutEstimator(config, folder).estimate(next(rooms(1)).frame)
    assert (estimate.furniture == 4).any()


def test_the_option_says_which_file_it_misses(tmp_path: Path) -> None:
    for file in config_folder().glob("*_plain.npz"):
        shutil.copy(file, tmp_path)
    LayoutEstimator(EstimatorConfig(scene_network=False), tmp_path)
    with pytest.raises(WeightsError, match=KERNEL_FURNITURE_FILE):
        LayoutEstimator(EstimatorConfig(scene_network=False, furniture_features="kernel"), tmp_path)
    with pytest.raises(ValueError, match="allowed are context, kernel"):
        EstimatorConfig(furniture_features="deep")


def test_the_shipped_model_is_small_and_says_how_good_it_was() -> None:
    path = config_folder() / KERNEL_FURNITURE_FILE
    assert path.stat().st_size < 2 << 20
    card = load_kernel_furniture(path).card
    assert len(card["held_out"]) == 37
    assert card["margin"] == 5
    assert {name: len(rows) > 0 for name, rows in card["cross_validation"].items()} == dict.fromkeys(SETS, True)


QUICK = KernelSettings(
    words=WordSettings(words=6, components=4, patches=40), degraded_every=3, C=(10.0,), balance=(0.5,), scale=(1.0,),
    other=(0.0,), folds=2, passes=10,
)  # fmt: skip


def test_a_model_is_learned_from_a_folder_the_same_each_time(tmp_path: Path) -> None:
    pytest.importorskip("sklearn", reason="scikit-learn is in the extra train")
    frames = open_folder(write_folder(tmp_path / "frames", list(rooms(6))))
    assert isinstance(frames, FramesFolder)
    first, second = (train_kernel_furniture(frames, tmp_path / out, ("0010",), QUICK) for out in "ab")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert first.card["frames"] == 5, "one is held out"
    assert set(second.card["cross_validation"]) == set(SETS)
    save_kernel_furniture(load_kernel_furniture(tmp_path / "a"), tmp_path / "c")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "c").read_bytes()


def test_the_command_says_what_it_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("sklearn", reason="scikit-learn is in the extra train")
    frames = write_folder(tmp_path / "frames", list(rooms(1)))
    assert room_layout(["furniture", str(frames), "--words", "100000", "--out", str(tmp_path / "out")]) == 2
    assert "100000 words need as many at least" in capsys.readouterr().err


def test_one_against_the_rest_is_scikit_learns() -> None:
    svm = pytest.importorskip("sklearn.svm", reason="scikit-learn is in the extra train")
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(400, 6)).astype(np.float32)
    classes = (rows @ rng.normal(size=(6, 3)) + rng.normal(size=(400, 3))).argmax(axis=1)
    weight = rng.uniform(0.2, 2.0, 400)
    weights, intercepts = fit_one_vs_rest(rows, classes, 3, weight, 0.3, passes=500)
    theirs = svm.LinearSVC(C=0.3, dual=False, tol=1e-8, intercept_scaling=100.0).fit(rows, classes, weight)
    np.testing.assert_allclose(weights, theirs.coef_, atol=2e-3)
    np.testing.assert_allclose(intercepts, theirs.intercept_, atol=2e-3)


def test_a_class_that_was_never_seen_is_never_the_most_likely() -> None:
    rows = np.random.default_rng(1).normal(size=(50, 3)).astype(np.float32)
    weights, intercepts = fit_one_vs_rest(rows, (rows[:, 0] > 0).astype(np.intp), 3, np.full(50, 1.0), 10.0)
    assert (rows @ weights.T + intercepts).argmax(axis=1).max() < 2
