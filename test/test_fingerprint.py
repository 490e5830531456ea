"""Fingerprints: equal for equal contents wherever they were made, different for anything else."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from room_layout_ros.learning.fingerprint import fingerprint


@dataclass(frozen=True, slots=True)
class Wall:
    distance_m: float
    corners: np.ndarray


def wall(shift: float = 0.0) -> Wall:
    return Wall(2.5, np.arange(6.0).reshape(2, 3) + shift)


def test_copies_have_the_same_fingerprint() -> None:
    assert fingerprint(wall(), "a", (1, None)) == fingerprint(pickle.loads(pickle.dumps(wall())), "a", [1, None])
    turned = Wall(2.5, np.asfortranarray(wall().corners))
    assert fingerprint(turned) == fingerprint(wall()), "the order in memory is no content"
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})


def test_other_contents_have_another_fingerprint() -> None:
    values: list[tuple[object, ...]] = [
        (wall(),), (wall(1e-12),), (Wall(2.25, wall().corners),), (wall(), wall()), ([wall(), wall()],),
        ("ab", "c"), ("a", "bc"), ("abc",), (b"abc",), (1,), (1.0,), (True,), ("1",), (None,), ("None",), (),
        (np.zeros(4),), (np.zeros((2, 2)),), (np.zeros(4, np.float32),), (np.zeros(4, np.int64),),
        ({"a": 1},), ((("a", 1),), 0), (fingerprint,), (wall,),
    ]  # fmt: skip
    assert len({fingerprint(*one) for one in values}) == len(values)


def test_another_process_finds_the_same() -> None:
    program = (
        "from room_layout_ros.learning.fingerprint import fingerprint; print(fingerprint('a', 1.5, {'x': (1, 2)}))"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120)
    assert told.stdout.strip() == fingerprint("a", 1.5, {"x": (1, 2)})


def test_what_has_no_contents_to_look_at_is_refused() -> None:
    with pytest.raises(TypeError, match="a object has no fingerprint"):
        fingerprint(object())
