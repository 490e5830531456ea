"""A model file is believed only when everything about it is right."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from room_layout_ros.core import model_file
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.core.weights import (
    BLOCKS,
    N_FEATURES,
    VARIANTS,
    ModelWeights,
    load_weights,
    pack_blocks,
    save_weights,
    start_weights,
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "model.npz"
    save_weights(start_weights(), file)
    return file


def rewrite(path: Path, change: Callable[[dict[str, bytes]], None]) -> None:
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def npy(array: Any, allow_pickle: bool = False) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=allow_pickle)
    return stream.getvalue()


def resign(members: dict[str, bytes], **card: Any) -> None:
    """Make the hash right again, so that the next check is the one that refuses."""
    arrays = {name.removesuffix(".npy"): content for name, content in members.items() if name != "card.json"}
    whole = {**json.loads(members["card.json"]), "sha256": model_file._digest(arrays), **card}
    members["card.json"] = json.dumps(whole).encode()


def test_weights_survive_the_file_to_the_bit(path: Path, rng: np.random.Generator) -> None:
    weights = ModelWeights(rng.normal(size=N_FEATURES), {"name": "test", "C": 1000.0, "frames": [1, 2]})
    save_weights(weights, path)
    loaded = load_weights(path)
    assert loaded.vector.tobytes() == weights.vector.tobytes()
    assert loaded.card == weights.card


def test_the_same_weights_give_the_same_file(path: Path, tmp_path: Path) -> None:
    save_weights(start_weights(), tmp_path / "again.npz")
    assert path.read_bytes() == (tmp_path / "again.npz").read_bytes()


def test_numpy_reads_the_file_too(path: Path) -> None:
    with np.load(path, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["pair"], start_weights().block("pair"))


def test_blocks_are_the_papers_counts() -> None:
    sizes = {name: int(np.prod(shape)) for name, shape in BLOCKS.items()}
    assert sizes["layout_om"] + sizes["layout_gc"] == 5 * 11
    assert sizes["label_gc"] + sizes["label_depth"] == 48
    assert sizes["pair"] == 36
    assert sizes["compatibility"] == 30
    assert sum(sizes.values()) == N_FEATURES


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="cannot be read: No such file or directory"):
        load_weights(tmp_path / "nothing.npz")
    with pytest.raises(WeightsError, match="cannot be read: Is a directory"):
        load_weights(tmp_path)


def test_every_cut_of_the_file_is_refused(path: Path) -> None:
    whole = path.read_bytes()
    for size in range(0, len(whole), 97):
        path.write_bytes(whole[:size])
        with pytest.raises(WeightsError):
            load_weights(path)


def test_every_flipped_byte_is_refused_or_harmless(path: Path, rng: np.random.Generator) -> None:
    whole = path.read_bytes()
    truth = start_weights().vector.tobytes()
    for place in rng.integers(0, len(whole), 300):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(damaged))
        try:
            assert load_weights(path).vector.tobytes() == truth  # a flag or a date of the zip, not an array
        except WeightsError:
            continue


def test_a_changed_array_is_refused(path: Path) -> None:
    rewrite(path, lambda m: m.update({"pair.npy": npy(np.ones((6, 6)))}))
    with pytest.raises(WeightsError, match="do not match their SHA-256"):
        load_weights(path)


@pytest.mark.parametrize(
    ("member", "content", "message"),
    (
        ("pair.npy", npy(np.ones((6, 5))), r"block pair of .* is float64 \(6, 5\); float64 \(6, 6\) is needed"),
        ("pair.npy", npy(np.ones((6, 6), np.float32)), r"block pair of .* is float32 \(6, 6\)"),
        ("pair.npy", npy(np.full((6, 6), np.nan)), "array 'pair' of .* holds a value that is not finite"),
        ("pair.npy", npy(np.full((6, 6), np.inf)), "array 'pair' of .* holds a value that is not finite"),
        ("pair.npy", npy(np.array([{}] * 6), allow_pickle=True), "pickled objects are refused"),
        ("pair.npy", npy(np.full((6, 6), "x")), "numbers are needed"),
        ("pair.npy", pickle.dumps(np.ones((6, 6))), "pickled objects are refused"),
        ("pair.npy", b"", "pickled objects are refused"),
        ("extra.npy", npy(np.ones(3)), "has the unknown block extra"),
    ),
)
def test_wrong_arrays_are_refused_even_with_a_right_hash(path: Path, member: str, content: bytes, message: str) -> None:
    def change(members: dict[str, bytes]) -> None:
        members[member] = content
        resign(members)

    rewrite(path, change)
    with pytest.raises(WeightsError, match=message):
        load_weights(path)


def test_a_pickle_in_the_file_is_never_run(path: Path, tmp_path: Path) -> None:
    trap = tmp_path / "trap"

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (trap,)

    def change(members: dict[str, bytes]) -> None:
        members["pair.npy"] = npy(np.array([Trap()], dtype=object), allow_pickle=True)
        resign(members)

    rewrite(path, change)
    with pytest.raises(WeightsError, match="pickled objects are refused"):
        load_weights(path)
    assert not trap.exists()


def test_a_missing_block_is_named(path: Path) -> None:
    def change(members: dict[str, bytes]) -> None:
        del members["smoothness.npy"]
        resign(members)

    rewrite(path, change)
    with pytest.raises(WeightsError, match="has no block smoothness"):
        load_weights(path)


def test_another_version_or_kind_is_refused(path: Path) -> None:
    rewrite(path, lambda m: resign(m, schema=99))
    with pytest.raises(WeightsError, match="has schema version 99; version 1 is needed"):
        load_weights(path)
    rewrite(path, lambda m: resign(m, schema=1, kind="cat"))
    with pytest.raises(WeightsError, match="is of kind 'cat'"):
        load_weights(path)


@pytest.mark.parametrize(
    "card", (b"", b"[1]", b"null", b"\xff\xfe", b"[" * 100_000), ids=("empty", "list", "null", "binary", "deep")
)
def test_an_unreadable_card_is_refused(path: Path, card: bytes) -> None:
    rewrite(path, lambda m: m.update({"card.json": card}))
    with pytest.raises(WeightsError):
        load_weights(path)


def test_a_zip_bomb_is_refused_before_it_is_unpacked(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rewrite(path, lambda m: m.update({"bomb.npy": bytes(model_file.MAX_ARRAY_BYTES + 1)}))
    assert path.stat().st_size < 1 << 20
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_: pytest.fail("the bomb was opened"))
    with pytest.raises(WeightsError, match="unpacks to"):
        load_weights(path)


def test_a_huge_file_is_refused_by_its_size(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(model_file.MAX_FILE_BYTES + 1)  # a hole: takes no room on the disk
    with pytest.raises(WeightsError, match="at most"):
        load_weights(path)


def test_an_array_that_says_it_is_huge_is_refused(path: Path) -> None:
    header = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"

    def change(members: dict[str, bytes]) -> None:
        members["pair.npy"] = header.ljust(127) + b"\n"
        resign(members)

    rewrite(path, change)
    with pytest.raises(WeightsError):
        load_weights(path)


def test_values_check_themselves() -> None:
    with pytest.raises(ValueError, match=rf"float64 \({N_FEATURES},\) is needed"):
        ModelWeights(np.zeros(3))
    bad = np.zeros(N_FEATURES)
    bad[7] = np.nan
    with pytest.raises(ValueError, match="weight 7 is not finite"):
        ModelWeights(bad)
    with pytest.raises(ValueError, match="block 'nothing' is unknown"):
        pack_blocks({"nothing": np.zeros(1)})
    with pytest.raises(ValueError, match=r"block pair has shape \(3,\); \(6, 6\) is needed"):
        pack_blocks({"pair": np.zeros(3)})
    with pytest.raises(ValueError, match="model variant is 'best'; allowed are full"):
        start_weights().variant("best")


@pytest.mark.parametrize("value", (np.nan, np.inf))
def test_values_that_no_reader_would_take_are_not_written(value: float, tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match=r"'b' for .* holds a value that is not finite; nothing is written"):
        model_file.write_arrays(tmp_path / "m.npz", "any", {"a": np.zeros(2), "b": np.array([0.0, value])}, {})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", VARIANTS)
def test_weights_count_without_what_the_variant_or_the_frame_lacks(name: str, rng: np.random.Generator) -> None:
    weights = ModelWeights(rng.normal(size=N_FEATURES))
    np.testing.assert_array_equal(weights.used(name).vector, weights.variant(name).vector)
    for with_depth, with_scene in ((True, False), (False, True), (False, False)):
        lacking = [] if with_depth else [*VARIANTS["rgb"]]
        lacking += [] if with_scene else ["layout_scene"]
        expected = weights.variant(name).without(*lacking)
        np.testing.assert_array_equal(weights.used(name, with_depth, with_scene).vector, expected.vector)
