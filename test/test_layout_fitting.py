"""Fitted layouts against truth: rendered rooms, the hand-made layouts of NYU, and what must be refused."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import FRONT_WALL
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import BadFrame, DataError, FramesFolder, FrameTruth, Sample, open_folder
from room_layout_ros.datasets.synthetic import NOISES, random_pose, random_scene, render
from room_layout_ros.evaluation.measures import score_pixels
from room_layout_ros.learning.fit_frame import FITS_FILE, FitJob, accepted, fit_item, read_fits
from room_layout_ros.learning.layout_fitting import LayoutFit, fit_layout

CAMERA = CameraIntrinsics(320, 240, 260.0, 260.0, 159.5, 119.5)


@lru_cache(maxsize=32)
def view(seed: int, noise: str = "clean", kind: str = "cuboid") -> Sample:
    room = random_scene(np.random.default_rng(seed), kind)
    pose = random_pose(room, np.random.default_rng(seed + 50))
    return render(room, CAMERA, pose, NOISES[noise], np.random.default_rng(seed), name=f"{seed:04d}")


def truth_of(sample: Sample) -> FrameTruth:
    assert sample.truth is not None
    return sample.truth


def fitted(sample: Sample) -> LayoutFit:
    labels40 = truth_of(sample).labels40
    assert labels40 is not None
    fit = fit_layout(sample.frame, labels40)
    assert fit is not None
    return fit


@lru_cache(maxsize=32)
def fitted_view(seed: int, noise: str = "clean") -> LayoutFit:
    return fitted(view(seed, noise))


def layout_error(sample: Sample, fit: LayoutFit) -> float:
    layout = truth_of(sample).layout
    assert layout is not None
    return score_pixels(layout, fit.layout).layout_error


@pytest.mark.parametrize(("noise", "mean", "worst"), [("clean", 0.01, 0.03), ("nyu8", 0.03, 0.08)])
def test_rendered_rooms_are_found_behind_their_furniture(noise: str, mean: float, worst: float) -> None:
    errors = [layout_error(view(seed, noise), fitted_view(seed, noise)) for seed in range(8)]
    assert np.mean(errors) < mean
    assert max(errors) < worst


def test_planes_are_metric() -> None:
    for seed in range(4):
        fit, truth = fitted_view(seed), truth_of(view(seed)).cuboid
        assert truth is not None
        mine, true = planes(fit.cuboid), planes(truth)
        for normal, distance in mine:
            nearest = max(true, key=lambda plane: float(plane[0] @ normal))
            assert float(nearest[0] @ normal) > np.cos(np.deg2rad(1.5))
            assert distance == pytest.approx(nearest[1], abs=0.08)


def planes(cuboid: RoomCuboid) -> list[tuple[np.ndarray, float]]:
    inverse = cuboid.inverse_normals
    lengths = np.linalg.norm(inverse, axis=1)
    return [(inverse[k] / lengths[k], 1.0 / lengths[k]) for k in range(5) if lengths[k] > 0]


def test_the_front_wall_faces_the_camera_most() -> None:
    for seed in range(8):
        fit = fitted_view(seed)
        walls = [k for k in (2, 3, 4) if (fit.layout == k + 1).any()]
        facing = {k: fit.cuboid.inverse_normals[k][2] * fit.cuboid.distances[k] for k in walls}
        assert max(facing, key=lambda k: facing[k]) + 1 == FRONT_WALL


@lru_cache(maxsize=64)
def hand_made(data_root: Path, name: str) -> tuple[float, bool]:
    """Return the error of the fit of a frame of NYU against its layout made by hand, and whether it is accepted."""
    sample = nyu_with_layouts(data_root).read(name)
    fit = fitted(sample)
    return layout_error(sample, fit), accepted(FitJob(), fit)


def test_hand_made_layouts_are_met(data_root: Path) -> None:
    errors = [hand_made(data_root, name)[0] for name in nyu_with_layouts(data_root).names[::3]]
    assert len(errors) == 13
    assert np.median(errors) < 0.04
    assert np.mean(errors) < 0.08


@pytest.mark.slow
def test_all_hand_made_layouts_are_met(data_root: Path) -> None:
    fits = [hand_made(data_root, name) for name in nyu_with_layouts(data_root).names]
    errors, usable = np.array([error for error, _ in fits]), [good for _, good in fits]
    assert len(errors) == 37
    assert np.mean(errors) < 0.055
    assert sum(usable) >= 30
    assert np.mean(errors[usable]) < 0.05


@lru_cache(maxsize=1)
def nyu_with_layouts(data_root: Path) -> FramesFolder:
    folder = open_folder(data_root / "nyuv2")
    return folder.subset(tuple(sorted(p.stem for p in (folder.path / "layout").glob("*.png"))))


def test_what_is_no_cuboid_or_shows_no_structure_is_not_accepted() -> None:
    sample = view(3)
    labels40 = truth_of(sample).labels40
    assert labels40 is not None
    assert fit_layout(sample.frame, np.full_like(labels40, 5)) is None
    shuffled = np.random.default_rng(1).permutation(labels40.ravel()).reshape(labels40.shape)
    nonsense = Sample(sample.frame, FrameTruth(labels40=shuffled))
    assert fit_item(FitJob(), sample).line["accepted"] is True
    assert fit_item(FitJob(), nonsense).line["accepted"] is False


def test_missing_depth_and_wrong_labels_are_refused() -> None:
    sample = view(3)
    labels40 = truth_of(sample).labels40
    assert labels40 is not None
    with pytest.raises(ValueError, match="no depth"):
        fit_layout(sample.frame.without_depth(), labels40)
    with pytest.raises(ValueError, match="frame"):
        fit_layout(sample.frame, labels40[:100])
    unlabelled = replace(sample, truth=None)
    assert "labels40" in fit_item(FitJob(), unlabelled).line["error"]
    assert fit_item(FitJob(), BadFrame("0001", "cut")).line["error"] == "cut"


def test_depth_with_holes_is_fitted() -> None:
    sample = view(2)
    depth_m = np.array(sample.frame.depth_m)
    depth_m[:, ::3] = np.nan
    depth_m[60:120] = 0.0
    frame = RgbdFrame(CAMERA, sample.frame.color, depth_m.astype(np.float32))
    holed = Sample(frame, sample.truth)
    assert layout_error(holed, fitted(holed)) < layout_error(sample, fitted(sample)) + 0.03


def test_the_file_of_fits_is_read_back(tmp_path: Path) -> None:
    lines = [fit_item(FitJob(), view(seed)).line for seed in (1, 3)]
    rejected = {**lines[0], "name": "rejected", "accepted": False}
    (tmp_path / FITS_FILE).write_text("".join(json.dumps(line) + "\n" for line in [*lines, rejected]))
    rooms = read_fits(tmp_path)
    assert set(rooms) == {"0001", "0003"}
    same = rooms["0003"].raster(CAMERA) == fitted_view(3).layout
    assert same.mean() > 0.995, "digits in the file are rounded"
    (tmp_path / FITS_FILE).write_text('{"name": "x", "accepted": true}\n')
    with pytest.raises(DataError, match="line 1"):
        read_fits(tmp_path)
    with pytest.raises(DataError, match="room-layout fit"):
        read_fits(tmp_path / "nowhere")
