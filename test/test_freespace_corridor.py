"""The real corridor is 2.15 m wide: measured on the floor, in frames that show the foot of both walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import FREE_CELL, compute_free_space
from room_layout_ros.datasets import good_samples, open_folder
from room_layout_ros.evaluation.free_space import floor_width


def test_width_and_free_floor_of_the_first_leg(data_root: Path) -> None:
    if not (data_root / "corridor").is_dir():
        pytest.skip(f"no corridor in {data_root}")
    folder = open_folder(data_root / "corridor")
    config = EstimatorConfig()
    estimator = LayoutEstimator(config)
    widths = []
    for sample in good_samples(folder.subset(tuple(sorted(folder.names)[36:80:7]))):
        geometry = compute_depth_geometry(sample.frame, config)
        assert geometry is not None
        estimate = estimator.estimate(sample.frame)
        result = compute_free_space(geometry, estimate, config)
        assert result is not None
        widths.append(floor_width(estimate, result))
        ahead = result.grid[result.grid.shape[0] // 2 - 6 : result.grid.shape[0] // 2 + 6, 44:70]
        assert (ahead == FREE_CELL).mean() > 0.9, f"the floor of the corridor is free ahead in {sample.name}"
    assert len(widths) == 7
    assert np.all(np.abs(np.array(widths) - 2.15) < 0.10)
