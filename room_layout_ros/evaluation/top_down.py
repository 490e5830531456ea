"""The room from above: its floor plan, the points of the frame in the colours of their labels, the camera."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CEILING, LABEL_COLORS

Image = NDArray[np.uint8]

_MARGIN_M = 0.4
_GRID = (228, 231, 236)
_WALL = (40, 46, 56)


def draw_top_down(frame: RgbdFrame, estimate: RoomEstimate, size: tuple[int, int] = (640, 480)) -> Image:
    """Return the plan as a picture of (width, height) `size`; a grid line a metre, ceiling points left out.

    A frame without depth or without a room gives an empty sheet.
    """
    sheet = np.full((size[1], size[0], 3), 255, np.uint8)
    cuboid = estimate.cuboid
    if frame.depth_m is None or cuboid is None:
        return sheet
    across, ahead, labels = _points(frame, estimate)
    if not len(across):
        return sheet
    _, _, left, front, right = cuboid.distances
    reach = float(np.percentile(ahead, 99.5))
    box = (
        -min(left, float(-across.min()) + _MARGIN_M),
        min(right, float(across.max()) + _MARGIN_M),
        min(0.0, float(ahead.min())),
        min(front, reach),
    )
    plan = _Plan(box, size)
    plan.grid(sheet)
    px = plan.pixels(across, ahead)
    inside = (px >= 0).all(axis=1) & (px < (size[0], size[1])).all(axis=1)
    sheet[px[inside, 1], px[inside, 0]] = LABEL_COLORS[labels[inside]]
    ends = ((-left, 0.0, -left, front), (right, 0.0, right, front), (-left, front, right, front))
    for x0, z0, x1, z1 in ends:
        if np.isfinite(x0 if x0 == x1 else z0):
            a, b = plan.pixels(np.clip([x0, x1], *box[:2]), np.clip([z0, z1], *box[2:]))
            cv2.line(sheet, a.tolist(), b.tolist(), _WALL, 3, cv2.LINE_AA)
    _draw_camera(sheet, plan, estimate)
    return sheet


class _Plan:
    """Metres across and ahead to pixels."""

    def __init__(self, box: tuple[float, float, float, float], size: tuple[int, int]) -> None:
        self.left, self.right, self.near, self.far = box
        wide, deep = self.right - self.left + 2 * _MARGIN_M, self.far - self.near + 2 * _MARGIN_M
        self.scale = min(size[0] / wide, size[1] / deep)
        middle = (self.left + self.right) / 2
        self.origin = np.array([size[0] / 2 - self.scale * middle, size[1] - self.scale * (_MARGIN_M - self.near)])

    def pixels(self, across: NDArray[np.floating], ahead: NDArray[np.floating]) -> NDArray[np.int64]:
        """Return (n, 2) pixels."""
        points = np.stack([np.asarray(across), -np.asarray(ahead)], axis=-1) * self.scale + self.origin
        return np.rint(points).astype(np.int64)

    def grid(self, sheet: Image) -> None:
        """Draw a line each metre."""
        for metre in range(-30, 31):
            (x, y), _ = self.pixels(np.array([metre, 0]), np.array([metre, 0]))
            if 0 <= x < sheet.shape[1]:
                sheet[:, x] = _GRID
            if 0 <= y < sheet.shape[0]:
                sheet[y] = _GRID


def _points(
    frame: RgbdFrame, estimate: RoomEstimate
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8]]:
    assert frame.depth_m is not None
    seen = np.isfinite(frame.depth_m) & (frame.depth_m > 0) & (estimate.labels != CEILING) & (estimate.labels > 0)
    room = (frame.camera.rays()[seen] * frame.depth_m[seen][:, None]) @ estimate.R_room_camera.T
    order = np.argsort(-room[:, 1], kind="stable")  # what is higher is drawn later, so on top
    return room[order, 0], room[order, 2], estimate.labels[seen][order]


def _draw_camera(sheet: Image, plan: _Plan, estimate: RoomEstimate) -> None:
    heading = estimate.R_room_camera @ np.array([0.0, 0.0, 1.0])
    heading /= max(float(np.hypot(heading[0], heading[2])), 1e-9)
    foot, tip = plan.pixels(np.array([0.0, 0.45 * heading[0]]), np.array([0.0, 0.45 * heading[2]]))
    cv2.arrowedLine(sheet, foot.tolist(), tip.tolist(), (20, 90, 220), 2, cv2.LINE_AA, tipLength=0.35)
    cv2.circle(sheet, foot.tolist(), 5, (20, 90, 220), -1, cv2.LINE_AA)
