"""A step or a flight of stairs before the camera: what lies beyond the edge is never free."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from furnished import CONFIG, empty
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.floor.floor_frame import floor_frame, walls_on_floor
from room_layout_ros.core.floor.floor_level import level_of_camera
from room_layout_ros.core.floor.floor_plane import FloorPlane, fit_floor
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import FREE_CELL, FreeSpace, compute_free_space
from room_layout_ros.core.labels import CLUTTER, FLOOR
from room_layout_ros.datasets.synthetic import KINECT, NOISES, camera_pose, render
from room_layout_ros.datasets.synthetic.noise import sense_depth

STAIRS = (0.17, 0.28)
"""Rise and tread of a step."""

VIEWS = [(1.5, 0.5, -0.25), (2.0, 0.9, -0.3), (1.5, 1.2, -0.35), (2.0, 1.2, -0.35)]
"""Distance of the edge, height of the camera, pitch."""

CASES = [
    *product([0.1, 0.15, 0.3, 0.75, 0.0], ["clean", "kinect", "stereo"]),
    *product([0.06, -0.06, -0.1, -0.14], ["clean", "kinect"]),
]
"""Drop in m (below 0: a step up; 0: stairs), and kind of noise. By stereo noise 6 cm at 3 m are no step."""

MOST_BEYOND = {"clean": 0, "kinect": 0, "stereo": 25}
"""Free cells beyond the edge: the foot of the wall there looks like floor by stereo noise."""


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator(CONFIG)


def before_a_drop(view: tuple[float, float, float], drop_m: float, noise: str) -> tuple[RgbdFrame, NDArray[np.float64]]:
    """The frame, walls going on downwards, and the true direction of gravity; a drop of 0 m stands for stairs, one
    below 0 for a step up.
    """
    edge, height, pitch = view
    pose = camera_pose(-1.4, 0.0, height, 0.0, pitch)
    sample = render(empty(), KINECT, pose)
    truth = sample.truth
    assert truth is not None
    assert truth.down_camera is not None
    assert truth.normal is not None
    assert sample.frame.depth_m is not None
    T = floor_frame(truth.down_camera, height)
    rays, depth = KINECT.rays() @ T[:3, :3], sample.frame.depth_m
    place = rays * depth[..., None] - T[:3, 3] @ T[:3, :3]
    below = (np.abs(place[..., 2]) < 0.01) & (place[..., 0] > edge)
    if drop_m:
        lower = depth * (1 + drop_m / height)
        lower = np.where(below & (rays[..., 0] * lower < edge), edge / np.maximum(rays[..., 0], 1e-6), lower)
    else:
        lower = np.full(depth.shape, np.inf)
        for k in range(12, -1, -1):
            step = depth * (1 + STAIRS[0] * (k + 1) / height)
            lower = np.where(rays[..., 0] * step <= (edge + STAIRS[1] * (k + 1) if k < 12 else np.inf), step, lower)
    for a, b, c, _ in walls_on_floor(truth.cuboid, T):
        towards = a * rays[..., 0] + b * rays[..., 1]
        lower = np.where(towards > 1e-6, np.minimum(lower, c / np.maximum(towards, 1e-6)), lower)
    depth = np.where(below, lower, depth).astype(np.float32)
    color = render(empty(), KINECT, pose, NOISES[noise], np.random.default_rng(1)).frame.color
    assert color is not None
    flat = np.zeros(depth.shape, np.uint8)
    sensed = sense_depth(depth, truth.normal, flat, color, KINECT, NOISES[noise], np.random.default_rng(9))
    return replace(sample.frame, depth_m=sensed, color=color), truth.down_camera


def free_of(
    estimator: LayoutEstimator,
    frame: RgbdFrame,
    floor: FloorPlane | None,
    edge: float,
    config: EstimatorConfig = CONFIG,
) -> tuple[FreeSpace | None, int, int]:
    """The free space, its free cells more than 15 cm before the edge, and more than 15 cm beyond it."""
    geometry = compute_depth_geometry(frame, config)
    assert geometry is not None
    found = compute_free_space(geometry, estimator.estimate(frame), config, floor, color=frame.color)
    if found is None:
        return None, 0, 0
    free = found.grid == FREE_CELL
    at = round(edge / found.resolution_m)
    return found, int(free[:, : at - 3].sum()), int(free[:, at + 3 :].sum())


@pytest.mark.parametrize(("drop_m", "noise"), CASES)
def test_a_given_floor_is_kept_and_what_lies_below_it_is_not_free(
    estimator: LayoutEstimator, drop_m: float, noise: str
) -> None:
    for view in VIEWS:
        frame, down = before_a_drop(view, drop_m, noise)
        found, before, beyond = free_of(estimator, frame, FloorPlane(down, view[1], "tf"), view[0])
        assert found is not None
        assert abs(found.camera_height_m - view[1]) < 0.02, f"{view}"
        assert before > 50, f"{view}"
        assert beyond <= MOST_BEYOND[noise], f"{view}"


@pytest.mark.parametrize("pitch_deg", [2.0, -2.0])
@pytest.mark.parametrize("drop_m", [0.0, 0.3, 0.75])
def test_before_a_drop_a_pose_that_lags_keeps_the_floor_on_which_the_robot_stands(
    estimator: LayoutEstimator, drop_m: float, pitch_deg: float
) -> None:
    """A robot brakes, and TF is 2 degrees late; the label of floor goes to the lower level."""
    c, s = np.cos(np.deg2rad(pitch_deg)), np.sin(np.deg2rad(pitch_deg))
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    for view in VIEWS:
        frame, down = before_a_drop(view, drop_m, "kinect")
        found, before, beyond = free_of(estimator, frame, FloorPlane(turn @ down, view[1], "tf"), view[0])
        assert found is not None
        assert found.source == "tf+depth", f"{view}"
        assert found.T_camera_floor[:3, 2] @ down < -np.cos(np.deg2rad(0.5)), f"{view}"
        assert before > 50, f"{view}"
        assert beyond == 0, f"{view}"


@pytest.mark.parametrize(("drop_m", "noise"), CASES)
def test_without_a_given_floor_it_is_the_nearer_level_or_none(
    estimator: LayoutEstimator, drop_m: float, noise: str
) -> None:
    for view in VIEWS:
        frame, _ = before_a_drop(view, drop_m, noise)
        found, _, beyond = free_of(estimator, frame, None, view[0])
        assert found is None or abs(found.camera_height_m - view[1]) < 0.03, f"{view}"
        assert beyond <= MOST_BEYOND[noise], f"{view}"


@pytest.mark.parametrize("drop_m", [0.1, 0.06, -0.1])
def test_an_exact_height_tells_a_step_of_which_only_the_far_level_is_in_view(
    estimator: LayoutEstimator, drop_m: float
) -> None:
    edge, height, _ = view = (1.3, 1.4, -0.2)
    frame, down = before_a_drop(view, drop_m, "kinect")
    given = FloorPlane(down, height, "tf")
    found, _, beyond = free_of(estimator, frame, given, edge, replace(CONFIG, floor_tolerance_m=0.04))
    assert found is not None
    assert (found.camera_height_m, beyond) == (height, 0)
    corrected, _, beyond = free_of(estimator, frame, given, edge)
    assert corrected is not None
    assert abs(corrected.camera_height_m - height - drop_m) < 0.01
    assert beyond > 1000


def test_a_start_that_few_pixels_in_a_line_support_is_kept() -> None:
    frame, down = before_a_drop((2.0, 1.2, -0.35), 0.3, "clean")
    geometry = compute_depth_geometry(frame, CONFIG)
    assert geometry is not None
    line = np.zeros_like(geometry.inverse_depth)
    line[400:404] = geometry.inverse_depth[400]
    estimate = replace(LayoutEstimator(CONFIG).estimate(frame), labels=np.full(line.shape, FLOOR, np.uint8))
    fit = fit_floor(replace(geometry, inverse_depth=line), estimate, CONFIG, FloorPlane(down, 1.2, "tf"))
    assert fit is not None
    assert abs(fit.distance_m - 1.2) < 0.02


class TestLevelOfCamera:
    """Floor at 1.5 m, and from row 380 on a level surface 0.3 or 0.7 m higher, 90 % of the picture wide."""

    intrinsics = (525.0, 525.0, 319.5, 239.5)
    plane = np.array([0.0, 1.0, 0.0]) / 1.5

    def look(self, height_m: float, label: int, color: int, wide: int = 640) -> float:
        rows = np.arange(480)[:, None]
        slope = np.repeat(np.maximum(rows - 239.5, 0.0) / 525.0, 640, axis=1)
        inverse = (slope / 1.5).astype(np.float32)
        labels, picture = np.full((480, 640), FLOOR, np.uint8), np.full((480, 640, 3), 100, np.uint8)
        inverse[380:, :wide] = slope[380:, :wide] / (1.5 - height_m)
        labels[380:, :wide], picture[380:, :wide] = label, color
        return level_of_camera(inverse, labels, picture, self.intrinsics, self.plane)

    @pytest.mark.parametrize("rows", [480, 120, 96, 95, 94, 90, 72, 61, 60, 47, 46, 24, 17, 14])
    def test_nearer_floor_is_the_level_however_few_the_rows(self, rows: int) -> None:
        """Camera 0.8 m over a floor that fills the lower third; the plane is that of one 0.3 m below."""
        v, focal, down = np.arange(rows) - 0.5 * rows, 1.07 * rows, np.array([0.0, np.cos(0.35), np.sin(0.35)])
        fall = np.maximum(down[1] * v / focal + down[2], 0.0)
        inverse = np.where(np.arange(rows) >= 0.67 * rows, fall / 0.8, fall / 1.1)
        picture = np.repeat(inverse.astype(np.float32)[:, None], 160, axis=1)
        labels = np.full(picture.shape, FLOOR, np.uint8)
        level_m = level_of_camera(picture, labels, None, (focal, focal, 79.5, 0.5 * rows), down / 1.1)
        assert level_m == pytest.approx(0.3, abs=0.051)

    @pytest.mark.parametrize(
        ("rise_m", "higher"), [(0.0, False), (0.08, False), (0.095, False), (0.105, True), (0.12, True)]
    )
    def test_a_level_from_ten_centimetres_on_is_another(self, rise_m: float, higher: bool) -> None:
        assert (self.look(rise_m, FLOOR, 100) > 0.0) == higher

    def test_a_floor_alone_is_the_level(self) -> None:
        assert self.look(0.0, FLOOR, 100) == 0.0

    def test_nearer_floor_above_the_plane_is_the_level(self) -> None:
        assert self.look(0.32, FLOOR, 100) == pytest.approx(0.32, abs=0.05)

    def test_clutter_that_looks_like_the_floor_may_be_it(self) -> None:
        assert np.isnan(self.look(0.3, CLUTTER, 100))

    def test_clutter_of_another_colour_is_furniture(self) -> None:
        assert self.look(0.3, CLUTTER, 200) == 0.0

    def test_where_floor_is_seen_beside_it_as_near_it_is_furniture(self) -> None:
        assert self.look(0.7, CLUTTER, 100, wide=300) == 0.0
        assert np.isnan(self.look(0.3, CLUTTER, 100, wide=500)), "a kerb"
