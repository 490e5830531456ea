"""CompressedImage and compressedDepth: decoded exactly, refused before a bomb unfolds."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from msg_adapters.cdr import Header, Stamp, WireCompressedImage
from msg_adapters.compressed import (
    check_compressed_color,
    check_compressed_depth,
    decode_compressed_color,
    decode_compressed_depth,
)

HEADER = Header(Stamp(1, 0), "camera")


def message(content: bytes, kind: str) -> WireCompressedImage:
    return WireCompressedImage(HEADER, kind, memoryview(content))


def encoded(suffix: str, pixels: NDArray[Any]) -> bytes:
    done, content = cv2.imencode(suffix, pixels)
    assert done
    return bytes(content)


def depth_message(
    pixels: NDArray[np.uint16], kind: str = "16UC1", a: float = 0.0, b: float = 0.0
) -> WireCompressedImage:
    return message(struct.pack("<iff", 0, a, b) + encoded(".png", pixels), f"{kind}; compressedDepth png")


@pytest.fixture
def rgb(rng: np.random.Generator) -> NDArray[np.uint8]:
    return cv2.GaussianBlur(rng.integers(0, 256, (40, 60, 3), dtype=np.uint8), (0, 0), 5).astype(np.uint8)


def test_png_colour_is_exact(rgb: NDArray[np.uint8]) -> None:
    content = encoded(".png", rgb[..., ::-1])
    np.testing.assert_array_equal(decode_compressed_color(message(content, "rgb8; png compressed bgr8")), rgb)
    assert check_compressed_color(message(content, "png")) == (40, 60)


def test_jpeg_colour_is_near(rgb: NDArray[np.uint8]) -> None:
    content = encoded(".jpg", rgb[..., ::-1])
    decoded = decode_compressed_color(message(content, "jpeg"))
    assert check_compressed_color(message(content, "jpeg")) == (40, 60)
    assert np.abs(decoded.astype(int) - rgb).mean() < 3.0


@pytest.mark.parametrize("suffix", (".jpg", ".png"))
@pytest.mark.parametrize("zeros", (1, 62, 63, 64, 500, 5000))
def test_zeros_behind_a_picture_are_no_part_of_it(rgb: NDArray[np.uint8], suffix: str, zeros: int) -> None:
    content = encoded(suffix, rgb)
    padded = message(content + bytes(zeros), suffix)
    np.testing.assert_array_equal(decode_compressed_color(padded), decode_compressed_color(message(content, suffix)))
    with pytest.raises(ValueError, match="is cut"):
        check_compressed_color(message(content[:-1] + bytes(zeros), suffix))


def test_grey_is_repeated_and_transparency_dropped(rgb: NDArray[np.uint8]) -> None:
    grey = decode_compressed_color(message(encoded(".png", rgb[..., 0]), "mono8; png compressed"))
    np.testing.assert_array_equal(grey, np.dstack([rgb[..., 0]] * 3))
    alpha = np.dstack([rgb[..., ::-1], np.full((40, 60), 9, np.uint8)])
    np.testing.assert_array_equal(decode_compressed_color(message(encoded(".png", alpha), "rgba8; png")), rgb)


def test_millimetres_are_exact(rng: np.random.Generator) -> None:
    mm = rng.integers(300, 9000, (40, 60)).astype(np.uint16)
    mm[0, 0] = 0
    decoded = decode_compressed_depth(depth_message(mm))
    assert np.isnan(decoded[0, 0])
    np.testing.assert_array_equal(decoded[mm > 0], (mm.astype(np.float32) * np.float32(0.001))[mm > 0])
    assert check_compressed_depth(depth_message(mm)) == (40, 60)


@pytest.mark.parametrize("kind", ("16UC1; png compressed ", "16UC1; png compressed 16UC1", "16UC1;png compressed"))
def test_depth_that_is_compressed_as_colour_is_but_as_png_loses_nothing(kind: str, rng: np.random.Generator) -> None:
    mm = rng.integers(300, 9000, (40, 60)).astype(np.uint16)
    as_picture = message(encoded(".png", mm), kind)
    np.testing.assert_array_equal(decode_compressed_depth(as_picture), decode_compressed_depth(depth_message(mm)))
    assert check_compressed_depth(as_picture) == (40, 60)
    with pytest.raises(ValueError, match="no PNG of 16-bit grey"):
        check_compressed_depth(message(encoded(".png", mm.astype(np.uint8)), kind))
    with pytest.raises(ValueError, match="holds no PNG"):
        check_compressed_depth(message(encoded(".jpg", mm.astype(np.uint8)), kind))


def test_quantised_inverse_depth_is_undone() -> None:
    """As compressed_depth_image_transport writes it: step = A / z + B."""
    depth_m = np.linspace(0.5, 9.5, 2400).reshape(40, 60)
    a, b = 100.0 * (100.0 + 1.0), 1.0 - 100.0 * (100.0 + 1.0) / 10.0
    steps = np.floor(a / depth_m + b).astype(np.uint16)
    steps[0, 0] = 0
    decoded = decode_compressed_depth(depth_message(steps, "32FC1", a, b))
    assert np.isnan(decoded[0, 0])
    np.testing.assert_allclose(decoded.ravel()[1:], depth_m.ravel()[1:], rtol=2e-3)


@pytest.mark.parametrize(
    "kind", ("16UC1; compressedDepth rvl", "mono8; compressedDepth", "32FC1; png compressed", "jpeg", "", "x" * 10_000)
)
def test_another_format_of_depth_is_refused(kind: str) -> None:
    good = depth_message(np.full((4, 4), 1000, np.uint16))
    with pytest.raises(ValueError, match="depth image has format") as refused:
        check_compressed_depth(message(bytes(good.data), kind))
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("suffix", (".png", ".jpg"))
def test_f20_every_cut_is_refused(rgb: NDArray[np.uint8], suffix: str) -> None:
    content = encoded(suffix, rgb)
    for cut in range(0, len(content) - 2, 7):
        with pytest.raises(ValueError, match=r"cut|neither PNG nor JPEG"):
            decode_compressed_color(message(content[:cut], "x"))


def test_bytes_that_are_no_picture_are_refused() -> None:
    with pytest.raises(ValueError, match="neither PNG nor JPEG"):
        check_compressed_color(message(b"GIF89a" + bytes(100), "gif"))
    with pytest.raises(ValueError, match="holds no PNG"):
        check_compressed_depth(message(bytes(200), "16UC1; compressedDepth"))
    content = bytes(12) + encoded(".png", np.zeros((4, 4), np.uint8))
    with pytest.raises(ValueError, match="no PNG of 16-bit grey"):
        check_compressed_depth(message(content, "16UC1; compressedDepth"))


@pytest.mark.parametrize("side", (8192, 65535, 2**31 - 1))
def test_a_bomb_is_refused_by_its_header(side: int) -> None:
    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0))
    bomb = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    for check, content, kind in (
        (check_compressed_color, bomb, "png"),
        (check_compressed_depth, bytes(12) + bomb, "16UC1; compressedDepth"),
    ):
        with pytest.raises(ValueError, match=f"{side}x{side}; each side must be"):
            check(message(content, kind))


def test_a_damaged_picture_is_refused(rgb: NDArray[np.uint8]) -> None:
    content = bytearray(encoded(".png", rgb))
    content[60:90] = bytes(30)
    with pytest.raises(ValueError, match="damaged"):
        decode_compressed_color(message(bytes(content), "png"))


def test_the_wrong_unit_is_refused_here_too() -> None:
    with pytest.raises(ValueError, match="check the depth unit"):
        decode_compressed_depth(depth_message(np.full((40, 60), 3, np.uint16)))


def test_quantisation_that_makes_no_sense_is_refused() -> None:
    pixels = np.full((40, 60), 500, np.uint16)
    for a in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="quantisation parameters"):
            decode_compressed_depth(depth_message(pixels, "32FC1", a, 0.0))
