"""What a labelled frame says about its room: pixel classes, rays, depths, surface normals, image lines."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core import CameraIntrinsics, RgbdFrame
from ..core.labels import CEILING_NYU40, FLOOR_NYU40, OPENING_NYU40, WALL_NYU40


class FitClass(IntEnum):
    """What a pixel is to the fit; not the label ids of `core.labels`.

    An opening (window, door, mirror, blinds) is wall through which farther points may be seen. Fitted furniture
    (bookshelf, shelves) is clutter that stands at a wall.
    """

    UNLABELLED = 0
    WALL = 1
    FLOOR = 2
    CEILING = 3
    OPENING = 4
    CLUTTER = 5
    FITTED = 6


_FITTED_NYU40 = (10, 15)

_MIN_LINE_PX = 40.0
_HALVE = 2
_CELL_PX = 17
_CELL_STEP_PX = 4
"""Cells are fitted at half resolution: 34 px windows every 8 px of a VGA image."""


@dataclass(frozen=True, slots=True)
class FitObservation:
    """The evidence of one labelled frame; n pixels of a subsampled grid, m surface cells, l lines.

    Attributes
    ----------
    rays : (n, 3) float64 K^-1 (x, y, 1). inverse_depth : (n,) float64 1/m, 0 not measured.
    kind : (n,) uint8 class of the fit. cell_normal : (m, 3) unit normals towards the camera.
    cell_kind : (m,) uint8. cell_weight : (m,) 0..1 trust in the normal.
    line_normal : (l, 3) unit normals of the planes through the camera and an image line.
    line_length : (l,) length in pixels.
    """

    rays: NDArray[np.float64]
    inverse_depth: NDArray[np.float64]
    kind: NDArray[np.uint8]
    cell_normal: NDArray[np.float64]
    cell_kind: NDArray[np.uint8]
    cell_weight: NDArray[np.float64]
    line_normal: NDArray[np.float64]
    line_length: NDArray[np.float64]


def observe(frame: RgbdFrame, labels40: NDArray[np.uint8], step_px: int = 4) -> FitObservation:
    """Collect what the fit needs from a frame and its NYU40 labels.

    Raises
    ------
    ValueError
        When the frame has no depth or the labels are not a uint8 image of the frame's size.
    """
    if frame.depth_m is None:
        raise ValueError(f"frame {frame.name!r} has no depth; the layout fit needs it")
    if labels40.shape != frame.depth_m.shape or labels40.dtype != np.uint8:
        size = frame.depth_m.shape
        raise ValueError(f"labels are {labels40.dtype} {labels40.shape}; they must be uint8 {size} as the frame")
    kind = classes(labels40)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = np.where(frame.depth_m > 0, 1.0 / frame.depth_m, 0.0)
    w[~np.isfinite(w)] = 0.0
    grid = (slice(step_px // 2, None, step_px),) * 2
    normals, cell_kind, weight = _cells(w, kind, frame.camera)
    line_normal, line_length = _lines(frame)
    return FitObservation(
        rays=frame.camera.rays()[grid].reshape(-1, 3).astype(np.float64),
        inverse_depth=np.ascontiguousarray(w[grid]).ravel().astype(np.float64),
        kind=np.ascontiguousarray(kind[grid]).ravel(),
        cell_normal=normals,
        cell_kind=cell_kind,
        cell_weight=weight,
        line_normal=line_normal,
        line_length=line_length,
    )


def classes(labels40: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the class of the fit for every NYU40 id; 0 stays unlabelled."""
    table = np.full(256, FitClass.CLUTTER, np.uint8)
    table[0] = FitClass.UNLABELLED
    for kind, ids in (
        (FitClass.WALL, WALL_NYU40),
        (FitClass.FLOOR, FLOOR_NYU40),
        (FitClass.CEILING, CEILING_NYU40),
        (FitClass.OPENING, OPENING_NYU40),
        (FitClass.FITTED, _FITTED_NYU40),
    ):
        table[list(ids)] = kind
    return table[labels40]


def _cells(
    w: NDArray[np.float64], kind: NDArray[np.uint8], camera: CameraIntrinsics
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64]]:
    """Planes w = a x + b y + c by least squares over the pixels of one class in a window (closed form).

    A window is used for the class of its centre alone, so a cell does not mix wall and floor.
    """
    w, kind = w[::_HALVE, ::_HALVE], kind[::_HALVE, ::_HALVE]
    height, width = w.shape
    x = np.broadcast_to(np.arange(width) - width / 2.0, w.shape)
    y = np.broadcast_to((np.arange(height) - height / 2.0)[:, None], w.shape)
    at = (slice(_CELL_STEP_PX // 2, None, _CELL_STEP_PX),) * 2
    results = []
    for members in ((FitClass.WALL,), (FitClass.FLOOR,), (FitClass.CEILING,), (FitClass.CLUTTER, FitClass.FITTED)):
        mask = np.isin(kind, members) & (w > 0)
        if mask.sum() < 100:
            continue
        q = mask.astype(np.float64)
        qx, qy, qw = q * x, q * y, q * w
        terms = (q, qx, qy, qw, qx * x, qx * y, qy * y, qx * w, qy * w, qw * w)
        s = [_window_sums(t)[at] for t in terms]
        n = np.maximum(s[0], 1.0)
        mx, my, mw = s[1] / n, s[2] / n, s[3] / n
        xx, xy, yy = s[4] / n - mx * mx, s[5] / n - mx * my, s[6] / n - my * my
        xw, yw, ww = s[7] / n - mx * mw, s[8] / n - my * mw, s[9] / n - mw * mw
        det = xx * yy - xy * xy
        good = mask[at] & (s[0] > 0.4 * _CELL_PX**2) & (det > 0.1 * (_CELL_PX**4 / 144.0))
        det = np.where(good, det, 1.0)
        a, b = (xw * yy - yw * xy) / det, (yw * xx - xw * xy) / det
        rms = np.sqrt(np.maximum(ww - a * xw - b * yw, 0.0))
        c = mw - a * mx - b * my
        c0 = c - a * width / 2.0 - b * height / 2.0  # back to pixel coordinates from the corner
        normal = np.stack([a / _HALVE, b / _HALVE, c0], -1) @ camera.matrix
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
        # depth comes in steps of about 4 cm: its spread in w is about 0.012 w at 1 m and grows with w z^2
        scale = 0.03 * mw * mw + 0.004 * mw
        weight = np.where(good, np.exp(-0.5 * (rms / np.maximum(scale, 1e-6)) ** 2) * s[0] / _CELL_PX**2, 0.0)
        keep = weight > 0.05
        results.append((-normal[keep], np.full(keep.sum(), members[0], np.uint8), weight[keep]))
    if not results:
        return np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0)
    normals, kinds, weights = zip(*results, strict=True)
    return np.concatenate(normals), np.concatenate(kinds), np.concatenate(weights)


def _window_sums(image: NDArray[np.float64]) -> NDArray[np.float64]:
    size = (_CELL_PX, _CELL_PX)
    return np.asarray(cv2.boxFilter(image, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def _lines(frame: RgbdFrame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if frame.color is None:
        return np.zeros((0, 3)), np.zeros(0)
    found = cv2.createLineSegmentDetector().detect(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY))[0]
    if found is None:
        return np.zeros((0, 3)), np.zeros(0)
    segments = np.asarray(found, np.float64).reshape(-1, 4)
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    inside = _away_from_border(segments, frame.camera)
    segments, length = segments[inside & (length > _MIN_LINE_PX)], length[inside & (length > _MIN_LINE_PX)]
    ends = np.concatenate([segments.reshape(-1, 2), np.ones((2 * len(segments), 1))], axis=1)
    rays = (ends @ np.linalg.inv(frame.camera.matrix).T).reshape(-1, 2, 3)
    normal = np.cross(rays[:, 0], rays[:, 1])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True), length


def _away_from_border(
    segments: NDArray[np.float64], camera: CameraIntrinsics, margin_px: float = 14.0
) -> NDArray[np.bool_]:
    """True where a segment is not the edge of the white frame around NYU images."""
    x, y = segments[:, [0, 2]], segments[:, [1, 3]]
    edge = [(x < margin_px), (x > camera.width - 1 - margin_px), (y < margin_px), (y > camera.height - 1 - margin_px)]
    return ~np.any([e.all(axis=1) for e in edge], axis=0)
