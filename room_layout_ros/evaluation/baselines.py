"""Plain solutions that the estimator has to beat; each maps a sample to a prediction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CLUTTER, FACES
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid
from room_layout_ros.core.manhattan import estimate_manhattan_frame
from room_layout_ros.datasets import Sample

from .prediction import Prediction

PERCENTILE = 98.0
STANDS_OUT_M = 0.10
STANDS_OUT_SHARE = 0.03
"""A pixel is clutter when it lies this much (metres, and share of its depth) in front of the empty room."""


def percentile_walls(sample: Sample, percentile: float = PERCENTILE) -> Prediction:
    """Put each plane where `percentile` of the depth points along its axis lie nearer; clutter stands out of it.

    The axes are the estimator's own Manhattan frame, so the comparison shows what the joint model adds to it.
    A frame without depth or without axes gets an empty prediction.
    """
    frame = sample.frame
    geometry = compute_depth_geometry(frame, EstimatorConfig())
    axes = estimate_manhattan_frame(geometry)
    if axes is None or frame.depth_m is None:
        return Prediction.nothing(frame.camera, "no axes")
    room = RoomCuboid(axes.R_room_camera, _extents(frame, axes.R_room_camera, percentile))
    layout = room.raster(frame.camera)
    return Prediction(layout=layout, labels=_label(frame, room, layout), cuboid=room)


def constant_layout(layouts: Mapping[str, NDArray[np.uint8]]) -> Callable[[Sample], Prediction]:
    """Return the method that answers each frame with the most frequent face per pixel of all *other* frames.

    Every pixel is called structure: a picture of no room in particular.
    """
    votes = sum_of_votes(layouts.values())

    def predict(sample: Sample) -> Prediction:
        own = layouts.get(sample.name)
        others = votes - (sum_of_votes([own]) if own is not None else 0)
        layout = (1 + np.argmax(others, axis=0)).astype(np.uint8)
        return Prediction(layout=layout, labels=layout)

    return predict


def sum_of_votes(layouts: Iterable[NDArray[np.uint8]]) -> NDArray[np.int32]:
    """Return (5, H, W) int32: how many layouts have face k + 1 at a pixel."""
    votes = [np.stack([layout == face for face in FACES]).astype(np.int32) for layout in layouts]
    return np.sum(votes, axis=0, dtype=np.int32)


def _extents(frame: RgbdFrame, R_room_camera: NDArray[np.float64], percentile: float) -> NDArray[np.float64]:
    assert frame.depth_m is not None
    seen = np.isfinite(frame.depth_m) & (frame.depth_m > 0)
    points = (frame.camera.rays()[seen] * frame.depth_m[seen][:, None]) @ R_room_camera.T
    along = points[:, FACE_AXIS] * FACE_SIGN
    return np.asarray(np.maximum(np.percentile(along, percentile, axis=0), 0.05))


def _label(frame: RgbdFrame, room: RoomCuboid, layout: NDArray[np.uint8]) -> NDArray[np.uint8]:
    assert frame.depth_m is not None
    with np.errstate(invalid="ignore"):
        in_front = frame.depth_m < room.depth(frame.camera) * (1 - STANDS_OUT_SHARE) - STANDS_OUT_M
    return np.where(in_front, CLUTTER, layout).astype(np.uint8)
