"""CameraInfo -> the camera of the image that was received (faults F27-F29)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from msg_adapters.camera_info import check_size, decode_camera_info
from msg_adapters.cdr import Header, Region, Stamp

K = (500.0, 0, 320.0, 0, 510.0, 240.0, 0, 0, 1)
P = (450.0, 0, 310.0, 0, 0, 460.0, 235.0, 0, 0, 0, 1, 0)


@dataclass(frozen=True)
class FakeInfo:
    """Fields of a CameraInfo; K and P differ, as those of a lens with distortion do."""

    k: tuple[float, ...] = K
    p: tuple[float, ...] = P
    d: tuple[float, ...] = ()
    width: int = 640
    height: int = 480
    binning_x: int = 0
    binning_y: int = 0
    roi: Region = field(default_factory=lambda: Region(0, 0, 0, 0))
    header: Header = field(default_factory=lambda: Header(Stamp(1, 0), "camera"))


def test_the_rectified_image_has_the_camera_of_P() -> None:
    reading = decode_camera_info(FakeInfo())
    camera = reading.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (450.0, 460.0, 310.0, 235.0)
    assert (camera.width, camera.height, reading.frame_id, reading.warning) == (640, 480, "camera", "")


def test_K_stands_in_for_an_empty_P_without_distortion_only() -> None:
    assert decode_camera_info(FakeInfo(p=(0.0,) * 12)).camera.fx == 500.0
    with pytest.raises(ValueError, match="P of zeros"):
        decode_camera_info(FakeInfo(p=(0.0,) * 12, d=(0.1, 0, 0, 0, 0)))


@pytest.mark.parametrize("binning", (1, 2, 4))
def test_f28_region_and_binning_give_the_camera_that_sees_the_same_rays(binning: int) -> None:
    """The centre of a binned pixel must have the ray of the middle of the pixels that it joins."""
    info = FakeInfo(roi=Region(100, 60, 240, 320), binning_x=binning, binning_y=binning)
    small, full = decode_camera_info(info).camera, decode_camera_info(FakeInfo()).camera
    assert (small.width, small.height) == (320 // binning, 240 // binning)
    for x, y in ((0, 0), (17, 5)):
        first = np.array([100 + x * binning, 60 + y * binning])
        middle = first + (binning - 1) / 2
        assert (x - small.cx) / small.fx == pytest.approx((middle[0] - full.cx) / full.fx)
        assert (y - small.cy) / small.fy == pytest.approx((middle[1] - full.cy) / full.fy)


@pytest.mark.parametrize(
    ("info", "sentence"),
    (
        (FakeInfo(k=(0.0,) * 9, p=(0.0,) * 12), "uncalibrated"),
        (FakeInfo(p=(np.nan, *P[1:])), "not finite; is the camera calibrated"),
        (FakeInfo(k=(np.inf, *K[1:])), "not finite"),
        (FakeInfo(p=(-450.0, *P[1:])), "focal lengths"),
        (FakeInfo(p=(450.0, 0, 310.0, 0, 0, 0.0, 235.0, 0, 0, 0, 1, 0)), "focal lengths"),
        (FakeInfo(k=K[:8]), "8 values in K and 12 in P"),
        (FakeInfo(p=()), "9 values in K and 0 in P"),
        (FakeInfo(width=0), "camera size"),
        (FakeInfo(width=2**31), "camera size"),
        (FakeInfo(roi=Region(400, 0, 480, 300)), "must lie inside 640x480"),
        (FakeInfo(binning_x=1000), "binning 1000x1"),
    ),
)
def test_f27_an_unusable_camera_info_is_refused(info: FakeInfo, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        decode_camera_info(info)


def test_f27_an_image_of_another_size_is_refused_with_both_sizes() -> None:
    with pytest.raises(ValueError, match="depth image is 320x240 but camera_info says 640x480"):
        check_size(decode_camera_info(FakeInfo()).camera, "depth", 240, 320)


def test_f29_distortion_with_K_equal_to_P_is_suspicious_but_used() -> None:
    same = (500.0, 0, 320.0, 0, 0, 510.0, 240.0, 0, 0, 0, 1, 0)
    reading = decode_camera_info(FakeInfo(p=same, d=(0.1, -0.2, 0, 0, 0)))
    assert reading.camera.fx == 500.0
    assert "bent" in reading.warning
    assert decode_camera_info(replace(FakeInfo(p=same), d=(0.0,) * 5)).warning == ""
    assert decode_camera_info(FakeInfo(d=(0.1, 0, 0, 0, 0))).warning == ""  # P differs from K: was rectified


@pytest.mark.parametrize(
    ("factor", "asked"), ((0.5, True), (2 / 3, True), (1 / 640, True), (1.0, False), (1.5, True), (2.0, True))
)
def test_intrinsics_of_another_image_size_are_asked_about_and_used(factor: float, asked: bool) -> None:
    """Of half or double the size, or in parts of the image: rooms of the wrong width came out with full confidence."""
    p = tuple(factor * v for v in P)
    warning = decode_camera_info(FakeInfo(p=p)).warning
    where = f"({310 * factor:g}, {235 * factor:g}), far from the middle of 640x480"
    words = f"camera_info has its principal point at {where}; are fx, fy, cx and cy of images of this size, in pixels?"
    assert warning == (words if asked else "")
    bent = decode_camera_info(FakeInfo(k=(p[0], 0, p[2], 0, p[5], p[6], 0, 0, 1), p=p, d=(0.1, 0, 0, 0, 0))).warning
    assert ("bent" in bent, "principal point" in bent) == (True, asked), "one doubt hides no other"


def test_a_region_of_interest_has_its_principal_point_where_it_likes() -> None:
    assert decode_camera_info(FakeInfo(roi=Region(0, 0, 240, 100))).warning == ""
