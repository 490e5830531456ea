"""The size at which a frame is worked on: images are resized by a whole factor, results have the camera's size.

A room shows as well in a smaller picture, and the time of most stages grows with the pixels. In a picture of few pixels
there are too few for what counts them (cells of depth, superpixels, edges), though it shows the room: it is enlarged
(`python -m benchmarks working_size`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from .color import block_means
from .depth import depth_sigma
from .estimate import RoomEstimate
from .frame import MAX_SIDE_PX, CameraIntrinsics, RgbdFrame

_SAME_SURFACE = 3.0
"""Depths of a block are of one surface within so many standard deviations of the measurement."""

_STEEPEST = 0.93
"""Neighbours are of one surface if the farther has at least this part of the inverse depth of the nearer."""

_LEAST_PX = 100
"""Longer side of an image that is enlarged; in a smaller one nothing is to be seen."""

_AS_LAYOUT = 255
"""Stands for the label of the layout while an image of labels is resized."""

_STRIP = 1024
"""So many blocks are gone through at a time: their sums stay in the cache."""


@dataclass(frozen=True, slots=True)
class ResizedFrame(RgbdFrame):
    """A frame at the working size; `original` is the one that it was made of."""

    original: RgbdFrame | None = None


def working_factors(camera: CameraIntrinsics, working_size_px: int) -> tuple[int, int]:
    """Return by what an image is reduced, and by what it is enlarged; whole, and one of them 1.

    The longer side is reduced to no less than the working size, and enlarged to what is nearest to it. With 0 images
    stay as they are, and so do those that are too small to show a room.
    """
    if working_size_px == 0 or max(camera.width, camera.height) < _LEAST_PX:
        return 1, 1
    sides = camera.width, camera.height
    shrink = max(1, min(max(sides) // working_size_px, *sides))
    return shrink, max(1, min(round(working_size_px / max(sides)), MAX_SIDE_PX // max(sides)))


def resize_frame(frame: RgbdFrame, working_size_px: int) -> RgbdFrame:
    """Return the frame at the working size; the frame itself where it has that.

    Reduced, a pixel's colour is the mean of its block; its depth the mean of what lies on one surface with the middle
    of the block, so that no depth lies between a thing and the wall behind it; pixels at the right and lower side that
    fill no block are left out. Enlarged, both lie between those of the neighbours, inverse depth only on one surface.
    """
    shrink, grow = working_factors(frame.camera, working_size_px)
    if shrink == grow:
        return frame
    camera = _resized_camera(frame.camera, shrink, grow)
    color, depth_m = frame.color, frame.depth_m
    if color is not None:
        color = block_means(color, shrink) if shrink > 1 else _enlarge_color(color, camera)
    if depth_m is not None:
        depth_m = _reduce_depth(depth_m, shrink) if shrink > 1 else _enlarge_depth(np.ascontiguousarray(depth_m), grow)
    return replace(frame, camera=camera, color=color, depth_m=depth_m)


def resize_keeping(frame: RgbdFrame, working_size_px: int) -> RgbdFrame:
    """Return the frame at the working size, which remembers the one it was made of (`original_of`)."""
    small = resize_frame(frame, working_size_px)
    if small is frame:
        return frame
    return ResizedFrame(small.camera, small.color, small.depth_m, frame.stamp_ns, frame.frame_id, frame.name, frame)


def original_of(frame: RgbdFrame) -> RgbdFrame:
    """Return the frame that a resized one was made of; any other frame itself."""
    return frame.original if isinstance(frame, ResizedFrame) and frame.original is not None else frame


def resize_estimate(estimate: RoomEstimate, camera: CameraIntrinsics, working_size_px: int) -> RoomEstimate:
    """Return the estimate of a frame of `camera` with its images at the working size: undoes `restore_estimate`."""
    shrink, grow = working_factors(camera, working_size_px)
    return _resize(estimate, _resized_camera(camera, shrink, grow), shrink, grow)


def restore_estimate(estimate: RoomEstimate, camera: CameraIntrinsics, working_size_px: int) -> RoomEstimate:
    """Return the estimate of a resized frame of `camera` with its images at the camera's size."""
    shrink, grow = working_factors(camera, working_size_px)
    return _resize(estimate, camera, grow, shrink)


def resize_labels(image: NDArray[Any], camera: CameraIntrinsics, working_size_px: int) -> NDArray[Any]:
    """Return an image of labels of a frame of `camera` at the working size."""
    shrink, grow = working_factors(camera, working_size_px)
    return _resize_labels(image, _resized_camera(camera, shrink, grow), shrink, grow)


def _resize_labels(image: NDArray[Any], camera: CameraIntrinsics, shrink: int, grow: int) -> NDArray[Any]:
    """One pixel of each block, or a block of each pixel, as many as `camera` has."""
    rows = np.minimum((np.arange(camera.height) * shrink + shrink // 2) // grow, image.shape[0] - 1)
    columns = np.minimum((np.arange(camera.width) * shrink + shrink // 2) // grow, image.shape[1] - 1)
    if grow > 1:  # rows are repeated when they are complete
        return np.take(np.take(image, columns, axis=1), rows, axis=0)
    return np.take(np.take(image, rows, axis=0), columns, axis=1)


def _resize(estimate: RoomEstimate, camera: CameraIntrinsics, shrink: int, grow: int) -> RoomEstimate:
    """The estimate as `camera` sees it; itself where nothing changes.

    The layout is drawn anew from the cuboid, so its edges are as sharp as the camera's pixels; a label that is that of
    the layout follows it.
    """
    if shrink == grow:
        return estimate
    layout, labels, furniture, superpixels = (
        _resize_labels(image, camera, shrink, grow)
        for image in (estimate.layout, _marked(estimate), estimate.furniture, estimate.superpixels)
    )
    cuboid, face_confidence, polygons = estimate.cuboid, estimate.face_confidence, estimate.polygons
    if cuboid is not None:
        layout, pixels = cuboid.view(camera)
        cuboid, polygons = cuboid.in_view(pixels), cuboid.polygons(camera)
        face_confidence = np.where(pixels[1:] > 0, face_confidence, 0.0)
    np.copyto(labels, layout, where=labels == _AS_LAYOUT)
    return replace(
        estimate,
        layout=layout,
        labels=labels,
        furniture=furniture,
        superpixels=superpixels,
        face_confidence=face_confidence,
        cuboid=cuboid,
        polygons=polygons,
    )


def _marked(estimate: RoomEstimate) -> NDArray[np.uint8]:
    """The labels, `_AS_LAYOUT` where they are the layout's."""
    return np.where(estimate.labels == estimate.layout, np.uint8(_AS_LAYOUT), estimate.labels)


def _resized_camera(camera: CameraIntrinsics, shrink: int, grow: int) -> CameraIntrinsics:
    """The camera whose pixels are blocks of those of `camera`, or parts of them."""
    return CameraIntrinsics(
        width=camera.width * grow // shrink,
        height=camera.height * grow // shrink,
        fx=camera.fx * grow / shrink,
        fy=camera.fy * grow / shrink,
        cx=(camera.cx + 0.5) * grow / shrink - 0.5,
        cy=(camera.cy + 0.5) * grow / shrink - 0.5,
    )


def _enlarge_color(color: NDArray[np.uint8], camera: CameraIntrinsics) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(color, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR), np.uint8)


def _reduce_depth(depth_m: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    """(H // step, W // step) float32 depth of the blocks; NaN where none of a block was measured."""
    rows, cols = (side // step for side in depth_m.shape)
    blocks = depth_m[: rows * step, : cols * step].reshape(rows, step, cols, step)
    planes = np.ascontiguousarray(blocks.transpose(1, 3, 0, 2)).reshape(step * step, rows * cols)
    middle_plane = (step // 2) * (step + 1)  # of the pixel whose label `_resize_labels` takes
    return np.asarray(_mean_on_surface(planes, middle_plane).reshape(rows, cols), np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_on_surface(planes, middle_plane):  # type: ignore[no-untyped-def]
    """(n,) mean of the depths that lie on one surface with that of the middle plane, or of the next that has one.

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
            depths = planes[(middle_plane + m) % k, first:last]
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


@njit(cache=True, nogil=True, error_model="numpy")
def _enlarge_depth(depth, step):  # type: ignore[no-untyped-def]
    """(H step, W step) float32: bilinear in inverse depth, which is exact on a plane; by the nearest at an outline."""
    height, width = depth.shape
    enlarged = np.empty((height * step, width * step), np.float32)
    for y in range(height * step):
        v = min(max((y + 0.5) / step - 0.5, 0.0), height - 1.0)
        top = min(int(v), max(height - 2, 0))
        below, down = min(top + 1, height - 1), v - top
        for x in range(width * step):
            u = min(max((x + 0.5) / step - 0.5, 0.0), width - 1.0)
            left = min(int(u), max(width - 2, 0))
            beside, along = min(left + 1, width - 1), u - left
            a, b = 1.0 / depth[top, left], 1.0 / depth[top, beside]
            c, d = 1.0 / depth[below, left], 1.0 / depth[below, beside]
            measured = 0.0 < a < np.inf and 0.0 < b < np.inf and 0.0 < c < np.inf and 0.0 < d < np.inf
            if measured and min(min(a, b), min(c, d)) >= _STEEPEST * max(max(a, b), max(c, d)):
                w = (1.0 - down) * ((1.0 - along) * a + along * b) + down * ((1.0 - along) * c + along * d)
                enlarged[y, x] = 1.0 / w
            else:
                enlarged[y, x] = depth[y // step, x // step]
    return enlarged
