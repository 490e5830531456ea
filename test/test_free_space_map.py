"""`room-layout estimate --free-space`: maps that Nav2's map_server reads as the grid that was found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from room_layout_ros.cli import main
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.datasets import good_samples, open_source
from room_layout_ros.datasets.convert import copy_frames
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("walk") / "frames"
    copy_frames(SyntheticSource(2, 1), FolderWriter(path))
    return path


def loaded(file: Path) -> tuple[NDArray[np.int8], dict[str, Any]]:
    """What nav2_map_server's loadMapFromFile makes of a map in the mode trinary: OccupancyGrid rows, and the YAML."""
    said = yaml.safe_load(file.read_text())
    assert (said["mode"], said["negate"]) == ("trinary", 0)
    image = cv2.imread(str(file.parent / said["image"]), cv2.IMREAD_UNCHANGED)
    assert image is not None
    dark = 1.0 - image[::-1] / 255.0  # its first row is the last of the grid
    grid = np.where(dark >= said["occupied_thresh"], 100, np.where(dark <= said["free_thresh"], 0, -1))
    return grid.astype(np.int8), said


def test_the_maps_are_the_grids_of_the_frames(walk: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["estimate", str(walk), "--out", str(out), "--free-space"]) == 0
    estimator = LayoutEstimator(EstimatorConfig(joint_bound=True))
    for sample in good_samples(open_source(walk)):
        space = free_space_of_frame(sample.frame, estimator.estimate(sample.frame), estimator.config)
        assert space is not None
        grid, said = loaded(out / "free_space" / f"{sample.name}.yaml")
        np.testing.assert_array_equal(grid, space.grid)
        assert {-1, 0, 100} <= set(np.unique(grid).tolist())
        assert said["resolution"] == space.resolution_m
        assert said["origin"] == [*space.origin_m, 0.0]
    assert main(["estimate", str(walk), "--out", str(out)]) == 0
    assert not (out / "free_space").exists(), "the next estimate replaces it"


@pytest.mark.parametrize("words", (["--rgb-only"], ["--set", "use_depth=false"]))
def test_without_depth_there_is_none_to_write(
    words: list[str], walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(walk), "--out", str(tmp_path / "out"), "--free-space", *words]) == 2
    assert "--free-space needs depth" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
