"""Each piece of evidence as an image that a person can look at."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..labels import LABEL_COLORS, N_LABELS
from ..lines import LineSegments
from ..superpixels import Superpixels
from .depth_cues import DIRECTIONS

AXIS_COLORS = ((235, 70, 60), (60, 200, 80), (70, 120, 240))
"""RGB of segments along X, Y and Z, as RViz draws axes."""

_NO_AXIS_COLOR = (150, 150, 150)
_DISTANCE_SPAN_M = 4.0


def draw_lines(
    color: NDArray[np.uint8], segments: LineSegments, line_class: NDArray[np.int8], width_px: int = 2
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: the darkened image with its segments in the colour of their axis."""
    image = (color // 2).astype(np.uint8)
    for (x1, y1, x2, y2), axis in zip(segments.points, line_class, strict=True):
        tint = AXIS_COLORS[axis] if axis >= 0 else _NO_AXIS_COLOR
        start, end = (round(float(x1)), round(float(y1))), (round(float(x2)), round(float(y2)))
        cv2.line(image, start, end, tint, width_px, cv2.LINE_AA)
    return image


def draw_orientation(color: NDArray[np.uint8] | None, orientation: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: faces named by the orientation map in their label colours, black where it is open."""
    return _mix(color, LABEL_COLORS[orientation])


def draw_context(
    color: NDArray[np.uint8] | None, superpixels: Superpixels, context: NDArray[np.floating]
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: label colours mixed by their probabilities; grey-brown mixtures are doubt."""
    mixed = np.clip(context @ LABEL_COLORS[1 : N_LABELS + 1].astype(np.float64), 0, 255).astype(np.uint8)
    return _mix(color, mixed[superpixels.index])


def draw_scene(color: NDArray[np.uint8], probability: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: label colours mixed by the scene network's (rows, columns, 5 or 6) probabilities."""
    mixed = np.clip(probability @ LABEL_COLORS[1 : probability.shape[-1] + 1].astype(np.float64), 0, 255)
    height, width = color.shape[:2]
    return _mix(color, cv2.resize(mixed.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR))


def draw_context_channel(
    superpixels: Superpixels, context: NDArray[np.floating], label: int
) -> NDArray[np.uint8]:
    """(H, W) uint8: probability of one label, 255 is certain."""
    return np.rint(255.0 * context[:, label - 1]).astype(np.uint8)[superpixels.index]


def draw_depth_cues(superpixels: Superpixels, cues: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(2 H, 6 W, 3) uint8 sheet: above the six cosines, below the six distances (white near the end, black 4 m off)."""
    tiles = []
    for k in range(len(DIRECTIONS)):
        cosine = np.rint(127.5 + 127.5 * np.clip(cues[:, k], -1.0, 1.0)).astype(np.uint8)
        near = np.clip(1.0 - cues[:, len(DIRECTIONS) + k] / _DISTANCE_SPAN_M, 0.0, 1.0)
        distance = np.rint(255.0 * near).astype(np.uint8)
        tiles.append(np.vstack([cosine[superpixels.index], distance[superpixels.index]]))
    sheet = np.hstack(tiles)
    return np.repeat(sheet[..., None], 3, axis=2)


def _mix(color: NDArray[np.uint8] | None, tint: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if color is None:
        return tint.astype(np.uint8)
    return (color // 2 + tint // 2).astype(np.uint8)
