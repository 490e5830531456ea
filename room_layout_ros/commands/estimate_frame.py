"""One frame of `room-layout estimate`: what a worker process does and hands back."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.commands.camera_pose import UPRIGHT, CameraPose
from room_layout_ros.commands.depth_doubts import DepthSeen, see_depth
from room_layout_ros.commands.estimator_options import prepared
from room_layout_ros.commands.free_space_map import map_files
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.core.labels import FACES, LABEL_NAMES
from room_layout_ros.core.layout import FacePolygon
from room_layout_ros.datasets import BadFrame, DataError, Sample
from room_layout_ros.datasets.images import encode_image


@dataclass(frozen=True, slots=True)
class FrameJob:
    """What to do with every frame.

    `models` : folder of the learned models; None are the shipped ones. `pose` : of the camera.
    """

    config: EstimatorConfig
    rgb_only: bool = False
    overlay: bool = False
    models: Path | None = None
    pose: CameraPose = UPRIGHT
    free_space: bool = False


@dataclass(frozen=True, slots=True)
class FrameResult:
    """The line of a frame, the bytes of its files by path below the output folder, and what its depth was good for."""

    line: Mapping[str, Any]
    files: Mapping[str, bytes] = field(default_factory=dict)
    depth: DepthSeen | None = None


def estimate_item(job: FrameJob, item: Sample | BadFrame) -> FrameResult:
    """Estimate one item of a source; every failure ends as a line with its error."""
    if isinstance(item, BadFrame):
        return _error_result(item.name, item.error)
    frame = item.frame
    try:
        frame = prepared(frame, job.rgb_only)
        estimator, start = _estimator(job.config, job.models), time.perf_counter()
        estimate = job.pose.estimate(estimator, frame)
        milliseconds = 1e3 * (time.perf_counter() - start)
        seen = see_depth(frame, job.config, estimate)
        return FrameResult(_line(frame.name, estimate, milliseconds), _files(job, frame, estimate), seen)
    except DataError as error:
        return _error_result(frame.name, str(error))
    except Exception as error:  # noqa: BLE001 - a bug at one frame must not lose the others; it is named in its line
        return _error_result(frame.name, f"internal error: {type(error).__name__}: {error}")


def lost_result(item: Sample | BadFrame) -> FrameResult:
    """Return the line of a frame whose worker died each time."""
    return _error_result(item.name, "the worker process died at this frame; out of memory?")


@lru_cache(maxsize=1)
def _estimator(config: EstimatorConfig, models: Path | None) -> LayoutEstimator:
    cv2.setNumThreads(1)  # processes are the parallelism here; OpenCV's threads would only fight over the cores
    return LayoutEstimator(config, models)


def _error_result(name: str, error: str) -> FrameResult:
    return FrameResult({"name": name, "status": "error", "error": " ".join(error.split())})


def _files(job: FrameJob, frame: RgbdFrame, estimate: RoomEstimate) -> dict[str, bytes]:
    files = {
        f"layout/{frame.name}.png": encode_image(".png", estimate.layout),
        f"labels/{frame.name}.png": encode_image(".png", estimate.labels),
        f"furniture/{frame.name}.png": encode_image(".png", estimate.furniture),
    }
    if job.overlay:
        from room_layout_ros.core.picture import draw_overlay

        files[f"overlay/{frame.name}.jpg"] = encode_image(".jpg", draw_overlay(frame, estimate))
    if job.free_space and (space := free_space_of_frame(frame, estimate, job.config)) is not None:
        files |= {f"free_space/{frame.name}{end}": content for end, content in map_files(frame.name, space).items()}
    return files


def _line(name: str, estimate: RoomEstimate, milliseconds: float) -> dict[str, Any]:
    faces = [LABEL_NAMES[face] for face in FACES]
    distances = [math.inf] * len(FACES) if estimate.cuboid is None else estimate.cuboid.distances
    return {
        "name": name,
        "status": estimate.status.name,
        "stamp_ns": int(estimate.stamp_ns),
        "confidence": _number(estimate.confidence),
        "axes_confidence": _number(estimate.axes_confidence),
        "face_confidence": {face: _number(c) for face, c in zip(faces, estimate.face_confidence, strict=True)},
        "axes": [[_number(v, 9) for v in row] for row in estimate.R_room_camera],
        "metric": bool(estimate.metric),
        "plane_distances_m": {face: _number(d) for face, d in zip(faces, distances, strict=True)},
        "polygons": [_polygon(p) for p in estimate.polygons],
        "energy": _number(estimate.energy),
        "lower_bound": _number(estimate.lower_bound),
        "gap": _number(estimate.gap),
        "milliseconds": _number(milliseconds, 3),
        "timings_ms": {stage: _number(t, 3) for stage, t in estimate.timings_ms.items()},
    }


def _polygon(polygon: FacePolygon) -> dict[str, Any]:
    return {
        "face": LABEL_NAMES[polygon.face],
        "id": int(polygon.face),
        "pixels": _rows(polygon.pixels, 3),
        "points_m": _rows(polygon.points_m, 5),
        "normal": [_number(v) for v in polygon.normal],
        "distance_m": _number(polygon.distance),
    }


def _rows(array: NDArray[np.float64], digits: int) -> list[list[float | None]]:
    return [[_number(v, digits) for v in row] for row in array]


def _number(value: float, digits: int = 6) -> float | None:
    """JSON has no NaN and no infinity: what is not known is null."""
    return round(float(value), digits) if math.isfinite(value) else None
