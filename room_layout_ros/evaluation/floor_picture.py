"""The free space of a frame from above: green seen free, red occupied, grey not known; the camera looks up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Box = tuple[float, float, float, float]

FREE_COLOR, OCCUPIED_COLOR, UNKNOWN_COLOR = (92, 190, 118), (214, 66, 56), (196, 200, 206)
_CAMERA = (20, 90, 220)
_LINE_SHARE = 0.88
_NONE, _INK = "no free space", (70, 74, 82)
_MARGIN_M = 0.3
_OCCUPIED = 50


@dataclass(frozen=True, slots=True, eq=False)
class FloorGrid:
    """Free space in the floor frame: the camera above (0, 0), x ahead, y left, metres.

    Attributes
    ----------
    cells : (rows, cols) int8, -1 unknown, 0 free to 100 occupied; row i along y, column j along x (OccupancyGrid).
    resolution_m, origin_m : side of a cell; x and y of the lower corner of cell (0, 0).
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin_m: tuple[float, float]

    @classmethod
    def of_message(cls, message: Any) -> FloorGrid:
        """Return the grid of a nav_msgs/OccupancyGrid."""
        info = message.info
        cells = np.asarray(message.data, np.int8).reshape(info.height, info.width)
        return cls(cells, float(info.resolution), (float(info.origin.position.x), float(info.origin.position.y)))


def known_box(grids: Iterable[FloorGrid]) -> Box:
    """Return lowest x, highest x, lowest y, highest y of what any of them knows, the camera's place among it."""
    corners = [np.zeros((1, 2))]
    for grid in grids:
        known = np.argwhere(grid.cells >= 0)[:, ::-1]
        if len(known):
            corners.append(np.stack([known.min(axis=0), known.max(axis=0) + 1]) * grid.resolution_m + grid.origin_m)
    every = np.concatenate(corners)
    (x0, y0), (x1, y1) = every.min(axis=0) - _MARGIN_M, every.max(axis=0) + _MARGIN_M
    return float(x0), float(x1), float(y0), float(y1)


def draw_floor(grid: FloorGrid | None, box: Box, size: tuple[int, int] = (480, 360)) -> Image:
    """Return the cells inside `box` as a picture of (width, height) `size`, a line a metre; of None it says so."""
    x_m, y_m = _metres(box, size)
    sheet = np.full((size[1], size[0], 3), UNKNOWN_COLOR, np.uint8)
    if grid is not None:
        columns = np.floor((x_m - grid.origin_m[0]) / grid.resolution_m).astype(int)
        rows = np.floor((y_m - grid.origin_m[1]) / grid.resolution_m).astype(int)
        above, across = (columns >= 0) & (columns < grid.cells.shape[1]), (rows >= 0) & (rows < grid.cells.shape[0])
        seen = grid.cells[np.ix_(rows[across], columns[above])].T
        palette = np.array([UNKNOWN_COLOR, FREE_COLOR, OCCUPIED_COLOR], np.uint8)
        sheet[np.ix_(above, across)] = palette[np.where(seen < 0, 0, np.where(seen < _OCCUPIED, 1, 2))]
    _draw_metres(sheet, x_m, y_m)
    if grid is None:
        _say_none(sheet)
    return _draw_camera(sheet, x_m, y_m)


def _metres(box: Box, size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x of each row, falling, and y of each column, falling: ahead is up, left is left."""
    x0, x1, y0, y1 = box
    pixel_m = max((x1 - x0) / size[1], (y1 - y0) / size[0])
    above, across = (n / 2 - 0.5 - np.arange(n, dtype=np.float64) for n in (size[1], size[0]))
    return (x0 + x1) / 2 + pixel_m * above, (y0 + y1) / 2 + pixel_m * across


def _draw_metres(sheet: Image, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> None:
    for row in np.flatnonzero(np.diff(np.floor(x_m))):
        sheet[row] = (_LINE_SHARE * sheet[row]).astype(np.uint8)
    for column in np.flatnonzero(np.diff(np.floor(y_m))):
        sheet[:, column] = (_LINE_SHARE * sheet[:, column]).astype(np.uint8)


def _say_none(sheet: Image) -> None:
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, sheet.shape[1] / 640
    (width, height), _ = cv2.getTextSize(_NONE, font, scale, 1)
    corner = (sheet.shape[1] - width) // 2, (sheet.shape[0] + height) // 2
    cv2.putText(sheet, _NONE, corner, font, scale, _INK, 1, cv2.LINE_AA)


def _draw_camera(sheet: Image, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> Image:
    foot = (int(np.abs(y_m).argmin()), int(np.abs(x_m).argmin()))
    tip = (foot[0], int(np.abs(x_m - 0.45).argmin()))
    cv2.arrowedLine(sheet, foot, tip, _CAMERA, 2, cv2.LINE_AA, tipLength=0.35)
    cv2.circle(sheet, foot, 5, _CAMERA, -1, cv2.LINE_AA)
    return sheet
