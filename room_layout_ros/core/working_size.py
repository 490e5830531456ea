"""The size at which a frame is worked on: larger images are reduced by a whole factor, results have the full size.

A room shows as well in a smaller picture, and the time of most stages grows with the pixels
(`python -m benchmarks working_size`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import depth_sigma
from .estimate import RoomEstimate
from .frame import CameraIntrinsics, RgbdFrame

_SAME_SURFACE = 3.0
"""Depths of a block are of one surface within so many standard deviations of the measurement."""

_STRIP = 1024
"""So many blocks are gone through at a time: their sums stay in the cache."""


def reduction(camera: CameraIntrinsics, working_size_px: int) -> int:
    """Return the whole factor that leaves the longer side of the image no shorter than the working size."""
    sides = camera.width, camera.height
    return max(1, min(max(sides) // working_size_px, *sides))


def reduce_frame(frame: RgbdFrame, working_size_px: int) -> RgbdFrame:
    """Return the frame at the working size; the frame itself where it is no larger.

    A pixel's colour is the mean of its block; its depth the mean of what lies on one surface with the middle of the
    block, so that no depth lies between a thing and the wall behind it. Pixels at the right and lower side that fill
    no block are left out.
    """
    step = reduction(frame.camera, working_size_px)
    if step == 1:
        return frame
    camera = _reduced_camera(frame.camera, step)
    color, depth_m = frame.color, frame.depth_m
    if color is not None:
        whole = color[: camera.height * step, : camera.width * step]
        color = np.asarray(cv2.resize(whole, (camera.width, camera.height), interpolation=cv2.INTER_AREA), np.uint8)
    if depth_m is not None:
        depth_m = _reduce_depth(depth_m, step, camera.height, camera.width)
    return replace(frame, camera=camera, color=color, depth_m=depth_m)


def reduce_estimate(estimate: RoomEstimate, camera: CameraIntrinsics, working_size_px: int) -> RoomEstimate:
    """Return an estimate as it is of the reduced frame; `camera` is that of the full one."""
    step = reduction(camera, working_size_px)
    if step == 1:
        return estimate
    small = _reduced_camera(camera, step)
    return _resize(estimate, lambda image: _middle_pixels(image, step, small), small)


def enlarge_estimate(estimate: RoomEstimate, camera: CameraIntrinsics, working_size_px: int) -> RoomEstimate:
    """Return the estimate of a reduced frame at the size of the full one; `camera` is that of the full one.

    The layout is drawn anew from the cuboid, so its edges are as sharp as the camera's pixels; a label that is that
    of the layout follows it.
    """
    step = reduction(camera, working_size_px)
    whole = _resize(estimate, lambda image: _fill_blocks(image, step, camera), camera)
    if estimate.cuboid is None:
        return whole
    layout = estimate.cuboid.raster(camera)
    return replace(whole, layout=layout, labels=np.where(whole.labels == whole.layout, layout, whole.labels))


def _resize(
    estimate: RoomEstimate, resize: Callable[[NDArray[Any]], NDArray[Any]], camera: CameraIntrinsics
) -> RoomEstimate:
    """The estimate as `camera` sees it: each image resized, polygons cut out anew."""
    return replace(
        estimate,
        layout=resize(estimate.layout),
        labels=resize(estimate.labels),
        furniture=resize(estimate.furniture),
        superpixels=resize(estimate.superpixels),
        polygons=() if estimate.cuboid is None else estimate.cuboid.polygons(camera),
    )


def _reduced_camera(camera: CameraIntrinsics, step: int) -> CameraIntrinsics:
    """The camera whose pixels are blocks of `step` x `step`."""
    return replace(
        camera,
        width=camera.width // step,
        height=camera.height // step,
        fx=camera.fx / step,
        fy=camera.fy / step,
        cx=(camera.cx + 0.5) / step - 0.5,
        cy=(camera.cy + 0.5) / step - 0.5,
    )


def _middle_pixels(image: NDArray[Any], step: int, small: CameraIntrinsics) -> NDArray[Any]:
    """One pixel of each block."""
    middle = image[step // 2 :: step, step // 2 :: step]
    return np.ascontiguousarray(middle[: small.height, : small.width])


def _fill_blocks(image: NDArray[Any], step: int, camera: CameraIntrinsics) -> NDArray[Any]:
    """Blocks of one value; pixels that fill no block have that of the last."""
    rows = np.minimum(np.arange(camera.height) // step, image.shape[0] - 1)
    columns = np.minimum(np.arange(camera.width) // step, image.shape[1] - 1)
    return np.take(np.take(image, columns, axis=1), rows, axis=0)


def _reduce_depth(depth_m: NDArray[np.float32], step: int, rows: int, cols: int) -> NDArray[np.float32]:
    """(rows, cols) float32 depth of the blocks; NaN where none of a block was measured."""
    blocks = depth_m[: rows * step, : cols * step].reshape(rows, step, cols, step)
    planes = np.ascontiguousarray(blocks.transpose(1, 3, 0, 2)).reshape(step * step, rows * cols)
    return np.asarray(_mean_on_surface(planes).reshape(rows, cols), np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_on_surface(planes):  # type: ignore[no-untyped-def]
    """(n,) mean of the depths that lie on one surface with that of the middle plane, or the first plane that has one.

    `planes` : (k, n) float32, a pixel of each of n blocks in a plane: so the loops run on vectors.
    """
    k, n = planes.shape
    mean, count = np.empty(n, np.float32), np.empty(_STRIP, np.float32)
    middle, near = np.empty(_STRIP, np.float32), np.empty(_STRIP, np.float32)
    for first in range(0, n, _STRIP):
        last = min(first + _STRIP, n)
        total = mean[first:last]
        middle[:] = 0.0
        for m in range(k):
            depths = planes[(k // 2 + m) % k, first:last]
            for i in range(last - first):
                first_found = (middle[i] == 0.0) & (depths[i] > 0.0) & (depths[i] < np.inf)
                middle[i] = depths[i] if first_found else middle[i]
        for i in range(last - first):
            near[i] = _SAME_SURFACE * depth_sigma(middle[i])
            total[i] = count[i] = 0.0
        for m in range(k):
            depths = planes[m, first:last]
            for i in range(last - first):
                same = (middle[i] > 0.0) & (abs(depths[i] - middle[i]) <= near[i])  # false for NaN
                total[i] += depths[i] if same else np.float32(0.0)
                count[i] += np.float32(1.0) if same else np.float32(0.0)
        for i in range(last - first):
            total[i] /= count[i]  # 0 / 0 is NaN
    return mean
