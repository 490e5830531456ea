"""The real corridor is 2.15 m wide: measured on the floor, over all frames that show the foot of both walls."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks._floor_width import floor_width
from benchmarks.corridor_width import EMPTY, IN_VIEW, is_right, measure
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import FREE_CELL, compute_free_space
from room_layout_ros.datasets import good_samples, open_folder

STEP = 7


def test_width_is_right_in_both_legs_and_the_floor_ahead_of_the_first_is_free(data_root: Path) -> None:
    """A frame without a width counts as wrong."""
    if not (data_root / "corridor").is_dir():
        pytest.skip(f"no corridor in {data_root}")
    folder = open_folder(data_root / "corridor")
    config = EstimatorConfig()
    estimator = LayoutEstimator(config)
    numbers = [i for first, last in IN_VIEW for i in range(first, last + 1, STEP)]
    names = sorted(folder.names)
    right = {}
    for sample in good_samples(folder.subset(tuple(names[i] for i in numbers))):
        geometry = compute_depth_geometry(sample.frame, config)
        assert geometry is not None
        estimate = estimator.estimate(sample.frame)
        result = compute_free_space(geometry, estimate, config, color=sample.frame.color)
        assert result is not None
        right[int(sample.name)] = is_right(floor_width(geometry, result))
        if 36 <= int(sample.name) < 80:
            ahead = result.grid[result.grid.shape[0] // 2 - 6 : result.grid.shape[0] // 2 + 6, 44:70]
            assert (ahead == FREE_CELL).mean() > 0.9, f"the floor of the corridor is free ahead in {sample.name}"
    assert len(right) == len(numbers) == 22
    assert sum(right.values()) >= 0.95 * len(right)


def test_on_the_empty_floor_of_the_first_leg_few_cells_are_occupied(data_root: Path) -> None:
    """The camera's depth comes in steps of which most lie on the floor: they are its noise."""
    if not (data_root / "corridor").is_dir():
        pytest.skip(f"no corridor in {data_root}")
    folder, estimator = open_folder(data_root / "corridor"), LayoutEstimator()
    names = tuple(sorted(folder.names)[EMPTY[0] : EMPTY[1] + 1 : 4])
    occupied = [measure(estimator, sample.frame)[1] for sample in good_samples(folder.subset(names))]
    assert len(occupied) == 16
    assert sum(occupied) <= 2 * len(occupied)
