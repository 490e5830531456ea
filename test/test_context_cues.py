"""Cues of the geometric context: reach of planes against a naive twin and a made-up room."""

from __future__ import annotations

import naive_context_cues as naive
import numpy as np

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.evidence.features import SuperpixelFeatures, compute_superpixel_features
from room_layout_ros.core.evidence.plane_reach import compute_plane_reach
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
        assert np.allclose(found[k], truth, rtol=1e-5, atol=1.01e-4, equal_nan=True)  # in steps of 0.1 mm
