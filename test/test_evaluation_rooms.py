"""Rooms in metres and degrees: scores of predictions made by hand, of fits, and of rendered rooms."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks._planes import Planes
from room_layout_ros.cli import main as room_layout
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import Status, no_estimate
from room_layout_ros.core.floor.scan import RangeScan
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, FreeSpace
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import FloorMap, FrameTruth, Sample, good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.datasets.writers import FolderWriter
from room_layout_ros.evaluation.compare import EstimatorMethod
from room_layout_ros.evaluation.floor_truth import called_free, truly_free
from room_layout_ros.evaluation.prediction import Prediction
from room_layout_ros.evaluation.room_scores import score_room
from room_layout_ros.evaluation.scores import ROOM_FIGURES, FrameScore, run, score_frame

CAMERA = CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
ROOM = RoomCuboid(np.eye(3), np.array([1.0, 1.2, 1.5, 3.0, np.inf]))

pytestmark = pytest.mark.usefixtures("few_draws")


def sample_of(room: RoomCuboid | None) -> Sample:
    layout = ROOM.raster(CAMERA)
    return Sample(RgbdFrame(CAMERA, None, ROOM.depth(CAMERA)), FrameTruth(layout, cuboid=room))


def prediction_of(room: RoomCuboid | None, status: str = "ok", metric: bool = True) -> Prediction:
    layout = ROOM.raster(CAMERA)
    return Prediction(layout, layout, cuboid=room, status=status, metric=metric)


def turned(degrees: float, distances: list[float]) -> RoomCuboid:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return RoomCuboid(np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]), np.array(distances))


def test_the_true_room_has_no_error() -> None:
    score = score_room(sample_of(ROOM), prediction_of(ROOM))
    assert (score.plane_offset_m, score.plane_angle_deg, score.planes_found) == (0, 0, 1)
    assert score.axes_error_deg == pytest.approx(0, abs=1e-5)
    assert score.room_iou == pytest.approx(1)


def test_offsets_and_angles_are_means_over_the_planes_that_both_have() -> None:
    # Offsets 0.1, 0 and 0.3 of ceiling, floor and front; the left wall is missing, a right one was invented.
    room = turned(6, [1.1, 1.2, np.inf, 3.3, 2.0])
    score = score_room(sample_of(ROOM), prediction_of(room))
    assert score.plane_offset_m == pytest.approx(0.4 / 3)
    assert score.plane_angle_deg == pytest.approx(6 / 3)
    assert score.planes_found == pytest.approx(3 / 4)
    assert score.axes_error_deg == pytest.approx(6)
    assert 0.5 < score.room_iou < 0.95


def test_a_room_without_scale_is_scored_in_degrees_only() -> None:
    score = score_room(sample_of(ROOM), prediction_of(turned(6, [0.4, 0.4, 0.5, 1.0, np.inf]), metric=False))
    assert np.isnan([score.plane_offset_m, score.room_iou]).all()
    assert score.plane_angle_deg == pytest.approx(6 / 2)
    assert score.planes_found == 1


def test_a_failed_frame_has_found_nothing_but_a_method_without_rooms_is_not_blamed() -> None:
    failed = score_room(sample_of(ROOM), prediction_of(None, "no room in view"))
    assert (failed.planes_found, failed.room_iou) == (0, 0)
    silent = score_room(sample_of(ROOM), prediction_of(None))
    assert np.isnan([silent.planes_found, silent.room_iou]).all()
    unknown = score_room(sample_of(None), prediction_of(ROOM))
    assert np.isnan([unknown.planes_found, unknown.axes_error_deg]).all()


def test_planes_have_the_wall_names_of_the_true_room_and_not_of_a_layout_drawn_otherwise() -> None:
    """Whoever drew the layout called the left wall front, the front one right; the fitted room has names of its own."""
    drawn = np.array([0, 1, 2, 4, 5, 3], np.uint8)[ROOM.raster(CAMERA)]
    sample = replace(sample_of(ROOM), truth=FrameTruth(drawn, cuboid=ROOM))
    same_with_other_names = turned(-90, [1.0, 1.2, np.inf, 1.5, 3.0])
    for room in (ROOM, same_with_other_names):
        found = replace(prediction_of(room), layout=room.raster(CAMERA))
        score = score_frame(sample, found)
        assert score.pixels.layout_error == 0
        assert score.room.planes_found == 1
        assert score.room.plane_offset_m == pytest.approx(0)
        assert score.room.plane_angle_deg == pytest.approx(0, abs=1e-5)


def test_the_benchmarks_planes_have_these_names_too() -> None:
    drawn = np.array([0, 1, 2, 4, 5, 3], np.uint8)[ROOM.raster(CAMERA)]
    sample = replace(sample_of(ROOM), truth=FrameTruth(drawn, cuboid=ROOM))
    planes, nothing = Planes(), no_estimate(Status.OK, sample.frame, {})
    planes.add(sample, replace(nothing, cuboid=ROOM, layout=ROOM.raster(CAMERA)))
    assert planes.offsets_m == [0, 0, 0, 0]
    assert planes.angles_deg == pytest.approx([0, 0, 0, 0], abs=1e-5)


def free_space(grid: np.ndarray, origin_m: tuple[float, float], size: float) -> FreeSpace:
    scan = RangeScan(0.0, 0.1, np.zeros(1, np.float32))
    none = np.empty((0, 3), np.float32)
    return FreeSpace(grid, size, origin_m, np.eye(4), 1.0, "", none, none, scan, np.empty((0, 4)), np.empty((0, 2)))


def test_called_cells_are_read_where_the_floor_map_has_them() -> None:
    floor_map = FloorMap(np.zeros((4, 6), np.uint8), np.zeros((4, 6), np.float32), 0.5, 0.0, -1.5)
    grid = np.full((6, 4), OCCUPIED_CELL, np.int8)  # rows to the left, columns ahead
    grid[0, 3] = FREE_CELL  # y in -1.5..-1.0: to the right; x in 1.5..2.0
    found = called_free(free_space(grid, (0.0, -1.5), 0.5), floor_map)
    assert np.argwhere(found).tolist() == [[3, 5]]
    shifted = called_free(free_space(grid, (-0.5, -1.0), 0.5), floor_map)
    assert np.argwhere(shifted).tolist() == [[2, 4]]
    assert not called_free(None, floor_map).any()


@pytest.fixture(scope="module")
def rooms() -> list[Sample]:
    return list(good_samples(SyntheticSource(frames=3, seed=5, walk=False, noise="clean")))


def test_true_free_cells_are_in_sight_and_nothing_stands_in_them(rooms: list[Sample]) -> None:
    for sample in rooms:
        free = truly_free(sample)
        assert free is not None
        assert sample.truth is not None
        assert sample.truth.floor_map is not None
        assert free.any()
        assert not (free & (sample.truth.floor_map.cells > 0)).any()
        assert not free[0, [0, -1]].any()  # beside the camera: out of view
    assert truly_free(replace(rooms[0], T_world_camera=None)) is None


def test_the_estimator_is_right_on_clean_rooms_in_every_figure_and_rgb_without_metres(rooms: list[Sample]) -> None:
    found = run("ours", EstimatorMethod(EstimatorConfig()), rooms).figures
    assert found["plane_offset_m"].value < 0.05
    assert found["plane_angle_deg"].value < 1
    assert found["axes_error_deg"].value < 1
    assert found["planes_found"].value > 0.9
    assert found["room_iou"].value > 0.95
    assert found["free_space_iou"].value > 0.6
    without = run("rgb", EstimatorMethod(EstimatorConfig(), rgb_only=True), rooms).figures
    assert np.isfinite(without["axes_error_deg"].value)
    assert np.isnan([without[name].value for name in ("plane_offset_m", "room_iou", "free_space_iou")]).all()


def frame_scores(sample: Sample, method: Any) -> FrameScore:
    return run("", method, [sample]).frames[0]


def test_a_floor_called_free_everywhere_or_nowhere_scores_less_than_the_true_one(rooms: list[Sample]) -> None:
    sample, layout = rooms[0], np.ones((480, 640), np.uint8)
    true = truly_free(sample)
    assert true is not None
    ious = [
        frame_scores(sample, lambda _, cells=cells: Prediction(layout, layout, free_floor=cells)).room.free_space_iou
        for cells in (true, np.ones_like(true), np.zeros_like(true))
    ]
    assert ious[0] == 1
    assert 0 < ious[1] < 0.8
    assert ious[2] == 0


@pytest.fixture(scope="module")
def folder(rooms: list[Sample], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The rooms as a frames folder that has lost their cuboids and the layout of the last."""
    path = tmp_path_factory.mktemp("rooms") / "frames"
    with FolderWriter(path) as writer:
        for sample in rooms:
            writer.write(sample)
    (path / "layout" / f"{rooms[-1].name}.png").unlink()
    return path


def write_fits(path: Path, rooms: list[Sample]) -> None:
    path.mkdir()
    lines = []
    for sample in rooms:
        assert sample.truth is not None
        assert sample.truth.cuboid is not None
        R, distances = sample.truth.cuboid.R_room_camera, sample.truth.cuboid.distances
        values = [d if np.isfinite(d) else None for d in distances.tolist()]
        lines.append({"name": sample.name, "accepted": True, "axes": R.tolist(), "distances_m": values})
    (path / "fits.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_fits_are_rooms_to_measure_against_and_layouts_where_there_is_none(
    folder: Path, rooms: list[Sample], tmp_path: Path
) -> None:
    write_fits(tmp_path / "fits", rooms)
    arguments = ["evaluate", str(folder), "--baseline", "percentile", "--no-report", "--out"]
    assert room_layout([*arguments, str(tmp_path / "without")]) == 0
    assert room_layout([*arguments, str(tmp_path / "with"), "--fits", str(tmp_path / "fits")]) == 0
    without, found = (
        json.loads((tmp_path / out / "summary.json").read_text())["methods"]["ours, RGB-D"]
        for out in ("without", "with")
    )
    assert (without["frames"], found["frames"]) == (len(rooms) - 1, len(rooms))
    assert all(without[name] is None for name in ROOM_FIGURES)
    assert found["plane_offset_m"] < 0.05
    assert found["room_iou"] > 0.95
    assert found["layout_error"] < 0.05


def test_rooms_of_written_estimates_are_scored_as_if_estimated_now(
    folder: Path, rooms: list[Sample], tmp_path: Path
) -> None:
    write_fits(tmp_path / "fits", rooms)
    assert room_layout(["estimate", str(folder), "--out", str(tmp_path / "estimates")]) == 0
    common = ["evaluate", str(folder), "--fits", str(tmp_path / "fits"), "--baseline", "none", "--no-report"]
    assert room_layout([*common, "--out", str(tmp_path / "now")]) == 0
    assert room_layout([*common, "--out", str(tmp_path / "later"), "--estimates", str(tmp_path / "estimates")]) == 0
    now, later = (
        next(iter(json.loads((tmp_path / out / "summary.json").read_text())["methods"].values()))
        for out in ("now", "later")
    )
    for name in ("layout_error", "plane_offset_m", "plane_angle_deg", "planes_found", "axes_error_deg", "room_iou"):
        assert later[name] == pytest.approx(now[name], abs=1e-4)
