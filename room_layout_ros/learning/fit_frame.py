"""One frame of `room-layout fit`: what a worker process does and hands back, and the reading of a folder of fits."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from room_layout_ros.core.labels import LABEL_COLORS
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import BadFrame, DataError, Sample
from room_layout_ros.datasets.images import encode_image

from .frames_apart import FrameAt, read_frame
from .layout_fitting import LayoutFit, fit_layout

FITS_FILE = "fits.jsonl"
MIN_QUALITY, MAX_COST = 0.8, 0.2


@dataclass(frozen=True, slots=True)
class FitJob:
    """What to do with every frame.

    Attributes
    ----------
    min_quality, max_cost : a fit is accepted as truth between them.
    overlay : make a picture for people.
    """

    min_quality: float = MIN_QUALITY
    max_cost: float = MAX_COST
    overlay: bool = False


@dataclass(frozen=True, slots=True)
class FitResult:
    """The line of a frame and the bytes of its files by path below the output folder."""

    line: Mapping[str, Any]
    files: Mapping[str, bytes] = field(default_factory=dict)


def fit_item(job: FitJob, frame: FrameAt | Sample | BadFrame) -> FitResult:
    """Fit one frame of a source; one that cannot be fitted gets a line that says why."""
    cv2.setNumThreads(1)  # processes are the parallelism here
    item = read_frame(frame)
    if isinstance(item, BadFrame):
        return FitResult({"name": item.name, "accepted": False, "error": item.error})
    if item.truth is None or item.truth.labels40 is None:
        return FitResult({"name": item.name, "accepted": False, "error": "it has no class labels (labels40/NAME.png)"})
    try:
        fit = fit_layout(item.frame, item.truth.labels40)
    except ValueError as error:
        return FitResult({"name": item.name, "accepted": False, "error": str(error)})
    if fit is None:
        return FitResult({"name": item.name, "accepted": False, "error": "too little structure is labelled"})
    return FitResult(_line(job, item.name, fit), _files(job, item, fit))


def accepted(job: FitJob, fit: LayoutFit) -> bool:
    """Whether a fit may serve as truth: it explains the structure, and every pixel hits a face."""
    return bool(fit.quality >= job.min_quality and fit.cost <= job.max_cost and (fit.layout > 0).all())


def lost_result(item: FrameAt | Sample | BadFrame) -> FitResult:
    """Return the line of a frame whose worker died each time."""
    return FitResult({"name": item.name, "accepted": False, "error": "the worker process died at this frame"})


def _line(job: FitJob, name: str, fit: LayoutFit) -> dict[str, Any]:
    return {
        "name": name,
        "accepted": accepted(job, fit),
        "quality": round(fit.quality, 4),
        "cost": round(float(fit.cost), 4),
        "axes": [[round(float(v), 9) for v in row] for row in fit.cuboid.R_room_camera],
        "distances_m": [round(float(d), 4) if math.isfinite(d) else None for d in fit.cuboid.distances],
    }


def _files(job: FitJob, item: Sample, fit: LayoutFit) -> dict[str, bytes]:
    folder = "layout" if accepted(job, fit) else "rejected"
    files = {f"{folder}/{item.name}.png": encode_image(".png", fit.layout)}
    if job.overlay and item.frame.color is not None:
        mixed = (item.frame.color // 2 + LABEL_COLORS[fit.layout] // 2).astype(np.uint8)
        files[f"overlay/{item.name}.jpg"] = encode_image(".jpg", mixed)
    return files


def read_fits(folder: Path) -> dict[str, RoomCuboid]:
    """Read the accepted rooms of an output folder of `room-layout fit` by frame name.

    Raises
    ------
    DataError
        When the folder has no fits.jsonl or a line of it is no fit.
    """
    path = folder / FITS_FILE
    if not path.is_file():
        raise DataError(f"{path} is missing; make it with room-layout fit FOLDER --out {folder}")
    rooms = {}
    for number, text in enumerate(path.read_text("utf-8").splitlines(), 1):
        try:
            line = json.loads(text)
            if (room := read_line(line)) is not None:
                rooms[str(line["name"])] = room
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(f"{path}, line {number} is no fit: {error}") from None
    return rooms


def read_line(line: Mapping[str, Any]) -> RoomCuboid | None:
    """Return the room of an accepted fit's line, None for another."""
    if not line["accepted"]:
        return None
    distances = np.array([math.inf if d is None else d for d in line["distances_m"]], np.float64)
    U, _, Vt = np.linalg.svd(np.array(line["axes"], np.float64))  # the digits of a line are rounded
    return RoomCuboid(U @ Vt, distances)
