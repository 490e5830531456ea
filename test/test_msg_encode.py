"""What is published says exactly what was estimated, with the stamp and frame of the depth image everywhere."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from room_frames import FRAME_ID, room_frame, stamp_ns

from msg_adapters.encode_diagnostics import encode_diagnostics
from msg_adapters.encode_image import encode_image
from msg_adapters.encode_room import encode_label_names, encode_markers, encode_polygons
from msg_adapters.header import encode_header
from msg_adapters.image import decode_color, decode_depth
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.labels import LABEL_NAMES
from room_layout_ros.node_config import NodeConfig
from room_layout_ros.outputs import OUTPUTS
from room_layout_ros.runtime.diagnosis import Finding, Level
from room_layout_ros.scene import Scene


@pytest.fixture(scope="module")
def estimate() -> RoomEstimate:
    estimate = LayoutEstimator().estimate(room_frame(3))
    assert len(estimate.polygons) >= 3
    return estimate


@pytest.mark.parametrize(
    ("pixels", "encoding"),
    (
        (np.arange(6, dtype=np.uint8).reshape(2, 3), "mono8"),
        (np.arange(18, dtype=np.uint8).reshape(2, 3, 3), "rgb8"),
        (np.arange(18, dtype=np.uint8).reshape(2, 3, 3)[:, ::-1], "rgb8"),
        (np.arange(6, dtype=np.uint16).reshape(2, 3), "16UC1"),
        (np.arange(6, dtype=np.float32).reshape(2, 3), "32FC1"),
    ),
)
def test_images_carry_their_bytes(pixels: NDArray[np.generic], encoding: str) -> None:
    message = encode_image(pixels, 5_000_000_007, "camera")
    assert (message.encoding, message.height, message.width) == (encoding, 2, 3)
    assert message.step * message.height == len(message.data)
    assert bytes(message.data) == np.ascontiguousarray(pixels).tobytes()
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (5, 7, "camera")


def test_an_array_without_an_encoding_is_refused() -> None:
    with pytest.raises(ValueError, match=r"float64 of shape \(2, 2\)"):
        encode_image(np.zeros((2, 2)), 1, "")


def test_encoders_and_decoders_are_inverse(rng: np.random.Generator) -> None:
    color, mm = rng.integers(0, 256, (4, 5, 3), dtype=np.uint8), rng.integers(300, 5000, (4, 5)).astype(np.uint16)
    np.testing.assert_array_equal(decode_color(encode_image(color, 1, "")), color)
    np.testing.assert_allclose(decode_depth(encode_image(mm, 1, "")), mm / 1000.0, rtol=1e-6)


def test_label_names_are_the_table() -> None:
    assert json.loads(encode_label_names().data) == {str(i): name for i, name in enumerate(LABEL_NAMES)}


def test_a_polygon_per_visible_face_with_its_corners(estimate: RoomEstimate) -> None:
    messages = encode_polygons(estimate)
    assert [m.polygon.id for m in messages] == [p.face for p in estimate.polygons]
    for message, polygon in zip(messages, estimate.polygons, strict=True):
        corners = [(p.x, p.y, p.z) for p in message.polygon.polygon.points]
        np.testing.assert_allclose(corners, polygon.points_m, rtol=1e-6, atol=1e-6)


def headers(value: Any) -> Iterator[Any]:
    """Yield every header in a message, nested ones too."""
    if isinstance(value, (list, tuple)):
        for element in value[:1000]:
            yield from headers(element)
    elif hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            if name == "header":
                yield value.header
            elif name != "texture":  # of a marker; there is none
                yield from headers(getattr(value, name))


@pytest.mark.parametrize("output", OUTPUTS, ids=lambda o: o.topic)
def test_every_header_has_stamp_and_frame_of_the_frame(output: Any, estimate: RoomEstimate) -> None:
    messages = output.encode(Scene(room_frame(3), estimate, NodeConfig(), EstimatorConfig()))
    found = list(headers(messages))
    assert len(found) >= len(messages) > 0
    assert all(isinstance(m, output.message) for m in messages)
    frame_id = f"{FRAME_ID}_floor" if output.on_floor else FRAME_ID
    assert all(h == encode_header(stamp_ns(3), frame_id) for h in found)


def test_markers_live_as_long_as_told_and_keep_their_ids(estimate: RoomEstimate) -> None:
    markers = encode_markers(estimate, 1.25).markers
    assert {(m.lifetime.sec, m.lifetime.nanosec) for m in markers} == {(1, 250_000_000)}
    assert len({(m.ns, m.id) for m in markers}) == len(markers) == 3 * len(estimate.polygons)
    fills = [m for m in markers if m.ns == "faces"]
    for marker, polygon in zip(fills, estimate.polygons, strict=True):
        assert len(marker.points) == 3 * (len(polygon.points_m) - 2)
        assert area(np.array([(p.x, p.y, p.z) for p in marker.points])) == pytest.approx(fan_area(polygon.points_m))


def area(corners: NDArray[np.float64]) -> float:
    a, b, c = corners[::3], corners[1::3], corners[2::3]
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def fan_area(polygon: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(sum(np.cross(p, q) for p, q in zip(polygon, np.roll(polygon, -1, 0), strict=True)))) / 2


def test_diagnostics_say_level_name_and_values() -> None:
    message = encode_diagnostics([Finding("input depth", Level.ERROR, "no depth", {"rate_hz": "0.0"})], "ns/est", 9)
    (status,) = message.status
    assert (status.level, status.name, status.message) == (b"\x02", "ns/est: input depth", "no depth")
    assert [(v.key, v.value) for v in status.values] == [("rate_hz", "0.0")]
