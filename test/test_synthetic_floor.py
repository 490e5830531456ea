"""The true floor map: no cell is called free where something stands."""

from __future__ import annotations

import numpy as np
import pytest
from naive_synthetic import stands_in_cell

from room_layout_ros.datasets.synthetic import KINDS, camera_pose, floor_map, random_pose, random_scene
from room_layout_ros.datasets.synthetic.floor import rug_height
from room_layout_ros.datasets.synthetic.room import SyntheticRoom
from room_layout_ros.datasets.synthetic.shapes import Material, Solid


@pytest.mark.parametrize("kind", KINDS)
def test_cells_equal_their_naive_twin(kind: str, rng: np.random.Generator) -> None:
    room = random_scene(np.random.default_rng(2), kind, small_objects=5)
    pose = random_pose(room, np.random.default_rng(4))
    truth = floor_map(room, pose)
    forward = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
    right = np.array([forward[1], -forward[0]])
    differing = 0
    for i, j in zip(rng.integers(0, 120, 150), rng.integers(0, 120, 150), strict=True):
        f, r = truth.origin_forward_m + i * truth.cell_m, truth.origin_right_m + j * truth.cell_m
        square = [(f, r), (f + truth.cell_m, r), (f + truth.cell_m, r + truth.cell_m), (f, r + truth.cell_m)]
        corners = np.array([pose[:2, 3] + a * forward + b * right for a, b in square])
        naive = stands_in_cell(room, corners)
        assert not (naive and truth.cells[i, j] == 0), "called free, but something stands there"
        differing += naive != bool(truth.cells[i, j])
    assert differing <= 5, "only slivers that fall between the samples of the naive twin may differ"
    assert 0.05 < truth.cells.mean() < 0.999


def boxed(top: float, bottom: float = 0.0) -> SyntheticRoom:
    room = random_scene(np.random.default_rng(0), furniture=0.0, decorate=False)
    return room.furnished((Solid(0.5, 0.0, 0.0, 0.06, 0.06, bottom, top, 40, Material((9, 9, 9)), thing=0),))


def test_small_things_count_and_what_hangs_high_does_not() -> None:
    pose = camera_pose(-0.5, 0.0, 1.2, 0.0)
    ahead = (20, 60)  # 1.0 m forward, 0 m to the side
    assert floor_map(boxed(0.03), pose).cells[ahead] == 1
    assert floor_map(boxed(0.03), pose).height_m[ahead] == np.float32(0.03)
    assert floor_map(boxed(2.4, bottom=2.1), pose).cells[ahead] == 0
    assert floor_map(boxed(0.8, bottom=0.7), pose, highest_m=0.5).cells[ahead] == 0


def test_forward_and_right_are_the_cameras() -> None:
    """A box to the right of a camera that looks along +y lies at larger x."""
    truth = floor_map(boxed(0.5), camera_pose(0.0, 0.0, 1.0, np.pi / 2))
    assert truth.cells[0, 70] == 1
    assert truth.cells[0, 50] == 0


def test_what_stands_on_a_rug_stands_on_its_top() -> None:
    rug = Solid(0.5, 0.0, 0.5, 1.0, 0.4, 0.0, 0.008, 20, Material((90, 90, 90)))
    room = random_scene(np.random.default_rng(0), furniture=0.0, decorate=False).furnished((rug,))
    assert rug_height(room, 0.5, 0.0) == 0.008
    assert rug_height(room, 0.5 + 0.4 * np.cos(0.5), 0.4 * np.sin(0.5)) == 0.008
    assert rug_height(room, 0.5, 0.4) == 0.0
