"""Faults of the input (F22-F25, F30-F32): a status or a low confidence, never an exception, never a warning."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import HALF, SMALL, ask, check, look, seen_from_inside

from room_layout_ros.core.estimate import Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation.measures import score_pixels


@pytest.fixture(scope="module")
def estimator() -> LayoutEstimator:
    return LayoutEstimator()


@pytest.fixture(scope="module")
def furnished() -> list[Sample]:
    return list(good_samples(SyntheticSource(8, 31, noise="clean", walk=False, camera=HALF)))


def layout_error(sample: Sample, layout: NDArray[np.uint8]) -> float:
    assert sample.truth is not None
    assert sample.truth.layout is not None
    return score_pixels(sample.truth.layout, layout).layout_error


@pytest.mark.parametrize("value", (0.0, np.nan, np.inf, -np.inf, -1.0, 1e-40, 3e38), ids=str)
def test_f22_depth_that_is_none(estimator: LayoutEstimator, furnished: list[Sample], value: float) -> None:
    frame = furnished[0].frame
    nothing = np.full((HALF.height, HALF.width), value, np.float32)
    without = ask(estimator, replace(frame, color=None, depth_m=nothing))
    assert without.status is Status.NO_DEPTH
    from_color = ask(estimator, replace(frame, depth_m=nothing))
    assert from_color.status is Status.OK
    assert not from_color.metric, "a room without depth has no scale"
    np.testing.assert_array_equal(from_color.layout, ask(estimator, frame.without_depth()).layout)


def test_f23_millimetres_for_metres_are_no_depth(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    depth_m = furnished[0].frame.depth_m
    assert depth_m is not None
    for factor in (1000.0, 0.001):
        wrong = (depth_m * np.float32(factor)).astype(np.float32)
        assert ask(estimator, RgbdFrame(HALF, None, wrong)).status is Status.NO_DEPTH


def test_f24_missing_pixels_cost_little_at_first_and_never_an_exception(
    estimator: LayoutEstimator, furnished: list[Sample], rng: np.random.Generator
) -> None:
    shares = (0.05, 0.25, 0.5, 0.75, 0.95)
    errors = np.empty((len(shares), len(furnished)))
    for j, sample in enumerate(furnished):
        assert sample.frame.depth_m is not None
        chance = rng.random(sample.frame.depth_m.shape)  # the same pixels and ever more
        for i, share in enumerate(shares):
            holes = np.where(chance < share, np.float32(np.nan), sample.frame.depth_m)
            errors[i, j] = layout_error(sample, ask(estimator, replace(sample.frame, depth_m=holes)).layout)
    mean = errors.mean(axis=1)
    assert mean[0] < 0.03, np.round(100 * errors, 2)
    assert mean[1] < 0.05, np.round(100 * errors, 2)
    assert (np.diff(mean) > -0.01).all(), np.round(100 * mean, 2)


# --- sizes, and views that are no rooms ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("width", "height", "most"),
    [(160, 120, 0.06), (320, 240, 0.03), (641, 479, 0.02), (213, 161, 0.06), (240, 320, 0.04), (1280, 720, 0.02)],
)
def test_f25_any_size_of_image(estimator: LayoutEstimator, width: int, height: int, most: float) -> None:
    focal = 525.0 * width / 640
    camera = CameraIntrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    frame, room = seen_from_inside(camera, look(25, 8, 1))
    estimate = ask(estimator, frame)
    assert estimate.status is Status.OK
    assert score_pixels(room.raster(camera), estimate.layout).layout_error < most
    for part in (frame.without_depth(), replace(frame, color=None)):
        ask(estimator, part)


@pytest.mark.parametrize(("width", "height"), ((1, 1), (2, 3), (8, 8), (9, 200), (64, 48), (300, 11)))
def test_f25_images_too_small_for_a_room(
    estimator: LayoutEstimator, width: int, height: int, rng: np.random.Generator
) -> None:
    camera = CameraIntrinsics(width, height, float(width), float(width), (width - 1) / 2, (height - 1) / 2)
    color = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    depth_m = np.full((height, width), 2.0, np.float32)
    for frame in (RgbdFrame(camera, color, depth_m), RgbdFrame(camera, color), RgbdFrame(camera, None, depth_m)):
        assert ask(estimator, frame).status is Status.NO_ROOM


def pictures(rng: np.random.Generator) -> dict[str, NDArray[np.uint8]]:
    y, x = np.mgrid[: SMALL.height, : SMALL.width]
    board = (((x // 8 + y // 8) % 2) * 255).astype(np.uint8)
    return {
        "black": np.zeros((*y.shape, 3), np.uint8),
        "saturated": np.full((*y.shape, 3), 255, np.uint8),
        "noise": rng.integers(0, 256, (*y.shape, 3), dtype=np.uint8),
        "checkerboard": np.repeat(board[..., None], 3, 2),
    }


@pytest.mark.parametrize("what", ("black", "saturated", "noise", "checkerboard"))
def test_f30_pictures_of_nothing(estimator: LayoutEstimator, what: str, rng: np.random.Generator) -> None:
    color = pictures(rng)[what]
    frame, room = seen_from_inside(SMALL, look(25, 8, 1))
    from_color = ask(estimator, RgbdFrame(SMALL, color))
    assert from_color.status is Status.NO_ROOM or from_color.confidence < 0.7
    with_depth = ask(estimator, replace(frame, color=color))  # depth sees the room all the same
    assert score_pixels(room.raster(SMALL), with_depth.layout).layout_error < 0.1
    noise = rng.uniform(0.3, 8.0, (SMALL.height, SMALL.width)).astype(np.float32)
    assert ask(estimator, RgbdFrame(SMALL, color, noise)).status is Status.NO_ROOM


@pytest.mark.parametrize("what", ("one wall", "oblique wall", "ball", "waves", "far wall of clutter", "floor only"))
def test_f31_what_is_no_room_is_never_a_confident_cuboid(
    estimator: LayoutEstimator, what: str, rng: np.random.Generator
) -> None:
    y, x = np.mgrid[: HALF.height, : HALF.width]
    depth = {
        "one wall": np.full(y.shape, 2.0),
        "oblique wall": 1 / (0.3 + 0.001 * x),
        "ball": np.sqrt(np.maximum(9 - ((x - 160) / 80) ** 2 - ((y - 120) / 80) ** 2, 0.5)),
        "waves": 2 + 0.5 * np.sin(x / 15) * np.cos(y / 11),
        "far wall of clutter": np.full(y.shape, 11.9),
        "floor only": RoomCuboid(look(0, 60), np.array([np.inf, 1.3, np.inf, np.inf, np.inf])).depth(HALF),
    }[what].astype(np.float32)
    plain, noisy = np.full((*y.shape, 3), 120, np.uint8), rng.integers(0, 256, (*y.shape, 3), dtype=np.uint8)
    for color in (None, plain, noisy):
        estimate = ask(estimator, RgbdFrame(HALF, color, depth))
        assert estimate.confidence < 0.5, what
        assert (estimate.face_confidence < 0.5).all(), what


def test_f31_upside_down_the_ceiling_is_up_where_gravity_says(
    estimator: LayoutEstimator, furnished: list[Sample]
) -> None:
    sample = furnished[1]
    frame = sample.frame
    truth = sample.truth
    assert truth is not None
    assert truth.layout is not None
    assert frame.color is not None
    assert frame.depth_m is not None
    assert truth.down_camera is not None
    turned = replace(frame, color=frame.color[::-1, ::-1].copy(), depth_m=frame.depth_m[::-1, ::-1].copy())
    gravity = truth.down_camera * [-1, -1, 1]
    estimate = estimator.estimate(turned, TemporalPrior(gravity=gravity))
    floor = truth.layout[::-1, ::-1] == 2
    assert (estimate.layout[floor] == 2).mean() > 0.95


def test_f32_a_deadline_that_has_passed_gives_the_best_so_far(
    estimator: LayoutEstimator, furnished: list[Sample]
) -> None:
    for sample in furnished[:3]:
        for frame in (sample.frame, sample.frame.without_depth(), replace(sample.frame, color=None)):
            estimate = estimator.estimate(frame, expired=lambda: True)
            check(estimate, frame)
            assert estimate.status in (Status.DEADLINE, Status.OK)
            assert estimate.cuboid is not None


def test_f32_a_deadline_may_pass_at_any_step(estimator: LayoutEstimator, furnished: list[Sample]) -> None:
    for steps in range(12):
        left = itertools.count()
        estimate = estimator.estimate(furnished[0].frame, expired=lambda: next(left) >= steps)  # noqa: B023
        check(estimate, furnished[0].frame)
        assert estimate.status in (Status.DEADLINE, Status.OK)


@pytest.mark.parametrize("keeps", ["a fifth at random", "every fifth row", "a third at random", "every twentieth row"])
def test_f24_scattered_depth_is_a_room_where_colour_alone_is_one(
    estimator: LayoutEstimator, keeps: str, rng: np.random.Generator
) -> None:
    sample = next(iter(good_samples(SyntheticSource(frames=1, seed=1))))
    frame = sample.frame
    assert frame.depth_m is not None
    kept = {
        "a fifth at random": rng.random(frame.depth_m.shape) < 0.2,
        "a third at random": rng.random(frame.depth_m.shape) < 0.33,
        "every fifth row": np.broadcast_to((np.arange(480) % 5 == 0)[:, None], (480, 640)),
        "every twentieth row": np.broadcast_to((np.arange(480) % 20 == 0)[:, None], (480, 640)),
    }[keeps]
    found = ask(estimator, replace(frame, depth_m=np.where(kept, frame.depth_m, np.float32(np.nan))))
    assert found.status is Status.OK
    assert sample.truth is not None
    assert sample.truth.layout is not None
    assert score_pixels(sample.truth.layout, found.layout).layout_error < 0.15


@pytest.mark.parametrize(("width", "height"), [(640, 5), (5, 640), (700, 9), (9, 700)])
def test_f25_a_strip_of_few_pixels_is_no_room(estimator: LayoutEstimator, width: int, height: int) -> None:
    camera = CameraIntrinsics(width, height, 500.0, 500.0, width / 2, height / 2)
    color = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    depth_m = np.full((height, width), 2.0, np.float32)
    for frame in (RgbdFrame(camera, color, depth_m), RgbdFrame(camera, color), RgbdFrame(camera, None, depth_m)):
        assert ask(estimator, frame).status in (Status.NO_ROOM, Status.NO_DEPTH)
