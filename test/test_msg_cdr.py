"""The own reader of serialized messages agrees with rclpy's, and no bytes at all can do harm."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from rclpy.serialization import serialize_message

from msg_adapters.camera_info import decode_camera_info
from msg_adapters.cdr import read_camera_info, read_compressed_image, read_image
from msg_adapters.encode_image import encode_image
from msg_adapters.messages import CameraInfo, CompressedImage
from room_layout_ros.inputs import read_camera
from room_layout_ros.inputs import read_image as checked_image
from room_layout_ros.runtime.session import RefusedError


@pytest.mark.parametrize("frame_id", ("", "a", "camera", "é", "x" * 300))
def test_an_image_is_read_as_it_was_written(frame_id: str, rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 256, (3, 5, 3), dtype=np.uint8)
    message = read_image(serialize_message(encode_image(pixels, 12_345_678_901, frame_id)))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_678_901)
    assert message.header.frame_id == frame_id[:256]
    assert (message.height, message.width, message.step, message.is_bigendian) == (3, 5, 15, 0)
    assert message.encoding == "rgb8"
    assert bytes(message.data) == pixels.tobytes()


@pytest.mark.parametrize("d", ([], [0.1], [0.1, 0.2, 0.3, 0.4, 0.5]))
def test_a_camera_info_is_read_as_it_was_written(d: list[float]) -> None:
    written = CameraInfo(height=480, width=640, distortion_model="plumb_bob", d=d, binning_x=2, binning_y=3)
    written.header.frame_id = "abc"
    written.k = np.arange(9.0)
    written.p = np.arange(12.0) + 50
    written.roi.x_offset, written.roi.y_offset, written.roi.height, written.roi.width = 1, 2, 30, 40
    read = read_camera_info(serialize_message(written))
    assert (read.height, read.width, read.binning_x, read.binning_y) == (480, 640, 2, 3)
    assert (read.roi.x_offset, read.roi.y_offset, read.roi.height, read.roi.width) == (1, 2, 30, 40)
    np.testing.assert_array_equal(read.d, d)
    np.testing.assert_array_equal(read.k, np.arange(9.0))
    np.testing.assert_array_equal(read.p, np.arange(12.0) + 50)


def test_a_compressed_image_is_read_as_it_was_written() -> None:
    read = read_compressed_image(serialize_message(CompressedImage(format="rgb8; jpeg", data=b"\xff\xd8\xff")))
    assert (read.format, bytes(read.data)) == ("rgb8; jpeg", b"\xff\xd8\xff")


def test_the_decoders_take_rclpy_messages_as_well() -> None:
    info = CameraInfo(height=480, width=640)
    info.p = [450.0, 0.0, 310.0, 0.0, 0.0, 460.0, 235.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert decode_camera_info(info) == decode_camera_info(read_camera_info(serialize_message(info)))


def test_big_endian_cdr_is_read_too() -> None:
    body = struct.pack(">iI", 7, 8) + struct.pack(">I4s", 4, b"cam\0") + struct.pack(">II", 1, 2)
    body += struct.pack(">I6s", 6, b"mono8\0") + b"\0" + b"\0" + struct.pack(">I", 2) + struct.pack(">I2s", 2, b"ab")
    message = read_image(b"\0\0\0\0" + body)
    assert (message.header.stamp.sec, message.height, message.width, message.encoding) == (7, 1, 2, "mono8")
    assert bytes(message.data) == b"ab"


def valid_messages() -> list[bytes]:
    pixels = np.full((6, 8, 3), 7, np.uint8)
    info = CameraInfo(height=6, width=8, d=[0.1] * 5)
    info.p = [450.0, 0.0, 4.0, 0.0, 0.0, 460.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    return [serialize_message(encode_image(pixels, 5_000_000_000, "camera")), serialize_message(info)]


def take(serialized: bytes) -> None:
    for read in (lambda b: checked_image("color", b), lambda b: checked_image("depth", b), read_camera):
        sentence = ""
        try:
            read(serialized)
        except RefusedError as refused:
            sentence = str(refused)
        assert len(sentence) < 250
        assert not sentence or sentence.isprintable()


@given(st.binary(max_size=400))
def test_random_bytes_are_refused_in_a_sentence(serialized: bytes) -> None:
    take(serialized)


def test_f20_every_truncation_is_refused() -> None:
    image, info = valid_messages()
    for cut in range(len(image) - 1):
        with pytest.raises(RefusedError):
            checked_image("color", image[:cut])
    for cut in range(len(info) - 8):  # the last fields hold do_rectify, which is not read
        with pytest.raises(RefusedError):
            read_camera(info[:cut])


def test_mutated_messages_are_read_or_refused() -> None:
    """20 000 here; `make fuzz` runs a million."""
    mutate(20_000)


@pytest.mark.fuzz
def test_a_million_mutated_messages_are_read_or_refused() -> None:
    mutate(1_000_000)


def mutate(number: int) -> None:
    chance, seeds = random.Random(7), valid_messages()
    for i in range(number):
        message = bytearray(seeds[i % 2])
        for _ in range(chance.randint(1, 8)):
            at = chance.randrange(min(len(message), 140))
            message[at] = chance.choice((0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)))
        if chance.random() < 0.2:
            del message[chance.randrange(len(message)) :]
        take(bytes(message))
