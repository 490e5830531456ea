"""How wrong is a room in metres and degrees: planes, axes, the space in view, free floor (docs/method.md, 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import Sample

from .floor_truth import truly_free
from .geometry import PlaneErrors, axes_error_deg, grid_iou, plane_errors, room_iou
from .measures import best_wall_names, confusion
from .prediction import Prediction

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class RoomScore:
    """Of one frame; NaN where the truth or the prediction does not say, metres also where the scale is unknown.

    Attributes
    ----------
    plane_offset_m, plane_angle_deg : mean over the planes that truth and estimate both have in view.
    planes_found : share of the true planes in view that the estimate has. axes_error_deg : modulo the 24 rotations.
    room_iou : of the volume in view. free_space_iou : of the free floor.
    """

    plane_offset_m: float = NAN
    plane_angle_deg: float = NAN
    planes_found: float = NAN
    axes_error_deg: float = NAN
    room_iou: float = NAN
    free_space_iou: float = NAN


def score_room(sample: Sample, prediction: Prediction) -> RoomScore:
    """Compare with the true cuboid and the true floor, planes under the wall names that fit the true cuboid best.

    A method that failed on the frame has found no plane and an IoU of 0: leaving the frame out would better the mean.
    """
    truth, room = None if sample.truth is None else sample.truth.cuboid, prediction.cuboid
    free = _free_space_iou(sample, prediction.free_floor)
    if truth is None or (room is None and prediction.status == "ok"):
        return RoomScore(free_space_iou=free)
    if room is None:
        return RoomScore(planes_found=0.0, room_iou=0.0, free_space_iou=free)
    errors = planes_by_name(truth, room, sample.frame.camera, prediction.layout)
    both = np.isfinite(errors.angle_deg)
    metric = prediction.metric
    return RoomScore(
        plane_offset_m=float(errors.offset_m[both].mean()) if metric and both.any() else NAN,
        plane_angle_deg=float(errors.angle_deg[both].mean()) if both.any() else NAN,
        planes_found=float(both.sum() / np.isfinite(truth.distances).sum()),
        axes_error_deg=axes_error_deg(truth.R_room_camera, room.R_room_camera),
        room_iou=room_iou(truth, room, sample.frame.camera) if metric else NAN,
        free_space_iou=free,
    )


def planes_by_name(
    truth: RoomCuboid, room: RoomCuboid, camera: CameraIntrinsics, layout: NDArray[np.uint8]
) -> PlaneErrors:
    """Compare the planes of two rooms, the estimate's walls renamed as its layout fits the picture of the true room.

    A layout drawn by hand cannot give these names: a room fitted to the same frame has names of its own.

    Parameters
    ----------
    truth, room : RoomCuboid
        The true room and the estimated one, of the same camera.
    layout : (H, W) uint8 of the estimate.
    """
    return plane_errors(truth, room, best_wall_names(confusion(truth.raster(camera), layout)))


def _free_space_iou(sample: Sample, called: NDArray[np.bool_] | None) -> float:
    truth = None if called is None else truly_free(sample)
    return NAN if called is None or truth is None else grid_iou(truth, called)
