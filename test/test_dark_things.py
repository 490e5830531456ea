"""Floor below black things without depth; against scenes and the slow twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, GREY, ahead_of, empty, free_space_of, with_truth
from naive_dark_things import naive_dark
from numpy.typing import NDArray

from room_layout_ros.core import freespace
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.floor.dark_things import below_dark_things
from room_layout_ros.core.floor.depth_holes import BRIDGED, GAP, MEASURED
from room_layout_ros.core.floor.floor_cells import FREE_CELL
from room_layout_ros.core.floor.floor_frame import floor_frame
from room_layout_ros.core.floor.floor_pixels import FLOOR_PIXEL, NOTHING, OBSTACLE_PIXEL, WALL_PIXEL
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import CLUTTER, FLOOR, FRONT_WALL
from room_layout_ros.datasets.synthetic import KINECT, NOISES, camera_pose, render
from room_layout_ros.datasets.synthetic.shapes import Material, Solid

CORNER = (0.0, -2.0, 0.097)
SHAPE = (41, 41)
CAMERA = CameraIntrinsics(80, 60, 70.0, 72.0, 39.3, 30.2)
HEIGHT_M = 0.8
BLACK = Material((10, 10, 10))
WIDE = CameraIntrinsics(848, 480, 424.0, 424.0, 423.5, 239.5)
VIEWS = {"high": (KINECT, 1.2, -0.3), "low": (WIDE, 0.35, -0.05)}
"""Camera, its height in m, its pitch; it stands 1.4 m before the middle of the room."""


def solid(
    x: float, y: float, size: tuple[float, float], level: tuple[float, float], material: Material = BLACK
) -> Solid:
    return Solid(x, y, 0.0, *size, *level, 5, material, thing=1)


def legs(x: float, y: float, apart: tuple[float, float], top: float, thick: float) -> list[Solid]:
    half = 0.5 * apart[0], 0.5 * apart[1]
    return [
        solid(x + dx, y + dy, (thick, thick), (0.0, top)) for dx in (-half[0], half[0]) for dy in (-half[1], half[1])
    ]


SOFA = [
    solid(0.6, 0.0, (0.8, 1.6), (0.08, 0.42)), solid(0.9, 0.0, (0.2, 1.6), (0.42, 0.8)),
    *legs(0.6, 0.0, (0.74, 1.54), 0.08, 0.05),
]  # fmt: skip
TABLE = [solid(0.6, 0.0, (0.8, 1.2), (0.70, 0.73)), *legs(0.6, 0.0, (0.72, 1.12), 0.70, 0.05)]
STEEL = [
    solid(0.6, 0.0, (0.8, 1.6), (0.12, 0.42)), solid(0.9, 0.0, (0.2, 1.6), (0.42, 0.8)),
    *(replace(leg, material=GREY) for leg in legs(0.6, 0.0, (0.74, 1.5), 0.12, 0.05)),
]  # fmt: skip
SHOES = [solid(0.4, y, (0.28, 0.10), (0.0, 0.09)) for y in (-0.4, -0.25, 0.3)]


def look(solids: list[Solid], view: str, noise: str, label: int = CLUTTER) -> tuple[RgbdFrame, RoomEstimate]:
    """A room with things without depth, and an estimate that labels them so."""
    camera, height_m, pitch = VIEWS[view]
    pose = camera_pose(-1.4, 0.0, height_m, 0.0, pitch)
    sample = render(empty(*solids), camera, pose, NOISES[noise], np.random.default_rng(5))
    assert sample.truth is not None
    assert sample.truth.labels is not None
    assert sample.frame.depth_m is not None
    assert sample.frame.color is not None
    black = (sample.truth.labels == CLUTTER) & (sample.frame.color.max(axis=2) < 60)
    estimate = with_truth(sample)
    labels = np.where(black, label, estimate.labels).astype(np.uint8)
    depth_m = np.where(black, np.float32(np.nan), sample.frame.depth_m)
    return replace(sample.frame, depth_m=depth_m), replace(estimate, labels=labels)


def nothing_dark(shape: tuple[int, int], *_: object) -> NDArray[np.bool_]:
    return np.zeros(shape, np.bool_)


def without_rule(frame: RgbdFrame, estimate: RoomEstimate, patch: pytest.MonkeyPatch) -> NDArray[np.int8]:
    with patch.context() as only:
        only.setattr(freespace, "below_dark_things", nothing_dark)
        return free_space_of(frame, estimate).grid


@pytest.mark.parametrize("label", [CLUTTER, FRONT_WALL])
@pytest.mark.parametrize("noise", ["kinect", "stereo"])
@pytest.mark.parametrize(
    ("solids", "view", "wrong"), [(SOFA, "low", 20), (STEEL, "low", 20), (TABLE, "low", 60), (TABLE, "high", 60)]
)
def test_below_black_furniture_without_depth_nothing_is_free(
    solids: list[Solid], view: str, wrong: int, noise: str, label: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame, estimate = look(solids, view, noise, label)
    found = free_space_of(frame, estimate)
    before = replace(found, grid=without_rule(frame, estimate, monkeypatch))
    # it covers 1.6-2.4 m ahead
    under, open_floor = ((1.6, 2.4), 0.55), ((1.2, 1.4), 0.3)
    assert not (ahead_of(found, *under) == FREE_CELL).any()
    assert (ahead_of(before, *under) == FREE_CELL).sum() > wrong
    for at in ((open_floor[0], 0.3, 0.0), ((1.6, 2.2), 0.15, 1.1)):
        kept, had = (ahead_of(f, *at) == FREE_CELL for f in (found, before))
        assert kept.sum() >= 0.8 * had.sum() > 0


@pytest.mark.parametrize("view", ["high", "low"])
def test_the_margin_before_black_shoes_is_not_free_and_nothing_else_is_lost(
    view: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame, estimate = look(SHOES, view, "kinect")
    found = free_space_of(frame, estimate)
    before = replace(found, grid=without_rule(frame, estimate, monkeypatch))
    for left in (-0.4, -0.25, 0.3):
        assert not (ahead_of(found, (1.6, 1.66), 0.05, left) == FREE_CELL).any()
    assert ((found.grid != before.grid) & (before.grid == FREE_CELL)).sum() < 25


@pytest.mark.parametrize("view", ["high", "low"])
def test_a_dark_rug_with_depth_stays_free(view: str, monkeypatch: pytest.MonkeyPatch) -> None:
    camera, height_m, pitch = VIEWS[view]
    rug = solid(0.6, 0.0, (1.0, 1.4), (0.0, 0.004), Material((20, 20, 22)))
    pose = camera_pose(-1.4, 0.0, height_m, 0.0, pitch)
    sample = render(empty(rug), camera, pose, NOISES["kinect"], np.random.default_rng(5))
    estimate = with_truth(sample)
    estimate = replace(estimate, labels=np.where(estimate.labels == CLUTTER, FLOOR, estimate.labels).astype(np.uint8))
    found = free_space_of(sample.frame, estimate)
    np.testing.assert_array_equal(found.grid, without_rule(sample.frame, estimate, monkeypatch))
    assert (ahead_of(found, (1.6, 2.4), 0.6) == FREE_CELL).mean() > 0.8


@pytest.mark.parametrize("view", ["high", "low"])
def test_before_a_black_mat_without_depth_the_margin_alone_is_lost(view: str, monkeypatch: pytest.MonkeyPatch) -> None:
    frame, estimate = look([solid(0.6, 0.0, (1.0, 1.0), (0.0, 0.004))], view, "kinect", FLOOR)
    found = free_space_of(frame, estimate)
    before = replace(found, grid=without_rule(frame, estimate, monkeypatch))
    lost = (before.grid == FREE_CELL) & (found.grid != FREE_CELL)
    assert lost.sum() <= 2 * (1.2 / CONFIG.free_space_resolution_m)
    np.testing.assert_array_equal(ahead_of(found, (0.8, 1.35), 0.6), ahead_of(before, (0.8, 1.35), 0.6))


def test_without_colour_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    frame, estimate = look(TABLE, "low", "kinect")
    grey = replace(CONFIG, use_color=False)
    found = free_space_of(frame, estimate, grey).grid
    monkeypatch.setattr(freespace, "below_dark_things", nothing_dark)
    np.testing.assert_array_equal(found, free_space_of(frame, estimate, grey).grid)


def holes(rng: np.random.Generator) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
    """Kinds of holes and pixels, and a picture: bright and dark holes on legs before floor and a wall."""
    shape = CAMERA.height, CAMERA.width
    kind = np.full(shape, FLOOR_PIXEL, np.uint8)
    kind[:24] = WALL_PIXEL
    hole, color = np.full(shape, MEASURED, np.uint8), np.full((*shape, 3), 150, np.uint8)
    for _ in range(3):
        (top, left), tall, wide = rng.integers((5, -10), (35, 70)), rng.integers(4, 12), rng.integers(8, 100)
        parts = [(top, top + tall, left, left + wide)]
        for at in rng.integers(0, wide - 3, 4):
            foot = top + tall + rng.integers(0, 14)
            parts.append((top, foot, left + at, left + at + 3))
        dark = rng.random() < 0.85
        for a, b, c, d in parts:
            place = slice(a, b), slice(max(c, 0), max(d, 0))
            hole[place], kind[place], color[place] = GAP, NOTHING, 20 if dark else 120
        at = max(left + wide // 2, 0)
        kind[top + tall : top + tall + 5, at : at + 2] = OBSTACLE_PIXEL
    hole[rng.random(shape) < 0.01] = GAP
    hole[(rng.random(shape) < 0.01) & (hole == GAP)] = BRIDGED
    return hole, kind, color


@pytest.mark.parametrize("pitch", [-0.5, -0.2, 0.05])
@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_floor_is_hidden_where_the_slow_twin_says(pitch: float, margin: float) -> None:
    normal = np.array([0.05, np.cos(pitch), -np.sin(pitch)])
    T = floor_frame(normal / np.linalg.norm(normal), HEIGHT_M)
    some = 0
    for seed in range(30):
        hole, kind, color = holes(np.random.default_rng(seed))
        inverse = np.random.default_rng(seed).uniform(0.3, 1.0, hole.shape).astype(np.float32)
        below = below_dark_things(SHAPE, inverse, hole, kind, color, CAMERA, T, CORNER, margin)
        expected = naive_dark(inverse, hole, kind, color, CAMERA, T, CORNER, SHAPE, margin)
        np.testing.assert_array_equal(below, expected)
        some += int(expected.sum())
    assert some > 200
