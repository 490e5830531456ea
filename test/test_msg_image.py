"""Images: what the adapters accept becomes exactly the right array, everything else one sentence (faults F16-F24)."""

from __future__ import annotations

import dataclasses
import tracemalloc
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from msg_adapters.cdr import Header, Stamp
from msg_adapters.image import check_color, check_depth, decode_color, decode_depth, depth_from_mm


@dataclass(frozen=True)
class FakeImage:
    """Just the fields: no ROS class is needed to decode."""

    height: int
    width: int
    encoding: str
    step: int
    data: object
    is_bigendian: int = 0
    header: Header = field(default_factory=lambda: Header(Stamp(1, 0), "camera"))


def packed(pixels: NDArray[np.generic], encoding: str, padding: int = 0, bigendian: bool = False) -> FakeImage:
    """Return a message of `pixels` with `padding` bytes of rubbish behind each row."""
    wire = pixels.astype(pixels.dtype.newbyteorder(">")) if bigendian else pixels
    rows = np.ascontiguousarray(wire).reshape(len(pixels), -1).view(np.uint8)
    rows = np.hstack([rows, np.full((len(pixels), padding), 0xAB, np.uint8)])
    return FakeImage(pixels.shape[0], pixels.shape[1], encoding, rows.shape[1], rows.tobytes(), int(bigendian))


@pytest.fixture
def rgb(rng: np.random.Generator) -> NDArray[np.uint8]:
    return rng.integers(0, 256, (5, 7, 3), dtype=np.uint8)


@pytest.mark.parametrize("padding", (0, 1, 5))
@pytest.mark.parametrize("encoding", ("rgb8", "bgr8", "rgba8", "bgra8"))
def test_colour_decodes_to_the_same_rgb(rgb: NDArray[np.uint8], encoding: str, padding: int) -> None:
    channels = rgb if encoding.startswith("rgb") else rgb[..., ::-1]
    if encoding.endswith("a8"):
        channels = np.dstack([channels, np.full((5, 7), 9, np.uint8)])
    decoded = decode_color(packed(channels, encoding, padding))
    assert decoded.flags.c_contiguous
    np.testing.assert_array_equal(decoded, rgb)


def test_mono8_becomes_grey(rng: np.random.Generator) -> None:
    grey = rng.integers(0, 256, (5, 7), dtype=np.uint8)
    np.testing.assert_array_equal(decode_color(packed(grey, "mono8", 3)), np.dstack([grey] * 3))


def test_unpadded_rgb8_is_not_copied(rgb: NDArray[np.uint8]) -> None:
    message = packed(rgb, "rgb8")
    assert np.shares_memory(decode_color(message), np.frombuffer(message.data, np.uint8))  # type: ignore[call-overload]


@pytest.mark.parametrize("bigendian", (False, True))
@pytest.mark.parametrize("padding", (0, 1, 6))
@pytest.mark.parametrize("encoding", ("16UC1", "mono16"))
def test_millimetres_become_metres_and_zero_becomes_nan(encoding: str, padding: int, bigendian: bool) -> None:
    mm = np.array([[0, 500, 1234], [65535, 1000, 2001]], np.uint16)
    decoded = decode_depth(packed(mm, encoding, padding, bigendian))
    assert decoded.dtype == np.float32
    assert decoded.dtype.isnative
    np.testing.assert_array_equal(decoded, depth_from_mm(mm))
    np.testing.assert_allclose(decoded, [[np.nan, 0.5, 1.234], [65.535, 1.0, 2.001]], rtol=1e-6)


@pytest.mark.parametrize("bigendian", (False, True))
@pytest.mark.parametrize("padding", (0, 2))
def test_f22_metres_stay_and_what_was_not_measured_becomes_nan(padding: int, bigendian: bool) -> None:
    depth = np.array([[1.5, 0.0, -1.0, np.nan], [np.inf, -np.inf, 2.25, 3.0]], np.float32)
    decoded = decode_depth(packed(depth, "32FC1", padding, bigendian))
    np.testing.assert_array_equal(decoded, np.array([[1.5, np.nan, np.nan, np.nan], [np.nan, np.nan, 2.25, 3]], "f4"))


@pytest.mark.parametrize("value", (0.0, np.nan, np.inf, -np.inf, -2.0))
def test_f22_a_depth_image_without_a_measurement_is_all_nan_without_a_warning(value: float) -> None:
    decoded = decode_depth(packed(np.full((40, 40), value, np.float32), "32FC1"))
    assert np.isnan(decoded).all()


@pytest.mark.parametrize(
    "encoding", ("", "yuv422", "8UC1", "8UC3", "16UC1", "RGB8", "x" * 10_000_000, "r\x1b[31mgb8\n", "цвет", None)
)
def test_f16_unknown_colour_encodings_are_refused_in_a_short_clean_sentence(encoding: object) -> None:
    message = dataclasses.replace(packed(np.zeros((2, 2, 3), np.uint8), "rgb8"), encoding=encoding)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^colour image has encoding .*; allowed are rgb8, bgr8") as refused:
        check_color(message)
    shown = str(refused.value)
    assert shown.isascii()
    assert shown.isprintable()
    assert len(shown) < 40 + 100


@pytest.mark.parametrize(("encoding", "helps"), (("bayer_rggb8", True), ("yuv422_yuy2", True), ("8UC2", False)))
def test_f16_colour_that_image_proc_turns_into_rgb_is_refused_with_its_name(encoding: str, helps: bool) -> None:
    message = dataclasses.replace(packed(np.zeros((2, 2, 3), np.uint8), "rgb8"), encoding=encoding)
    with pytest.raises(ValueError, match="colour image has encoding") as refused:
        check_color(message)
    assert str(refused.value).endswith("; image_proc makes bgr8 of it") == helps


@pytest.mark.parametrize("encoding", ("8UC1", "rgb8", "mono8", "64FC1", ""))
def test_f17_depth_in_another_encoding_is_refused(encoding: str) -> None:
    with pytest.raises(ValueError, match=r"depth image has encoding .*; allowed are 16UC1, mono16, 32FC1"):
        check_depth(packed(np.zeros((2, 2), np.uint8), encoding))


def wrong(**changes: object) -> FakeImage:
    return dataclasses.replace(packed(np.zeros((4, 6, 3), np.uint8), "rgb8"), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("message", "sentence"),
    (
        (wrong(step=17), "step 17; a row of 6 rgb8 pixels needs 18 bytes"),
        (wrong(step=0), "step 0; a row of 6"),
        (wrong(step=19), "has 72 bytes; step 19 x height 4 is 76"),
        (wrong(data=bytes(71)), "has 71 bytes; step 18 x height 4 is 72"),
        (wrong(data=b""), "has 0 bytes"),
        (wrong(height=0), "6x0; each side must be 1 to 8192"),
        (wrong(width=0), "0x4"),
        (wrong(height=2**31, step=2**31), f"6x{2**31}"),
        (wrong(width=2**31), f"{2**31}x4"),
        (wrong(height=8192, width=8192, step=3 * 8192), "has 72 bytes"),
    ),
)
def test_f18_to_f21_sizes_that_do_not_fit_are_refused_before_anything_is_allocated(
    message: FakeImage, sentence: str
) -> None:
    tracemalloc.start()
    try:
        for decode in (check_color, decode_color):
            with pytest.raises(ValueError, match=sentence):
                decode(message)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100_000


def test_f23_millimetres_sent_as_float_are_refused() -> None:
    with pytest.raises(ValueError, match="median depth is 2000 m; check the depth unit"):
        decode_depth(packed(np.full((480, 640), 2000.0, np.float32), "32FC1"))


def test_f23_metres_sent_as_integers_are_refused() -> None:
    with pytest.raises(ValueError, match="median depth is 3 mm; check the depth unit"):
        decode_depth(packed(np.full((480, 640), 3, np.uint16), "16UC1"))


def test_plausible_depth_passes_the_check_of_the_unit() -> None:
    near, far = np.full((480, 640), 60, np.uint16), np.full((480, 640), 150.0, np.float32)
    assert decode_depth(packed(near, "16UC1"))[0, 0] == pytest.approx(0.06)
    assert decode_depth(packed(far, "32FC1"))[0, 0] == 150.0
