"""Large and small images are worked on at about one size, and give results of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, empty, with_truth
from naive_working_size import naive_enlarged_depth, naive_reduced_depth
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.core.picture import draw_overlay
from room_layout_ros.core.working_size import (
    original_of,
    resize_estimate,
    resize_frame,
    resize_keeping,
    resize_labels,
    restore_estimate,
    working_factors,
)
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import CLEAN, KINECT, NOISES, camera_pose, random_pose, random_scene, render
from room_layout_ros.evaluation.stages import look_at
from room_layout_ros.learning.working_sample import at_working_size
from room_layout_ros.node_config import NodeConfig
from room_layout_ros.scene import Scene

HD = CameraIntrinsics(1280, 720, 910.0, 910.0, 639.5, 359.5)
IMAGES = ("layout", "labels", "furniture", "superpixels")


def view(camera: CameraIntrinsics, yaw: float = 0.0) -> Sample:
    return render(empty(), camera, camera_pose(-1.4, 0.0, 1.2, yaw, -0.35), CLEAN)


def furnished(camera: CameraIntrinsics, seed: int, noise: str = "kinect") -> Sample:
    rng = np.random.default_rng(seed)
    room = random_scene(rng, "cuboid", furniture=0.6)
    return render(room, camera, random_pose(room, rng), NOISES[noise], rng)


@pytest.mark.parametrize(
    ("width", "height", "working", "factors"),
    [
        (640, 480, 640, (1, 1)), (848, 480, 640, (1, 1)), (1279, 720, 640, (1, 1)), (512, 424, 640, (1, 1)),
        (1280, 720, 640, (2, 1)), (720, 1280, 640, (2, 1)), (1920, 1080, 640, (3, 1)), (640, 480, 320, (2, 1)),
        (320, 240, 640, (1, 2)), (424, 240, 640, (1, 2)), (224, 172, 640, (1, 3)), (120, 160, 640, (1, 4)),
        (320, 240, 320, (1, 1)), (160, 120, 0, (1, 1)), (8192, 8192, 160, (51, 1)), (1280, 1, 640, (1, 1)),
        (5000, 3, 640, (3, 1)), (99, 75, 640, (1, 1)), (100, 75, 640, (1, 6)), (640, 480, 8192, (1, 12)),
    ],
)  # fmt: skip
def test_the_longer_side_is_about_the_working_size(
    width: int, height: int, working: int, factors: tuple[int, int]
) -> None:
    camera = CameraIntrinsics(width, height, 500.0, 500.0, 0.5 * width, 0.5 * height)
    assert working_factors(camera, working) == factors


def test_a_frame_of_that_size_is_itself() -> None:
    frame = view(KINECT).frame
    assert resize_frame(frame, 640) is frame
    estimate = with_truth(view(KINECT))
    assert resize_estimate(estimate, KINECT, 640) is estimate


@pytest.mark.parametrize("step", [2, 3, 5])
def test_depth_is_as_its_slow_twin_says(step: int) -> None:
    rng = np.random.default_rng(step)
    depth = (2.0 + rng.normal(0.0, 0.03, (61, 113)) + 1.5 * (rng.random((61, 113)) < 0.3)).astype(np.float32)
    for value in (np.nan, np.inf, -np.inf, 0.0, -1.0):
        depth[rng.random(depth.shape) < 0.15] = value
    depth[10:25, 20:40] = np.nan
    camera = CameraIntrinsics(113, 61, 60.0, 60.0, 56.0, 30.0)
    frame = RgbdFrame(camera, None, depth)
    small = resize_frame(frame, 113 // step)
    assert working_factors(camera, 113 // step) == (step, 1)
    assert small.depth_m is not None
    np.testing.assert_allclose(small.depth_m, naive_reduced_depth(depth, step), rtol=1e-6)
    assert np.isnan(small.depth_m).any()


@pytest.mark.parametrize("step", [2, 3, 4])
def test_enlarged_depth_is_as_its_slow_twin_says(step: int) -> None:
    rng = np.random.default_rng(step)
    ramp = 2.0 + 0.04 * np.arange(31)[:, None] + 0.02 * np.arange(101)
    depth = (ramp + rng.normal(0.0, 0.01, (31, 101)) + 1.5 * (rng.random((31, 101)) < 0.1)).astype(np.float32)
    for value in (np.nan, np.inf, 0.0, -1.0):
        depth[rng.random(depth.shape) < 0.03] = value
    camera = CameraIntrinsics(101, 31, 80.0, 80.0, 50.0, 15.0)
    large = resize_frame(RgbdFrame(camera, None, depth), 101 * step)
    assert (large.camera.width, large.camera.height) == (101 * step, 31 * step)
    assert large.depth_m is not None
    np.testing.assert_allclose(large.depth_m, naive_enlarged_depth(depth, step), rtol=1e-6)


def test_an_enlarged_plane_is_the_plane() -> None:
    """Inverse depth is affine on a plane; outside the centres of the outer pixels it cannot be known."""
    camera = CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
    sample = view(camera, 0.4)
    large = resize_frame(sample.frame, 640)
    direct = view(large.camera, 0.4).frame
    assert large.depth_m is not None
    assert direct.depth_m is not None
    off = np.abs(large.depth_m - direct.depth_m)[4:-4, 4:-4]
    assert np.quantile(off, 0.9) < 1e-3
    assert off.max() < 0.1


@pytest.mark.parametrize("camera", [HD, CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)])
def test_no_depth_lies_between_a_thing_and_the_wall_behind_it(camera: CameraIntrinsics) -> None:
    depth = np.full((camera.height, camera.width), 3.0, np.float32)
    depth[31:101, 41:91] = 1.5
    resized = resize_frame(RgbdFrame(camera, None, depth), 640).depth_m
    assert resized is not None
    assert set(np.unique(resized)) == {1.5, 3.0}


@pytest.mark.parametrize("step", [2, 3, 4, 6])
def test_depth_and_label_of_a_block_are_of_one_surface(step: int) -> None:
    """A thing on one row and column of each block, before a wall: a block labelled as the thing has its depth."""
    camera = CameraIntrinsics(160 * step, 120 * step, 130.0 * step, 130.0 * step, 80.0 * step, 60.0 * step)
    for row, column in np.ndindex(step, step):
        depth = np.full((camera.height, camera.width), 3.0, np.float32)
        labels = np.full(depth.shape, 4, np.uint8)
        depth[row::step], labels[row::step] = 1.5, 6
        depth[:, column::step], labels[:, column::step] = 1.5, 6
        reduced = resize_frame(RgbdFrame(camera, None, depth), 160).depth_m
        assert reduced is not None
        np.testing.assert_array_equal(reduced == 1.5, resize_labels(labels, camera, 160) == 6)


def test_depth_of_a_surface_loses_noise() -> None:
    rng = np.random.default_rng(0)
    depth = np.asarray(2.0 + rng.normal(0.0, 0.01, (720, 1280)), np.float32)
    reduced = resize_frame(RgbdFrame(HD, None, depth), 640).depth_m
    assert reduced is not None
    assert reduced.std() < 0.0055
    assert abs(reduced.mean() - 2.0) < 1e-4


def test_colour_is_the_mean_of_a_block() -> None:
    color = np.random.default_rng(0).integers(0, 256, (721, 1283, 3), dtype=np.uint8)
    camera = replace(HD, width=1283, height=721)
    reduced = resize_frame(RgbdFrame(camera, color), 640).color
    assert reduced is not None
    blocks = color[:720, :1282].reshape(360, 2, 641, 2, 3).astype(np.float64).mean(axis=(1, 3))
    assert reduced.shape == blocks.shape
    assert np.abs(reduced - blocks).max() <= 0.5


def test_the_reduced_camera_sees_the_same_room() -> None:
    """The scene rendered by the reduced camera has the depth of the reduced frame, but for outlines."""
    small = resize_frame(view(HD, 0.4).frame, 640)
    direct = view(small.camera, 0.4).frame
    assert small.depth_m is not None
    assert direct.depth_m is not None
    off = np.abs(small.depth_m - direct.depth_m)
    assert np.quantile(off, 0.99) < 1e-3
    shifted = np.abs(small.depth_m[:, 1:] - direct.depth_m[:, :-1])  # a pixel off would show
    assert np.quantile(shifted, 0.5) > 1e-3


def odd_estimate() -> tuple[RoomEstimate, CameraIntrinsics]:
    """The truth of a furnished room at the reduced size, and a camera whose sides are no whole multiples."""
    camera = replace(HD, width=1283, height=721)
    sample = furnished(resize_frame(RgbdFrame(camera, np.zeros((721, 1283, 3), np.uint8)), 640).camera, 5, "clean")
    height, width = sample.frame.camera.height, sample.frame.camera.width
    superpixels = np.arange(height * width, dtype=np.int32).reshape(height, width)
    return replace(with_truth(sample), superpixels=superpixels), camera


def test_an_enlarged_estimate_fills_the_image_and_comes_back() -> None:
    small, camera = odd_estimate()
    large = restore_estimate(small, camera, 640)
    assert small.cuboid is not None
    np.testing.assert_array_equal(large.layout, small.cuboid.raster(camera))
    for one, other in zip(large.polygons, small.cuboid.polygons(camera), strict=True):
        np.testing.assert_array_equal(one.pixels, other.pixels)
    for name in ("furniture", "superpixels"):
        assert getattr(large, name).shape == (721, 1283)
        assert getattr(large, name)[720, 1282] == getattr(small, name)[359, 640]
    assert (small.labels == 6).any()
    back = resize_estimate(large, camera, 640)
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(back, name), getattr(small, name))


def test_structure_follows_the_layout_between_the_blocks() -> None:
    small, camera = odd_estimate()
    large = restore_estimate(small, camera, 640)
    structure = large.labels != 6
    np.testing.assert_array_equal(large.labels[structure], large.layout[structure])


def test_the_estimate_has_the_size_of_the_frame() -> None:
    sample = furnished(HD, 3)
    estimate = LayoutEstimator().estimate(sample.frame)
    assert estimate.status is Status.OK
    assert {getattr(estimate, name).shape for name in IMAGES} == {(720, 1280)}
    assert {"resize", "restore", "joint"} <= set(estimate.timings_ms)
    truth = sample.truth
    assert truth is not None
    assert truth.layout is not None
    assert truth.labels is not None
    assert (estimate.layout != truth.layout).mean() < 0.01
    assert (estimate.labels != truth.labels)[truth.labels > 0].mean() < 0.03
    corners: NDArray[np.float64] = np.concatenate([p.pixels for p in estimate.polygons])
    assert corners[:, 0].max() > 1279.0
    assert corners[:, 1].max() > 719.0


def test_full_size_on_request_is_as_near_to_the_truth() -> None:
    sample = furnished(HD, 3)
    assert sample.truth is not None
    assert sample.truth.layout is not None
    full = LayoutEstimator(EstimatorConfig(working_size_px=0)).estimate(sample.frame)
    assert "resize" not in full.timings_ms
    assert (full.layout != sample.truth.layout).mean() < 0.01


@pytest.mark.parametrize("method", ["joint", "depth"])
def test_without_an_answer_the_images_have_the_full_size_too(method: str) -> None:
    frame = RgbdFrame(HD, None, np.full((720, 1280), np.nan, np.float32))
    estimate = LayoutEstimator(EstimatorConfig(method=method)).estimate(frame)
    assert estimate.status is Status.NO_DEPTH
    assert {getattr(estimate, name).shape for name in IMAGES} == {(720, 1280)}
    assert not estimate.labels.any()


def test_the_depth_method_is_reduced_too() -> None:
    sample = furnished(HD, 3, "clean")
    estimate = LayoutEstimator(EstimatorConfig(method="depth")).estimate(sample.frame)
    assert estimate.status is Status.OK
    assert estimate.labels.shape == (720, 1280)
    assert set(np.unique(estimate.labels)) > {6}


def test_free_space_is_that_of_the_reduced_frame() -> None:
    sample = view(HD)
    large = with_truth(sample)
    small = resize_frame(sample.frame, 640)
    one = free_space_of_frame(sample.frame, large, CONFIG)
    other = free_space_of_frame(small, resize_estimate(large, HD, 640), CONFIG)
    scene = Scene(small, resize_estimate(large, HD, 640), NodeConfig(), CONFIG).free_space
    assert one is not None
    assert other is not None
    assert scene is not None
    assert (one.grid == 0).sum() > 500
    for space in (other, scene):
        np.testing.assert_array_equal(space.grid, one.grid)
        np.testing.assert_array_equal(space.floor, one.floor)


def test_a_scene_shows_what_the_camera_sent_at_its_size() -> None:
    sample, estimator = furnished(HD, 3), LayoutEstimator()
    small = resize_keeping(sample.frame, 640)
    assert resize_keeping(small, 640) is small
    assert original_of(resize_frame(sample.frame, 640)) is not sample.frame  # nobody else holds on to large images
    scene = Scene(small, estimator.estimate(small), NodeConfig(), estimator.config)
    assert scene.frame is sample.frame
    whole = estimator.estimate(sample.frame)
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(scene.estimate, name), getattr(whole, name))


def test_the_clouds_are_as_dense_as_those_of_a_camera_of_the_working_size() -> None:
    counts = []
    for camera in (HD, resize_frame(view(HD).frame, 640).camera):
        sample = view(camera)
        space = free_space_of_frame(sample.frame, with_truth(sample), CONFIG)
        assert space is not None
        counts.append(len(space.floor))
    assert counts[0] == pytest.approx(counts[1], rel=0.02)


@pytest.mark.parametrize("noise", ["kinect", "stereo"])
def test_a_camera_of_few_pixels_sees_the_room(noise: str) -> None:
    """At its own size nothing is left for cells of 10 pixels."""
    camera = CameraIntrinsics(224, 172, 186.0, 186.0, 111.5, 85.5)
    errors = []
    for seed in (2, 3, 5):
        sample = furnished(camera, seed, noise)
        estimate = LayoutEstimator().estimate(sample.frame)
        assert sample.truth is not None
        assert sample.truth.layout is not None
        assert {getattr(estimate, name).shape for name in IMAGES} == {(172, 224)}
        errors.append((estimate.layout != sample.truth.layout).mean())
        corners = np.concatenate([p.pixels for p in estimate.polygons])
        assert corners.min() >= -0.5
        assert corners.max() <= 223.5
    assert np.mean(errors) < 0.02


def test_a_working_size_without_cells_is_refused() -> None:
    with pytest.raises(ValueError, match=r"working_size_px is 100 px; allowed are 0 \(no resizing\) and 160 or more"):
        EstimatorConfig(working_size_px=100)


@pytest.mark.parametrize(
    "camera", [replace(HD, width=1283, height=721), CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)]
)
def test_what_is_learned_is_what_the_estimator_sees(camera: CameraIntrinsics) -> None:
    sample = furnished(camera, 3)
    seen = at_working_size(sample, CONFIG)
    assert seen.frame.camera == resize_frame(sample.frame, 640).camera
    size = (seen.frame.camera.height, seen.frame.camera.width)
    assert seen.truth is not None
    assert seen.truth.layout is not None
    assert seen.truth.labels40 is not None
    assert seen.truth.layout.shape == seen.truth.labels40.shape == size
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    assert (seen.truth.layout != sample.truth.cuboid.raster(seen.frame.camera)).mean() < 0.02
    usual = furnished(KINECT, 3)
    assert at_working_size(usual, CONFIG).truth is usual.truth


def test_every_stage_of_a_view_has_the_working_size() -> None:
    look = look_at(furnished(HD, 3).frame, LayoutEstimator())
    assert look.seen is not None
    assert look.seen.superpixels.index.shape == look.estimate.labels.shape == (360, 640)


def test_a_small_frame_is_drawn_larger_and_its_legend_leaves_the_room_to_see() -> None:
    camera = CameraIntrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
    sample = furnished(camera, 3, "clean")
    picture = draw_overlay(sample.frame, with_truth(sample))
    assert picture.shape == (480, 640, 3)
    plain = draw_overlay(view(KINECT).frame, with_truth(view(KINECT)))
    assert plain.shape == (480, 640, 3)


def test_a_frame_too_small_to_be_enlarged_is_drawn_as_it_is() -> None:
    camera = CameraIntrinsics(64, 48, 64.0, 64.0, 31.5, 23.5)
    frame = RgbdFrame(camera, np.zeros((48, 64, 3), np.uint8), np.full((48, 64), 2.0, np.float32))
    assert draw_overlay(frame, LayoutEstimator().estimate(frame)).shape == (48, 64, 3)
