"""The slow obvious twin of what hides floor below dark things without depth: column by column, in Python."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.floor.depth_holes import GAP
from room_layout_ros.core.floor.floor_pixels import (
    BEYOND_PIXEL,
    FLOOR_PIXEL,
    FLYING_PIXEL,
    OBSTACLE_PIXEL,
    WALL_PIXEL,
)
from room_layout_ros.core.frame import CameraIntrinsics


@dataclass
class Column:
    """One column of a dark hole: its upper and lower row, and whether floor is just below."""

    u: int
    highest: int
    lowest: int
    on_floor: bool
    near: float = np.inf
    hangs: float = np.inf
    line: float = np.nan


@dataclass
class Sight:
    """Where the rays of pixels go. `above_floor` : m, of the camera."""

    camera: CameraIntrinsics
    T: NDArray[np.float64]

    @property
    def above_floor(self) -> float:
        return float(-self.T[:3, 2] @ self.T[:3, 3])

    def ray(self, u: float, v: float) -> NDArray[np.float64]:
        """Ahead, to the left and up per metre over the floor."""
        c = self.camera
        along = self.T[:3, :3].T @ ((u - c.cx) / c.fx, (v - c.cy) / c.fy, 1.0)
        return np.asarray(along / max(np.hypot(along[0], along[1]), 1e-9))

    def meets(self, u: float, v: float) -> float:
        """Distance from below the camera where a ray meets the floor."""
        rise = self.ray(u, v)[2]
        return self.above_floor / -rise if rise < -1e-3 else np.inf

    def row_below(self, u: int, v: int, inverse: float) -> int:
        """Last row over the floor right below the point of a pixel."""
        c = self.camera
        point = np.array([(u - c.cx) / c.fx, (v - c.cy) / c.fy, 1.0]) / inverse
        ahead, left, _ = self.T[:3, :3].T @ (point - self.T[:3, 3])
        _, y, z = self.T[:3, :3] @ (ahead, left, 0.0) + self.T[:3, 3]
        return max(int(np.ceil(y / max(z, 0.1) * c.fy + c.cy)) - 1, v)

    def depth(self, u: float, v: float) -> float:
        c = self.camera
        rise = (self.T[:3, :3].T @ ((u - c.cx) / c.fx, (v - c.cy) / c.fy, 1.0))[2]
        return self.above_floor / -rise if rise < -1e-3 else np.inf


def naive_patches(hole_kind: NDArray[np.uint8], color: NDArray[np.uint8], least: float) -> list[NDArray[np.bool_]]:
    """Dark holes, those that one side of the picture cuts off as one."""
    dark = ((hole_kind == GAP) & (color.max(axis=2) <= 90)).astype(np.uint8)
    dark = cv2.morphologyEx(dark, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, number = cv2.connectedComponents(dark, connectivity=8)
    patches = [number == k for k in range(1, count)]
    for side in (0, -1):
        cut = [p for p in patches if p[:, side].any()]
        if cut:
            patches = [p for p in patches if not p[:, side].any()] + [np.logical_or.reduce(cut)]
    return [p for p in patches if p.sum() >= least]


def naive_columns(patch: NDArray[np.bool_], kind: NDArray[np.uint8]) -> list[Column]:
    columns = []
    for u in np.flatnonzero(patch.any(axis=0)):
        rows = np.flatnonzero(patch[:, u])
        below = kind[rows[-1] + 1 : rows[-1] + 4, u]
        columns.append(Column(int(u), int(rows[0]), int(rows[-1]), len(below) == 0 or FLOOR_PIXEL in below))
    return columns


def add_feet(columns: list[Column], inverse: NDArray[np.float32], kind: NDArray[np.uint8], sight: Sight) -> None:
    """Let columns end at the foot of narrow things with depth below them."""

    def foot(c: Column) -> int:
        last, seen = c.lowest, False
        for v in range(c.lowest + 1, len(kind)):
            if v - last > 3:
                return -1
            if kind[v, c.u] == FLOOR_PIXEL:
                return sight.row_below(c.u, last, float(inverse[last, c.u])) if seen else -1
            if kind[v, c.u] in (OBSTACLE_PIXEL, FLYING_PIXEL):
                last, seen = v, True
        return -1

    feet = [-1 if c.on_floor else foot(c) for c in columns]
    lowest, k = [c.lowest for c in columns], 0
    while k < len(columns):
        n = 0
        while k + n < len(columns) and feet[k + n] >= 0:
            n += 1
        if n and k >= 3 and k + n + 3 <= len(columns):
            beside = lowest[k - 3], lowest[k + n + 2]
            even = all(min(beside) - 3 <= row <= max(beside) + 3 for row in lowest[k : k + n])
            z = sight.depth(columns[k].u + 0.5 * (n - 1), max(feet[k : k + n]) + 1.0)
            if even and n * z <= 0.15 * sight.camera.fx:
                for c, row in zip(columns[k : k + n], feet[k : k + n], strict=True):
                    c.lowest, c.on_floor = row, True
        k += n + 1


def lay_line(columns: list[Column], sight: Sight) -> None:
    """The lowest line over the feet: a foot is its corner where no line between two others is lower."""

    def over(u: int) -> float:
        lines = ((a, b) for a in feet for b in feet if a.u < u < b.u)
        return max((a.lowest + (b.lowest - a.lowest) * (u - a.u) / (b.u - a.u) for a, b in lines), default=-np.inf)

    feet = [c for c in columns if c.on_floor]
    corners = [c for c in feet if c.lowest > over(c.u) + 1e-9]
    for c in corners:
        c.line = c.lowest
    for a, b in itertools.pairwise(corners):
        ends = [sight.meets(c.u, c.lowest + 1.0) * sight.ray(c.u, c.lowest + 1.0)[:2] for c in (a, b)]
        hangs = np.isfinite(ends).all() and np.hypot(*(ends[0] - ends[1])) <= 2.5
        for c in columns:
            if a.u < c.u < b.u and (hangs or c.on_floor):
                c.line = a.lowest + (b.lowest - a.lowest) * (c.u - a.u) / (b.u - a.u) if hangs else c.lowest
    for c in columns:
        c.near = np.inf if np.isnan(c.line) else sight.meets(c.u, c.line + 1.0)
        if np.isfinite(c.near) and np.isfinite(sight.meets(c.u, c.lowest + 1.0)):
            c.hangs = sight.above_floor * (1.0 - c.near / sight.meets(c.u, c.lowest + 1.0))


def straighten_ends(columns: list[Column], sight: Sight) -> None:
    feet = [k for k, c in enumerate(columns) if c.on_floor]
    for end, step in ((feet[0], 1), (feet[-1], -1)):
        beside = end + 3 * step
        if not 0 <= beside < len(columns) or abs(columns[end].lowest - columns[beside].lowest) > 3:
            continue
        part, k = [columns[end]], end + step
        while 0 <= k < len(columns) and columns[k].line > columns[k].lowest + 1e-9:
            part.append(columns[k])
            k += step
        high = max([c.hangs for c in part[1:]], default=0.0)
        if 0.02 < high < 0.40:
            for c in part:
                c.near *= (sight.above_floor - high) / (sight.above_floor - c.hangs)
                c.hangs = high


def behind_legs(columns: list[Column], sight: Sight) -> float:
    """Distance at which a thing of four legs ends."""
    pieces: list[list[Column]] = [[columns[0]]]
    for c in columns[1:]:
        if abs(c.lowest - pieces[-1][-1].lowest) < 4:
            pieces[-1].append(c)
        else:
            pieces.append([c])
    ends = []
    for k, piece in enumerate(pieces):
        from_left = k == 0 or piece[0].lowest > pieces[k - 1][-1].lowest
        to_right = k + 1 == len(pieces) or piece[-1].lowest > pieces[k + 1][0].lowest
        row = max(c.lowest for c in piece) + 1.0
        narrow = len(piece) * sight.depth(piece[0].u, row) <= 0.15 * sight.camera.fx
        if from_left and to_right and narrow and any(c.on_floor for c in piece):
            ends.append(sight.meets(piece[0].u, row))
    return max(ends) + 0.2 if len(ends) >= 4 else np.inf


def naive_dark(
    inverse: NDArray[np.float32],
    hole_kind: NDArray[np.uint8],
    kind: NDArray[np.uint8],
    color: NDArray[np.uint8],
    camera: CameraIntrinsics,
    T: NDArray[np.float64],
    corner: tuple[float, float, float],
    shape: tuple[int, int],
    margin: float,
) -> NDArray[np.bool_]:
    """(rows, cols) bool: cells below dark things without depth, or in the margin before one."""
    sight, below = Sight(camera, T), np.zeros(shape, np.uint8)
    for patch in naive_patches(hole_kind, color, int(1.2e-3 * camera.fx * camera.fy)):
        columns = naive_columns(patch, kind)
        add_feet(columns, inverse, kind, sight)
        if sum(c.on_floor for c in columns) < 3:
            continue
        lay_line(columns, sight)
        straighten_ends(columns, sight)
        legs_end = behind_legs(columns, sight)
        for c in columns:
            if not np.isfinite(c.near):
                continue
            meets = sight.meets(c.u, c.lowest + 1.0)
            on_legs = not np.isfinite(meets) or c.hangs >= 0.40
            far = min(c.near + 1.2, max(legs_end, c.near)) if on_legs else c.near + 2.0
            over = kind[max(c.highest - 3, 0) : c.highest, c.u]
            if np.isfinite(meets) and np.isin(over, (FLOOR_PIXEL, WALL_PIXEL, BEYOND_PIXEL)).any():
                top = sight.meets(c.u, c.highest - 1.0)
                far = min(far, max(top * (1.0 - c.hangs / sight.above_floor), c.near)) if np.isfinite(top) else far
            far = min(far, meets)
            begin = c.near - margin + 0.5 * corner[2]
            toward = sight.ray(c.u, c.line + 1.0)[:2]
            for r in np.linspace(begin, far, max(int(2.0 * (far - begin) / corner[2]) + 1, 1) + 1):
                j, i = (int(np.floor(p)) for p in (toward * r - corner[:2]) / corner[2])
                if 0 <= i < shape[0] and 0 <= j < shape[1]:
                    below[i, j] = 1
    return np.asarray(cv2.morphologyEx(below, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0)
