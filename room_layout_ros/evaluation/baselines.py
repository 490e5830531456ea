"""Plain solutions that the estimator has to beat; each maps a sample to a prediction."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CLUTTER, FACES
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid
from room_layout_ros.core.manhattan import estimate_manhattan_frame
from room_layout_ros.datasets import DataError, Sample

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
    axes = None if geometry is None else estimate_manhattan_frame(geometry)
    if axes is None or frame.depth_m is None:
        return Prediction.nothing(frame.camera, "no axes")
    room = RoomCuboid(axes.R_room_camera, _extents(frame, axes.R_room_camera, percentile))
    layout = room.raster(frame.camera)
    return Prediction(layout=layout, labels=_label(frame, room, layout), cuboid=room)


@dataclass(frozen=True, slots=True)
class ConstantLayout:
    """The method that answers each frame with the most frequent face per pixel of all *other* frames.

    Every pixel is called structure: a picture of no room in particular.
    """

    votes: NDArray[np.int16]
    frames: frozenset[str]

    @classmethod
    def of(cls, layouts: Mapping[str, NDArray[np.uint8]]) -> ConstantLayout:
        """Count the votes of a set of true layouts by frame name.

        Raises
        ------
        DataError
            When the layouts are not all of one size.
        """
        if len({layout.shape for layout in layouts.values()}) > 1:
            raise DataError("the true layouts differ in size; the constant layout needs one size (--baseline none)")
        return cls(sum_of_votes(layouts.values()), frozenset(layouts))

    def __call__(self, sample: Sample) -> Prediction:
        """Return the others' most frequent faces."""
        votes = self.votes
        if sample.name in self.frames and sample.truth is not None and sample.truth.layout is not None:
            votes = votes - sum_of_votes([sample.truth.layout])
        layout = (1 + np.argmax(votes, axis=0)).astype(np.uint8)
        return Prediction(layout=layout, labels=layout)


def sum_of_votes(layouts: Iterable[NDArray[np.uint8]]) -> NDArray[np.int16]:
    """Return (5, H, W) int16: how many layouts have face k + 1 at a pixel."""
    votes = [np.stack([layout == face for face in FACES]) for layout in layouts]
    return np.asarray(np.sum(votes, axis=0, dtype=np.int16))


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
