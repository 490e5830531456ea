"""sensor_msgs/CameraInfo -> CameraIntrinsics of the rectified image that was received."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from room_layout_ros.core.frame import CameraIntrinsics

from .protocols import CameraInfoLike

_MIDDLE = 0.35, 0.65
"""Where the principal point of a whole image lies, of its sides; with intrinsics of 2/3 of the size it is at 0.33."""


@dataclass(frozen=True, slots=True)
class CameraReading:
    """A checked CameraInfo.

    Attributes
    ----------
    camera : of the image as received (region of interest and binning applied).
    frame_id : optical frame.
    warning : one sentence where the message is usable but suspicious, else "".
    """

    camera: CameraIntrinsics
    frame_id: str
    warning: str


def decode_camera_info(message: CameraInfoLike) -> CameraReading:
    """Return the camera of the rectified image: from P, cut to the region of interest, then binned.

    Pixel centres are at integers, so that binning by b maps x to (x + 0.5) / b - 0.5 (as `CameraIntrinsics.scaled`).
    Where P is empty, K stands in for it if the lens has no distortion (then both are equal).

    Raises
    ------
    ValueError
        When the camera is not calibrated, a value is not finite, or region and binning do not fit the size.
    """
    K, P, D = (_matrix(message, name) for name in ("k", "p", "d"))
    if K.size != 9 or P.size != 12:
        raise ValueError(f"camera_info has {K.size} values in K and {P.size} in P; 9 and 12 are needed")
    if not (np.isfinite(K).all() and np.isfinite(P).all()):
        raise ValueError("camera_info has K or P with values that are not finite; is the camera calibrated?")
    distorted = bool(np.any(D != 0))
    if P[0] == 0 and P[5] == 0:
        if K[0] == 0 or distorted:
            raise ValueError(
                f"camera_info has P of zeros (K starts with {K[0]:g}); "
                "the camera is uncalibrated or its images are not rectified"
            )
        P = np.array([K[0], 0, K[2], 0, 0, K[4], K[5], 0, 0, 0, 1, 0])
    bent = "has distortion but the same K and P; if the images are not rectified, the room will be bent"
    whole = int(message.width), int(message.height)  # a region of interest says itself that it is a part
    doubts = bent if may_be_bent(K, P, D) else "", off_centre(*whole, float(P[2]), float(P[6]))
    warning = camera_warning("camera_info", *doubts)
    return CameraReading(_crop_and_bin(message, P), str(message.header.frame_id), warning)


def may_be_bent(K: ArrayLike, P: ArrayLike, D: ArrayLike) -> bool:
    """Whether a lens distorts and nothing says that its images are rectified: P (12,) is that of K (9,), or none."""
    k, p = np.asarray(K), np.asarray(P)
    distorted = bool((np.asarray(D) != 0).any())
    return distorted and (not (p != 0).any() or np.array_equal(p[[0, 2, 5, 6]], k[[0, 2, 4, 5]]))


def off_centre(width: int, height: int, cx: float, cy: float) -> str:
    """Return the question whether intrinsics are of images of this size; "" where the principal point is about amidst.

    Those of images of half or of double the size, or in parts of the image's width, are not; a cut image's may be.
    """
    if all(_MIDDLE[0] * side <= c <= _MIDDLE[1] * side for c, side in ((cx, width), (cy, height))):
        return ""
    return (
        f"has its principal point at ({cx:g}, {cy:g}), far from the middle of {width}x{height}; "
        "are fx, fy, cx and cy of images of this size, in pixels?"
    )


def camera_warning(what: str, *doubts: str) -> str:
    """Return doubts in a camera as one warning; `what` names the camera. "" where there is none."""
    said = " and ".join(doubt for doubt in doubts if doubt)
    return f"{what} {said}" if said else ""


def check_size(camera: CameraIntrinsics, what: str, height: int, width: int) -> None:
    """Raise ValueError unless the image has the size that camera_info says."""
    if (height, width) != (camera.height, camera.width):
        raise ValueError(
            f"{what} image is {width}x{height} but camera_info says {camera.width}x{camera.height}; they must be equal"
        )


def _matrix(message: CameraInfoLike, name: str) -> NDArray[np.float64]:
    values = getattr(message, name, None)
    if values is None:
        values = getattr(message, name.upper(), ())  # ROS 1 bags write K, P, D
    return np.asarray(values, dtype=np.float64).ravel()


def _crop_and_bin(message: CameraInfoLike, P: NDArray[np.float64]) -> CameraIntrinsics:
    width, height, roi = int(message.width), int(message.height), message.roi
    x0, y0 = int(roi.x_offset), int(roi.y_offset)
    w, h = int(roi.width) or width, int(roi.height) or height
    if (int(roi.width) or int(roi.height)) and not (x0 + w <= width and y0 + h <= height):
        raise ValueError(f"camera_info has a region of interest {w}x{h}+{x0}+{y0}; it must lie inside {width}x{height}")
    if not (int(roi.width) or int(roi.height)):
        x0 = y0 = 0
    bx, by = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    if bx > max(w, 1) or by > max(h, 1):
        raise ValueError(f"camera_info has binning {bx}x{by}; it must not exceed the image of {w}x{h}")
    return CameraIntrinsics(
        width=w // bx,
        height=h // by,
        fx=float(P[0]) / bx,
        fy=float(P[5]) / by,
        cx=(float(P[2]) - x0 + 0.5) / bx - 0.5,
        cy=(float(P[6]) - y0 + 0.5) / by - 0.5,
    )
