"""Small frames folders for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.datasets import FrameTruth, Sample
from room_layout_ros.datasets.synthetic import camera_pose
from room_layout_ros.datasets.writers import FolderWriter
from room_layout_ros.decoding.image import depth_from_mm

SMALL = CameraIntrinsics(64, 48, 52.5, 52.25, 31.5, 23.5)


def make_samples(count: int, rng: np.random.Generator, camera: CameraIntrinsics = SMALL) -> list[Sample]:
    """Return frames of random pixels with holes in the depth, odd stamps, poses and truth."""
    size = (camera.height, camera.width)
    samples = []
    for i in range(count):
        color = rng.integers(0, 256, (*size, 3)).astype(np.uint8)
        depth_mm = rng.integers(0, 9000, size).astype(np.uint16)
        depth_mm[rng.random(size) < 0.2] = 0
        stamp_ns = 1_700_000_000_123_456_789 + i * 33_366_701
        frame = RgbdFrame(camera, color, depth_from_mm(depth_mm), stamp_ns, "optical", f"frame_{i * 7:03d}")
        truth = FrameTruth(rng.integers(1, 6, size).astype(np.uint8), rng.integers(0, 41, size).astype(np.uint8))
        samples.append(Sample(frame, truth, camera_pose(0.1 * i, -1.0, 1.4, 0.3 * i, -0.2, 0.01)))
    return samples


def write_folder(path: Path, samples: list[Sample]) -> Path:
    """Write samples as a frames folder."""
    writer = FolderWriter(path)
    with writer:
        for sample in samples:
            writer.write(sample)
    return path


def assert_same_samples(actual: list[Sample], expected: list[Sample]) -> None:
    """Claim that every pixel, stamp, name and pose survived."""
    assert [s.name for s in actual] == [s.name for s in expected]
    for a, b in zip(actual, expected, strict=True):
        assert a.frame.stamp_ns == b.frame.stamp_ns
        assert a.frame.frame_id == b.frame.frame_id
        assert a.frame.camera == b.frame.camera
        np.testing.assert_array_equal(a.frame.color, b.frame.color)
        np.testing.assert_array_equal(a.frame.depth_m, b.frame.depth_m)
        assert a.truth is not None
        assert b.truth is not None
        np.testing.assert_array_equal(a.truth.layout, b.truth.layout)
        np.testing.assert_array_equal(a.truth.labels40, b.truth.labels40)
        assert a.T_world_camera is not None
        assert b.T_world_camera is not None
        np.testing.assert_allclose(a.T_world_camera, b.T_world_camera, atol=1e-11)
