"""Grid, clouds, scan, outline and pose say exactly what they were given."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from rclpy.serialization import deserialize_message, serialize_message

from msg_adapters.encode_navigation import (
    encode_cloud,
    encode_grid,
    encode_outline,
    encode_pose,
    encode_rotation,
    encode_scan,
    encode_transform,
)
from room_layout_ros.node_config import parse_pose


def test_a_grid_keeps_its_cells_and_place(rng: np.random.Generator) -> None:
    cells = rng.choice(np.array([-1, 0, 100], np.int8), (4, 7))
    message = encode_grid(cells, 0.05, (-0.5, -2.0), 5_000_000_000, "floor")
    info = message.info
    assert (info.height, info.width, info.resolution) == (4, 7, pytest.approx(0.05))
    assert (info.origin.position.x, info.origin.position.y, info.origin.orientation.w) == (-0.5, -2.0, 1.0)
    received = deserialize_message(serialize_message(message), type(message))
    np.testing.assert_array_equal(np.array(received.data).reshape(4, 7), cells)


def test_a_cloud_is_read_back_as_its_points(rng: np.random.Generator) -> None:
    points = rng.normal(size=(9, 3)).astype(np.float32)
    message = encode_cloud(points, 1, "camera")
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1),
    ]  # fmt: skip
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 9, 12, 108)
    np.testing.assert_array_equal(np.frombuffer(message.data, "<f4").reshape(9, 3), points)


def test_an_empty_cloud_is_a_message_too() -> None:
    message = encode_cloud(np.empty((0, 3), np.float32), 1, "camera")
    assert (message.width, len(message.data)) == (0, 0)


def test_a_scan_keeps_free_and_unknown_apart() -> None:
    ranges = np.array([1.5, np.inf, np.nan, 2.0], np.float32)
    message = encode_scan(ranges, -0.3, 0.2, 12.0, 1, "floor")
    assert message.angle_max == pytest.approx(0.3)
    assert (message.range_min, message.range_max) == (0.0, 12.0)
    received = deserialize_message(serialize_message(message), type(message))
    np.testing.assert_array_equal(np.array(received.ranges, np.float32), ranges)


def test_an_outline_lies_on_the_floor() -> None:
    message = encode_outline(np.array([[0.0, 1.0], [2.0, -1.0], [3.0, 4.0]]), 1, "floor")
    assert [(p.x, p.y, p.z) for p in message.polygon.points] == [(0, 1, 0), (2, -1, 0), (3, 4, 0)]


@pytest.mark.parametrize("quaternion", ("0 0 0 1", "1 0 0 0", "0 1 0 0", "0 0 1 0", "0.3 -0.4 0.5 0.7", "1 1 0 0"))
def test_rotations_survive_the_way_to_a_quaternion_and_back(quaternion: str) -> None:
    """Half turns included, where the usual formulas divide by zero."""
    pose = parse_pose(f"1 2 3 {quaternion}")
    q = encode_rotation(pose[:3, :3])
    assert q.w >= 0.0
    np.testing.assert_allclose(parse_pose(f"1 2 3 {q.x} {q.y} {q.z} {q.w}"), pose, atol=1e-9)
    position = encode_pose(pose, 1, "camera").pose.position
    assert (position.x, position.y, position.z) == (1.0, 2.0, 3.0)
    transform = encode_transform(pose, 1, "camera", "floor")
    assert (transform.child_frame_id, transform.transform.translation.z) == ("floor", 3.0)
