"""Each stage of the estimate as a picture that a person can look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.evidence.orientation_map import compute_orientation_map
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.lines import classify_segments, compute_line_segments

from . import pictures
from .top_down import draw_top_down

Image = NDArray[np.uint8]

_AXIS_COLORS = ((250, 90, 80), (80, 210, 90), (80, 140, 255), (150, 150, 150))
"""Line segments along X, Y, Z, and along none of them."""


@dataclass(frozen=True, slots=True)
class Look:
    """A frame with its estimate."""

    frame: RgbdFrame
    estimate: RoomEstimate
    config: EstimatorConfig


def _color(look: Look) -> Image:
    return pictures.base_image(look.frame)


def _depth(look: Look) -> Image:
    if look.frame.depth_m is None:
        return np.zeros((*look.estimate.labels.shape, 3), np.uint8)
    return pictures.paint_depth(look.frame.depth_m)


def _superpixels(look: Look) -> Image:
    return pictures.draw_superpixels(pictures.base_image(look.frame), look.estimate.superpixels)


def _lines(look: Look) -> Image:
    segments = compute_line_segments(pictures.base_image(look.frame), look.config)
    classes = classify_segments(segments, look.estimate.R_room_camera, look.frame.camera)
    out = pictures.base_image(look.frame) // 2
    for (x1, y1, x2, y2), axis in zip(np.rint(segments.points).astype(int).tolist(), classes.tolist(), strict=True):
        cv2.line(out, (x1, y1), (x2, y2), _AXIS_COLORS[axis], 2, cv2.LINE_AA)
    return out


def _orientation(look: Look) -> Image:
    camera, R_room_camera = look.frame.camera, look.estimate.R_room_camera
    segments = compute_line_segments(pictures.base_image(look.frame), look.config)
    classes = classify_segments(segments, R_room_camera, camera)
    return pictures.paint_labels(
        pictures.base_image(look.frame), compute_orientation_map(segments, classes, R_room_camera, camera)
    )


def _labels(look: Look) -> Image:
    return pictures.paint_labels(pictures.base_image(look.frame), look.estimate.labels)


def _layout(look: Look) -> Image:
    image = pictures.base_image(look.frame)
    tinted = pictures.paint_labels(image, look.estimate.layout, 0.35)
    return pictures.draw_outlines(tinted, look.estimate.layout, pictures.ESTIMATE_COLOR)


def _furniture(look: Look) -> Image:
    return pictures.paint_classes(pictures.base_image(look.frame), look.estimate.furniture)


def _top_down(look: Look) -> Image:
    height, width = look.estimate.labels.shape
    return draw_top_down(look.frame, look.estimate, (width, height))


STAGES: dict[str, tuple[str, Callable[[Look], Image]]] = {
    "color": ("colour", _color),
    "depth": ("depth, near red, far blue, black unmeasured", _depth),
    "superpixels": ("superpixels", _superpixels),
    "lines": ("lines along X red, Y green, Z blue", _lines),
    "orientation": ("orientation map", _orientation),
    "labels": ("labels", _labels),
    "layout": ("layout, behind furniture too", _layout),
    "furniture": ("furniture", _furniture),
    "top-down": ("from above, a square a metre", _top_down),
}
"""Name for --stage: caption, and what draws it."""


def draw_stage(name: str, look: Look) -> Image:
    """Return the picture of one stage at the size of the frame."""
    return STAGES[name][1](look)


def draw_all(look: Look, size: tuple[int, int] = (480, 360)) -> Image:
    """Return all stages that have something to show, three in a row."""
    names = [name for name in STAGES if name != "furniture" or look.estimate.furniture.any()]
    return pictures.tiles([(STAGES[name][0], draw_stage(name, look)) for name in names], 3, size)
