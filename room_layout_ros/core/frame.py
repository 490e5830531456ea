"""The input of the estimator: one colour + depth frame and its camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

MAX_SIDE_PX = 8192


@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """Pinhole camera in pixels; optical frame of REP-103 (x right, y down, z forward).

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point in pixels; pixel centres are at integers.

    Raises
    ------
    ValueError
        When a value is not finite, a size is outside 1..8192 or a focal length is not positive.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if not (0 < self.width <= MAX_SIDE_PX and 0 < self.height <= MAX_SIDE_PX):
            raise ValueError(f"camera size is {self.width}x{self.height}; each side must be 1 to {MAX_SIDE_PX} pixels")
        values = self.numbers
        if not all(np.isfinite(values)):
            raise ValueError(f"camera intrinsics (fx, fy, cx, cy) are {values}; all must be finite")
        if self.fx <= 0 or self.fy <= 0:
            raise ValueError(
                f"focal lengths are ({self.fx}, {self.fy}) px; both must be above 0 (is the camera calibrated?)"
            )

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point (fx, fy, cx, cy), as kernels take them."""
        return self.fx, self.fy, self.cx, self.cy

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) intrinsic matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def rays(self) -> NDArray[np.float32]:
        """(height, width, 3) float32 rays K^-1 (x, y, 1); z = 1. Cached per camera and read-only."""
        return _rays(self)

    def scaled(self, factor: float) -> CameraIntrinsics:
        """Return the camera of the image resized by `factor` (pixel centres at integers)."""
        return replace(
            self,
            width=round(self.width * factor),
            height=round(self.height * factor),
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=(self.cx + 0.5) * factor - 0.5,
            cy=(self.cy + 0.5) * factor - 0.5,
        )


@lru_cache(maxsize=4)
def _rays(camera: CameraIntrinsics) -> NDArray[np.float32]:
    rays = np.ones((camera.height, camera.width, 3), dtype=np.float32)
    rays[..., 0] = (np.arange(camera.width) - camera.cx) / camera.fx
    rays[..., 1] = ((np.arange(camera.height) - camera.cy) / camera.fy)[:, None]
    rays.setflags(write=False)
    return rays


@dataclass(frozen=True, slots=True)
class RgbdFrame:
    """One look into a room. Colour and depth are registered: same camera, same size.

    Parameters
    ----------
    camera : CameraIntrinsics
        Of both images; the images are rectified.
    color : (H, W, 3) uint8 array or None
        RGB.
    depth_m : (H, W) float32 array or None
        Distance along the optical axis in metres; NaN where nothing was measured.
        Zero, negative and infinite values count as not measured too.
    stamp_ns : int
        Time of the depth image in nanoseconds.
    frame_id : str
        Optical frame of the camera.
    name : str
        Name of the frame in its source ("0059"), for files.

    Raises
    ------
    ValueError
        When both images are None, or a shape or dtype is not as stated.
    """

    camera: CameraIntrinsics
    color: NDArray[np.uint8] | None = None
    depth_m: NDArray[np.float32] | None = None
    stamp_ns: int = 0
    frame_id: str = ""
    name: str = ""

    def __post_init__(self) -> None:
        if self.color is None and self.depth_m is None:
            raise ValueError("frame has neither colour nor depth; at least one is needed")
        size = (self.camera.height, self.camera.width)
        _check_image("colour", self.color, (*size, 3), np.dtype(np.uint8))
        _check_image("depth", self.depth_m, size, np.dtype(np.float32))

    def without_depth(self) -> RgbdFrame:
        """Return the frame with its colour image only."""
        return replace(self, depth_m=None)


def _check_image(
    what: str, image: NDArray[np.generic] | None, shape: tuple[int, ...], dtype: np.dtype[np.generic]
) -> None:
    if image is None:
        return
    if image.shape != shape:
        raise ValueError(f"{what} image has shape {image.shape}; the camera says {shape}")
    if image.dtype != dtype:
        raise ValueError(f"{what} image is {image.dtype}; it must be {dtype}")
