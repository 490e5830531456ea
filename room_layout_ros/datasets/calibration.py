"""Camera calibration files (ROS camera calibration YAML)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.decoding.camera_info import camera_warning, may_be_bent, off_centre

from .errors import DataError

MAX_YAML_BYTES = 65536
_NEEDED = "a ROS camera calibration with image_width, image_height and camera_matrix is needed"
_NO_ROTATION = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_SIZES = {"camera_matrix": 9, "rectification_matrix": 9, "projection_matrix": 12}
_OPENCV_HEAD, _OPENCV_TAG = "%YAML:1.0", "!!opencv-matrix"
"""What OpenCV's FileStorage writes that no YAML reader takes; its matrices have the key `data`, as ROS's have."""


@dataclass(frozen=True, slots=True)
class CameraCalibration:
    """A calibration as ROS writes it, row-major; lists are kept as they are so that copies lose nothing.

    Attributes
    ----------
    width, height : pixels.
    K : 9 numbers, intrinsics of the raw image. D : distortion. R : 9, rectification.
    P : 12, projection of the rectified image; all zero where not given.
    warning : what is odd about the file or message that it is of, usable all the same; "" where nothing is.
    """

    width: int
    height: int
    K: tuple[float, ...]
    D: tuple[float, ...] = ()
    R: tuple[float, ...] = _NO_ROTATION
    P: tuple[float, ...] = (0.0,) * 12
    distortion_model: str = "plumb_bob"
    camera_name: str = "camera"
    warning: str = field(default="", compare=False)

    @classmethod
    def from_intrinsics(cls, camera: CameraIntrinsics, name: str = "camera") -> CameraCalibration:
        """Return the calibration of an ideal camera."""
        fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
        K = (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
        P = (fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
        return cls(camera.width, camera.height, K, (0.0,) * 5, P=P, camera_name=name)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Pinhole camera of the rectified image: P where given, else K.

        Raises
        ------
        DataError
            When the numbers are no camera.
        """
        fx, fy, cx, cy = (self.P[i] for i in (0, 5, 2, 6)) if any(self.P) else (self.K[i] for i in (0, 4, 2, 5))
        try:
            return CameraIntrinsics(self.width, self.height, fx, fy, cx, cy)
        except ValueError as error:
            raise DataError(str(error)) from None

    @property
    def is_distorted(self) -> bool:
        """Whether any distortion coefficient is not zero."""
        return any(self.D)


def read_calibration(path: Path) -> CameraCalibration:
    """Read a ROS camera calibration YAML, or one of the same names that OpenCV's FileStorage wrote.

    Raises
    ------
    DataError
        When the file is missing, too large, no YAML, or lacks a field.
    """
    try:
        if path.stat().st_size > MAX_YAML_BYTES:
            raise DataError(f"{path} is {path.stat().st_size} bytes; a camera calibration has at most {MAX_YAML_BYTES}")
        # Aliases of a calibration file have no use, but could expand without bound ("billion laughs").
        text = path.read_text(encoding="utf-8").removeprefix(_OPENCV_HEAD).replace(_OPENCV_TAG, "")
        if any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text, Loader=yaml.SafeLoader)):
            raise DataError(f"{path} uses YAML aliases; a camera calibration must not")
        fields = yaml.safe_load(text)
    except FileNotFoundError:
        raise DataError(f"{path} is missing; it must hold the ROS camera calibration") from None
    except (yaml.YAMLError, UnicodeDecodeError):
        raise DataError(f"{path} is no YAML; {_NEEDED}") from None
    if not isinstance(fields, dict):
        raise DataError(f"{path} holds no camera calibration; {_NEEDED}")
    return _calibration(fields, path)


def _calibration(fields: dict[str, Any], path: Path) -> CameraCalibration:
    lists = {}
    for key in ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix"):
        if key in fields:
            lists[key] = _numbers(fields[key], key, path)
    if "camera_matrix" not in lists:
        raise DataError(f"{path} has no camera_matrix; {_NEEDED}")
    try:
        width, height = int(fields["image_width"]), int(fields["image_height"])
    except (KeyError, TypeError, ValueError):
        raise DataError(f"{path} has no whole numbers image_width and image_height") from None
    calibration = CameraCalibration(
        width,
        height,
        lists["camera_matrix"],
        lists.get("distortion_coefficients", ()),
        lists.get("rectification_matrix", _NO_ROTATION),
        lists.get("projection_matrix", (0.0,) * 12),
        str(fields.get("distortion_model", "plumb_bob")),
        str(fields.get("camera_name", "camera")),
    )
    try:
        camera = calibration.intrinsics
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    bent = "has distortion but the same K and P, or no P; if the images are not rectified, the room will be bent"
    doubts = (
        bent if may_be_bent(calibration.K, calibration.P, calibration.D) else "",
        off_centre(width, height, camera.cx, camera.cy),
    )
    return replace(calibration, warning=camera_warning(str(path), *doubts))


def _numbers(field: object, key: str, path: Path) -> tuple[float, ...]:
    values = field.get("data") if isinstance(field, dict) else field
    if isinstance(values, list) and values and all(isinstance(row, list) for row in values):
        values = [value for row in values for value in row]
    try:
        numbers = tuple(float(v) for v in values)  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise DataError(f"{path}: {key} is no list of numbers, nor `data:` with one, nor rows") from None
    if len(numbers) != _SIZES.get(key, len(numbers)):
        raise DataError(f"{path}: {key} has {len(numbers)} numbers; it must have {_SIZES[key]}")
    return numbers


def write_calibration(path: Path, calibration: CameraCalibration) -> None:
    """Write a ROS camera calibration YAML; reading it gives an equal value."""

    def matrix(values: tuple[float, ...], rows: int) -> str:
        columns = len(values) // rows
        return f"\n  rows: {rows}\n  cols: {columns}\n  data: [{', '.join(repr(float(v)) for v in values)}]\n"

    c = calibration
    text = f"image_width: {c.width}\nimage_height: {c.height}\ncamera_name: {_quoted(c.camera_name)}\n"
    text += "camera_matrix:" + matrix(c.K, 3)
    text += f"distortion_model: {_quoted(c.distortion_model)}\ndistortion_coefficients:" + matrix(c.D, 1)
    text += "rectification_matrix:" + matrix(c.R, 3) + "projection_matrix:" + matrix(c.P, 3)
    path.write_text(text, encoding="utf-8")


def _quoted(text: str) -> str:
    """Return the YAML of a string that no reader takes for a number, a truth value or nothing."""
    return str(yaml.safe_dump(text, default_style='"', allow_unicode=True, width=float("inf"))).strip()
