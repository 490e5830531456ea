"""Each piece of evidence as an image that a person can look at."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..depth_profiles import N_OFFSETS, DepthProfiles, curve_positions
from ..frame import CameraIntrinsics
from ..labels import FACES, LABEL_COLORS, LABEL_NAMES, N_LABELS
from ..lines import LineSegments
from ..superpixels import Superpixels
from .depth_cues import DIRECTIONS

AXIS_COLORS = ((235, 70, 60), (60, 200, 80), (70, 120, 240))
"""RGB of segments along X, Y and Z, as RViz draws axes."""

HORIZON_COLOR = (255, 255, 255)
SUPPORT_COLOR, VIOLATION_COLOR = (150, 215, 165), (225, 70, 60)

_NO_AXIS_COLOR = (150, 150, 150)
_DISTANCE_SPAN_M = 4.0
_PENCIL_LINES = 8
_TICKS_M = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_INK, _PALE, _PAPER = (40, 46, 56), (215, 218, 222), (255, 255, 255)
_HEADROOM, _TITLE_PX = 1.15, 22
_LEAST_SHARE = 0.01
"""Share of the image that fills a row at least: a plane that nothing lies on shows no hill."""


def draw_lines(
    color: NDArray[np.uint8],
    segments: LineSegments,
    line_class: NDArray[np.int8],
    R_room_camera: NDArray[np.float64],
    camera: CameraIntrinsics,
    width_px: int = 2,
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: the darkened image with its segments in the colour of their axis, the pencils of the axes.

    Thin lines of an axis run through its vanishing point, which has a ring where it is in the image; the white line is
    the horizon.
    """
    image = draw_pencils((color // 2).astype(np.uint8), R_room_camera, camera)
    for (x1, y1, x2, y2), axis in zip(segments.points, line_class, strict=True):
        tint = AXIS_COLORS[axis] if axis >= 0 else _NO_AXIS_COLOR
        start, end = (round(float(x1)), round(float(y1))), (round(float(x2)), round(float(y2)))
        cv2.line(image, start, end, tint, width_px, cv2.LINE_AA)
    return image


def draw_pencils(
    image: NDArray[np.uint8], R_room_camera: NDArray[np.float64], camera: CameraIntrinsics
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: the image with lines towards the vanishing points of the three axes, and the horizon.

    Parameters
    ----------
    R_room_camera : (3, 3) float64
        Rows are the axes X, Y and Z.
    """
    image = image.copy()
    middle = np.array([(camera.width - 1) / 2, (camera.height - 1) / 2])
    reach = float(np.hypot(camera.width, camera.height))
    for axis, tint in zip(R_room_camera, AXIS_COLORS, strict=True):
        point = camera.matrix @ axis  # homogeneous; the third coordinate is 0 where it is at infinity
        towards = point[:2] - point[2] * middle
        length = float(np.linalg.norm(towards))
        inside = length < 0.5 * reach * abs(point[2])
        if inside:  # lines at equal angles
            centre = point[:2] / point[2]
            angles = np.pi * np.arange(_PENCIL_LINES) / _PENCIL_LINES
            pencil = [(centre, np.array([np.cos(a), np.sin(a)])) for a in angles]
            cv2.circle(image, _pixel(centre), 7, tint, 2)
        else:  # lines at equal distances across the middle of the image
            across = np.array([-towards[1], towards[0]]) / length
            anchors = [middle + 0.5 * reach * s * across for s in np.linspace(-0.9, 0.9, _PENCIL_LINES)]
            pencil = [(at, _direction(point[:2] - point[2] * at)) for at in anchors]
        for at, along in pencil:
            cv2.line(image, _pixel(at - reach * along), _pixel(at + reach * along), tint, 1)
    a, b, c = np.linalg.inv(camera.matrix).T @ R_room_camera[1]  # pixels whose rays are level
    norm = float(np.hypot(a, b))
    foot = middle - (a * middle[0] + b * middle[1] + c) / max(norm, 1e-12) ** 2 * np.array([a, b])
    if norm > 0 and np.linalg.norm(foot - middle) < reach:
        level = np.array([-b, a]) / norm
        cv2.line(image, _pixel(foot - reach * level), _pixel(foot + reach * level), HORIZON_COLOR, 1)
    return image


def _direction(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(towards / max(float(np.linalg.norm(towards)), 1e-12))


def _pixel(at: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(at[0])), round(float(at[1]))


def draw_planes(profiles: DepthProfiles, distances: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.uint8]:
    """(height, width, 3) uint8: what depth says of each plane's offset, and the offset that was chosen.

    A row per face. Green: share of the image that lies on the plane; red: share that lies beyond it, at the same scale
    (cut at the top); the line in the face's colour is the chosen offset.

    Parameters
    ----------
    profiles : DepthProfiles
    distances : (5,) float64
        Chosen offsets in m, +inf for a face that is not in view.
    size : (width, height) of the picture.
    """
    edges = np.linspace(0, size[1], len(FACES) + 1).astype(int)
    rows = []
    for k, face in enumerate(FACES):
        row = np.full((edges[k + 1] - edges[k], size[0], 3), _PAPER, np.uint8)
        _draw_profile(row, profiles.support[k], profiles.violation[k])
        told = f"not in view; at most {100 * profiles.support[k].max():.1f} % on one plane"
        if np.isfinite(distances[k]):
            on, beyond = (100 * float(share) for share in profiles.at(k, np.array(distances[k])))
            told = f"{distances[k]:.2f} m; {on:.1f} % on it, {beyond:.1f} % beyond"
            x = _column(distances[k], size[0])
            cv2.line(row, (x, 0), (x, row.shape[0] - 1), LABEL_COLORS[face].tolist(), 2)
        told = f"{LABEL_NAMES[face]}: {told}"
        cv2.putText(row, told, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
        rows.append(row)
    return np.vstack(rows)


def _column(distance_m: float, width: int) -> int:
    """Column of an offset; offsets are log-spaced."""
    return round(float(curve_positions(np.array(distance_m))) / (N_OFFSETS - 1) * (width - 1))


def _draw_profile(row: NDArray[np.uint8], support: NDArray[np.float64], violation: NDArray[np.float64]) -> None:
    height, width, _ = row.shape
    floor = height - 14  # ticks below
    for tick in _TICKS_M:
        x = _column(tick, width)
        cv2.line(row, (x, 0), (x, floor), _PALE, 1)
        cv2.putText(row, f"{tick:g}", (x + 2, height - 3), cv2.FONT_HERSHEY_SIMPLEX, 0.32, _INK, 1, cv2.LINE_AA)
    top = min(_TITLE_PX, floor)
    limit = max(_HEADROOM * float(support.max()), _LEAST_SHARE)
    columns = np.rint(np.linspace(0, width - 1, len(support))).astype(np.int32)
    on, beyond = (
        np.rint(floor - (floor - top) * np.minimum(c / limit, 1.0)).astype(np.int32) for c in (support, violation)
    )
    area = np.concatenate([[[0, floor]], np.column_stack([columns, on]), [[width - 1, floor]]]).astype(np.int32)
    cv2.fillPoly(row, [area], SUPPORT_COLOR)
    cv2.polylines(row, [np.column_stack([columns, beyond])], False, VIOLATION_COLOR, 2, cv2.LINE_AA)
    cv2.line(row, (0, floor), (width - 1, floor), _INK, 1)


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
