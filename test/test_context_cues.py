"""Cues of the geometric context: reach of planes, texture, colour regions, against naive twins and made-up images."""

from __future__ import annotations

import cv2
import naive_context_cues as naive
import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.evidence.color_regions import SCALES, compute_color_regions
from room_layout_ros.core.evidence.features import SuperpixelFeatures, compute_superpixel_features
from room_layout_ros.core.evidence.plane_reach import compute_plane_reach
from room_layout_ros.core.evidence.texture import N_PATTERNS, TEXTURE_COLUMNS, compute_texture
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.superpixels import compute_superpixels

CAMERA = CameraIntrinsics(160, 120, 130.0, 130.0, 80.0, 60.0)
FRONT, WARDROBE = 3.0, 2.4


def _wardrobe_before_a_wall() -> SuperpixelFeatures:
    room = RoomCuboid(np.eye(3), np.array([1.3, 1.2, 1.9, FRONT, 1.9]))
    depth = room.depth(CAMERA)
    depth[:, 60:90] = np.minimum(depth[:, 60:90], WARDROBE)
    depth[:18, 60:90] = room.depth(CAMERA)[:18, 60:90]
    inverse = (1.0 / depth).astype(np.float32)
    superpixels = compute_superpixels(None, inverse, EstimatorConfig(superpixel_count=60))
    return compute_superpixel_features(superpixels, None, inverse, np.eye(3), CAMERA)


def test_the_room_goes_on_beyond_a_wardrobe_and_not_beyond_a_wall() -> None:
    features = _wardrobe_before_a_wall()
    table = dict(zip(features.names, features.values.T, strict=True))
    faces_camera = table["cos_z"] > 0.99
    wardrobe = faces_camera & (np.abs(table["Z"] - WARDROBE) < 0.05)
    wall = faces_camera & (np.abs(table["Z"] - FRONT) < 0.05)
    assert wardrobe.any()
    assert wall.any()
    assert table["reach_beyond"][wardrobe].min() > 0.1
    assert table["reach_near_beyond"][wardrobe].min() > 0.3
    assert table["reach_beyond"][wall].max() == 0.0
    assert table["reach_ceiling"][wall].max() == 0.0
    # ceiling cells reach the wall within half a cell's depth of it
    assert np.allclose(table["reach_ceiling"][wardrobe], FRONT - WARDROBE, atol=0.3)
    assert np.nanmax(table["reach_on_top"][wall]) < 0.3  # the wall is seen up to the ceiling on both sides


def test_reach_of_planes_equals_the_naive_one(rng: np.random.Generator) -> None:
    points = rng.normal(scale=1.5, size=(12, 16, 3)).astype(np.float32)
    points[rng.random((12, 16)) < 0.2] = np.nan
    low, high = np.array([-2.0, -1.2, -2.0]), np.array([2.0, 1.2, 2.0])
    normals = rng.normal(size=(5, 3))
    planes = np.concatenate([normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.random((5, 1))], axis=1)
    planes[3] = np.nan
    boxes = np.array([[16, 60, 24, 50], [0, 127, 0, 95], [100, 110, 8, 90], [0, 8, 0, 8], [64, 71, 80, 95]], float)
    found = compute_plane_reach(points, low, high, planes, boxes)
    assert np.isnan(found[3]).all()
    for k in (0, 1, 2, 4):
        left, right, upper, lower = (int(v) // 8 for v in boxes[k])
        truth = naive.plane_reach(points, low, high, planes[k], (left, right, upper, lower))
        assert np.allclose(found[k], truth, atol=1e-5, equal_nan=True)


def test_patterns_equal_the_naive_ones_and_are_shares(rng: np.random.Generator) -> None:
    color = cv2.GaussianBlur(rng.integers(0, 256, (60, 80, 3), dtype=np.uint8), (5, 5), 1.5)
    index = np.zeros((60, 80), np.int32)
    table = compute_texture(index, 1, color)
    half = cv2.resize(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    found = np.array([table[f"pattern_{k}"][0] for k in range(N_PATTERNS)])
    assert np.allclose(found, naive.patterns(np.asarray(half, np.uint8)))
    assert sum(table[f"direction_{k}"][0] for k in range(8)) == pytest.approx(1.0)


@pytest.mark.parametrize(("angle_deg", "direction"), [(0, 0), (45, 2), (90, 4), (135, 6)])
def test_stripes_have_the_direction_of_their_gradient(angle_deg: int, direction: int) -> None:
    y, x = np.indices((80, 80))
    along = x * np.cos(np.deg2rad(angle_deg)) + y * np.sin(np.deg2rad(angle_deg))
    grey = (128 + 100 * np.sin(along / 4.0)).astype(np.uint8)[:, :, None]
    table = compute_texture(np.zeros((80, 80), np.int32), 1, np.concatenate([grey] * 3, axis=2))
    assert table[f"direction_{direction}"][0] > 0.8


def test_without_colour_texture_is_not_known() -> None:
    table = compute_texture(np.zeros((20, 20), np.int32), 3, None)
    assert set(table) == set(TEXTURE_COLUMNS)
    assert all(np.isnan(value).all() and value.shape == (3,) for value in table.values())


def test_a_wall_in_pieces_is_one_region() -> None:
    color = np.full((120, 160, 3), 230, np.uint8)
    color[60:] = (60, 40, 30)  # a floor
    color[20:50, 60:100] = (20, 90, 160)  # a picture
    color += np.random.default_rng(0).integers(0, 6, color.shape, dtype=np.uint8)
    superpixels = compute_superpixels(color, None, EstimatorConfig(superpixel_count=80))
    features = compute_superpixel_features(superpixels, color, None, np.eye(3), CAMERA)
    table = dict(zip(features.names, features.values.T, strict=True))
    names = [name for name in table if name.startswith("coarse_")]
    assert len(names) == len([name for name in table if name.startswith("fine_")])
    wall = (superpixels.center_px[:, 1] < 55) & (table["L"] > 200)
    floor = superpixels.center_px[:, 1] > 65
    assert np.median(table["coarse_area"][wall]) > 0.25  # far more than one superpixel of 80
    assert table["coarse_bottom"][wall].max() < 0.6
    assert table["coarse_top"][floor].min() > 0.4
    assert set(SCALES) == {"fine", "mid", "coarse"}


def test_regions_of_a_frame_without_colour_do_not_fail() -> None:
    color = np.full((120, 160, 3), 90, np.uint8)
    superpixels = compute_superpixels(color, None, EstimatorConfig(superpixel_count=40))
    names = ("gradient", "L_deviation", "contrast", "om_2", "om_4", "lines_x", "lines_y", "lines_z", "edges")
    columns = {name: np.full(superpixels.count, np.nan) for name in ("L", "a", "b", *names)}
    bounds = np.zeros((superpixels.count, 4), np.float32)
    table = compute_color_regions(superpixels, columns, bounds, CAMERA)
    assert all(len(value) == superpixels.count for value in table.values())
