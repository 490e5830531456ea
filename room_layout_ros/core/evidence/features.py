"""Features of superpixels for the learned evidence: what they look like, where they are, what is around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..labels import FURNITURE_NYU40
from ..lines import LineSegments
from ..scene_network import SuperpixelScene
from ..superpixels import Superpixels
from . import pixel_statistics as ps
from .depth_cues import superpixel_planes
from .plane_reach import COLUMNS as REACH_COLUMNS
from .plane_reach import compute_plane_reach
from .plane_segments import PlaneSegments, compute_plane_segments
from .room_extents import BEYOND_STEP_M, RoomExtents, azimuth_bin, compute_room_extents

Columns = dict[str, NDArray[np.floating]]

_BEHIND_MARGIN_M = 0.25
_LEAST_PROBABILITY = 1e-4
_ALIKE_COLOR = 12.0
"""Difference in 8-bit Lab at which two colours are half as much alike."""


@dataclass(frozen=True, slots=True)
class SuperpixelFeatures:
    """Table of features, one row per superpixel.

    Attributes
    ----------
    values : (K, F) float32
        NaN where a feature is not known (no colour, no depth, no plane).
    names : tuple of F strings.
    """

    values: NDArray[np.float32]
    names: tuple[str, ...]


def compute_superpixel_features(
    superpixels: Superpixels,
    color: NDArray[np.uint8] | None,
    inverse_depth: NDArray[np.float32] | None,
    R_room_camera: NDArray[np.float64],
    camera: CameraIntrinsics,
    segments: LineSegments | None = None,
    line_class: NDArray[np.int8] | None = None,
    orientation: NDArray[np.uint8] | None = None,
) -> SuperpixelFeatures:
    """Compute all features that the inputs allow.

    Parameters
    ----------
    superpixels : Superpixels
    color : (H, W, 3) uint8 or None
    inverse_depth : (H, W) float32 or None
        1/m, 0 where not measured. Without it all depth columns are absent.
    R_room_camera : (3, 3) float64
    camera : CameraIntrinsics
    segments, line_class : LineSegments, (n,) int8, optional
    orientation : (H, W) uint8, optional
        `compute_orientation_map`.

    Returns
    -------
    SuperpixelFeatures
        The columns depend only on whether there is depth, in a fixed order.
    """
    sums, bounds = ps.sum_pixels(
        superpixels.index, superpixels.count, color, inverse_depth, orientation, R_room_camera, camera
    )
    columns = _position(superpixels, sums, bounds, R_room_camera, camera)
    columns |= _appearance(superpixels, sums)
    columns |= _lines(superpixels, sums, segments, line_class)
    if inverse_depth is not None:
        extents = compute_room_extents(inverse_depth, R_room_camera, camera)
        columns |= _depth(superpixels, sums, bounds, extents, R_room_camera, camera)
    _add_surroundings(columns, superpixels)
    columns |= look_around(columns, camera.height / camera.width)
    return SuperpixelFeatures(np.stack(list(columns.values()), axis=1).astype(np.float32), tuple(columns))


def add_scene(features: SuperpixelFeatures, scene: SuperpixelScene | None) -> SuperpixelFeatures:
    """Append what the scene network says about each superpixel; the features as they are without one."""
    if scene is None:
        return features
    columns = _scene(scene)
    added = np.stack(list(columns.values()), axis=1).astype(np.float32)
    return SuperpixelFeatures(np.concatenate([features.values, added], axis=1), (*features.names, *columns))


def _position(
    superpixels: Superpixels,
    sums: NDArray[np.float64],
    bounds: NDArray[np.float32],
    R: NDArray[np.float64],
    camera: CameraIntrinsics,
) -> Columns:
    n = np.maximum(sums[:, ps.COUNT], 1.0)
    x, y = superpixels.center_px.astype(np.float64).T
    mx, my = sums[:, ps.PX] / n, sums[:, ps.PY] / n
    vx, vy = sums[:, ps.PXX] / n - mx * mx, sums[:, ps.PYY] / n - my * my
    vxy = sums[:, ps.PXY] / n - mx * my
    root = np.sqrt(np.maximum((vx - vy) ** 2 / 4 + vxy**2, 0.0))
    major, minor = (vx + vy) / 2 + root, np.maximum((vx + vy) / 2 - root, 1e-3)
    ray = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], 1) @ R.T
    flat = np.hypot(ray[:, 0], ray[:, 2])
    size = np.float64(camera.width)
    return {
        "x": x / camera.width,
        "y": y / camera.height,
        "border_x": np.minimum(bounds[:, 0], camera.width - 1 - bounds[:, 1]) / size,
        "border_top": bounds[:, 2] / size,
        "border_bottom": (camera.height - 1 - bounds[:, 3]) / size,
        "box_width": (bounds[:, 1] - bounds[:, 0]) / size,
        "box_height": (bounds[:, 3] - bounds[:, 2]) / size,
        "area": superpixels.pixels / float(camera.width * camera.height),
        "elongation": np.sqrt(major / minor),
        "upright": (vy - vx) / np.maximum(major + minor, 1e-6),
        "elevation": np.arctan2(ray[:, 1], flat),
        "azimuth": np.arctan2(ray[:, 0], ray[:, 2]),
        "tilt": np.full(len(x), np.arcsin(np.clip(R[1, 2], -1.0, 1.0))),
    }


def _appearance(superpixels: Superpixels, sums: NDArray[np.float64]) -> Columns:
    n = np.where(sums[:, ps.COLORED] > 4, sums[:, ps.COLORED], np.nan)
    mean = sums[:, [ps.L, ps.A, ps.B]] / n[:, None]
    deviation = np.sqrt(np.maximum(sums[:, [ps.LL, ps.AA, ps.BB]] / n[:, None] - mean**2, 0.0))
    gx, gy = sums[:, ps.GRADIENT_X] / n, sums[:, ps.GRADIENT_Y] / n
    fine = sums[:, ps.FINE] / n
    some = np.isfinite(mean[:, 0])
    average = mean[some].mean(axis=0) if some.any() else np.full(3, np.nan)
    return {
        "L": mean[:, 0],
        "a": mean[:, 1],
        "b": mean[:, 2],
        "chroma": np.hypot(mean[:, 1] - 128.0, mean[:, 2] - 128.0),
        "L_relative": mean[:, 0] - average[0],
        "L_deviation": deviation[:, 0],
        "ab_deviation": np.hypot(deviation[:, 1], deviation[:, 2]),
        "gradient": gx + gy,
        "gradient_ratio": (gx - gy) / (gx + gy + 1.0),
        "fine": fine,
        "frame_gradient": np.full(len(n), (gx + gy)[some].mean() if some.any() else np.nan),
        **_contrast(superpixels, mean),
        **_alike(superpixels, mean),
    }


def _alike(superpixels: Superpixels, mean: NDArray[np.float64]) -> Columns:
    """How much of the image has this colour, and where: walls and floors come in several pieces."""
    area = superpixels.pixels / float(superpixels.pixels.sum())
    difference = mean[:, None, :] - mean[None, :, :]
    kernel = np.exp((difference * difference).sum(axis=2) * (-0.5 / _ALIKE_COLOR**2)) * area
    share = np.nansum(kernel, axis=1)
    known = np.isfinite(mean[:, 0])
    height = superpixels.center_px[:, 1] / np.float64(superpixels.index.shape[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.nansum(kernel * height, axis=1) / share
    return {"alike": np.where(known, share, np.nan), "alike_y": np.where(known, level, np.nan)}


def _contrast(superpixels: Superpixels, mean: NDArray[np.float64]) -> Columns:
    """Difference in colour to the neighbours: its mean by border length, and to the most similar one."""
    i, j = superpixels.edges[:, 0], superpixels.edges[:, 1]
    difference = np.sqrt(((mean[i] - mean[j]) ** 2).sum(axis=1))
    known = np.isfinite(difference)
    i, j, difference, length = i[known], j[known], difference[known], superpixels.edge_length[known]
    count = superpixels.count
    total = np.bincount(i, length, count) + np.bincount(j, length, count)
    weighted = np.bincount(i, length * difference, count) + np.bincount(j, length * difference, count)
    least = np.full(count, np.inf)
    np.minimum.at(least, i, difference)
    np.minimum.at(least, j, difference)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {"contrast": weighted / total, "contrast_least": np.where(np.isfinite(least), least, np.nan)}


def _lines(
    superpixels: Superpixels,
    sums: NDArray[np.float64],
    segments: LineSegments | None,
    line_class: NDArray[np.int8] | None,
) -> Columns:
    nan = np.full(superpixels.count, np.nan)
    columns: Columns = {f"om_{k}": nan for k in range(1, 6)}
    columns |= {f"lines_{name}": nan for name in ("x", "y", "z", "none")}
    if segments is None or line_class is None:
        return columns
    n = np.maximum(sums[:, ps.COUNT], 1.0)
    lengths = ps.count_lines(superpixels.index, superpixels.count, segments, line_class)
    density = lengths / np.sqrt(np.maximum(superpixels.pixels, 1))[:, None]
    columns |= {f"om_{k}": sums[:, ps.ORIENTATION + k] / n for k in range(1, 6)}
    columns |= {f"lines_{name}": density[:, k] for k, name in enumerate(("x", "y", "z", "none"))}
    return columns


def _scene(scene: SuperpixelScene) -> Columns:
    """Log probabilities by the scene network: labels, the face behind, the furniture classes."""
    furniture = list(FURNITURE_NYU40)
    groups = {"label": scene.labels, "behind": scene.layout, "class": scene.classes[:, furniture]}
    names = {"label": range(1, 7), "behind": range(1, 6), "class": furniture}
    return {
        f"scene_{group}_{name}": np.log(values[:, k] + _LEAST_PROBABILITY)
        for group, values in groups.items()
        for k, name in enumerate(names[group])
    }


def _depth(
    superpixels: Superpixels,
    sums: NDArray[np.float64],
    bounds: NDArray[np.float32],
    extents: RoomExtents,
    R: NDArray[np.float64],
    camera: CameraIntrinsics,
) -> Columns:
    n = np.where(sums[:, ps.MEASURED] > 4, sums[:, ps.MEASURED], np.nan)
    point = sums[:, [ps.X, ps.Y, ps.Z]] / n[:, None]
    spread = np.sqrt(np.maximum(sums[:, [ps.XX, ps.YY, ps.ZZ]] / n[:, None] - point**2, 0.0))
    z = sums[:, ps.DEPTH] / n
    in_camera, distance, _ = superpixel_planes(superpixels, camera)
    normal = in_camera @ R.T
    noise = 0.01 + 0.0019 * z * z
    room_low = np.where(np.isnan(n)[:, None], np.nan, bounds[:, 4::2].astype(np.float64))
    room_high = np.where(np.isnan(n)[:, None], np.nan, bounds[:, 5::2].astype(np.float64))
    columns: Columns = {
        "depth": z,
        "measured": superpixels.measured,
        "cos_x": np.abs(normal[:, 0]),
        "cos_y": np.abs(normal[:, 1]),
        "cos_z": np.abs(normal[:, 2]),
        "normal_x": normal[:, 0],
        "normal_y": normal[:, 1],
        "normal_z": normal[:, 2],
        "plane_residual": superpixels.plane_rms * z * z / noise,
        "depth_deviation": np.sqrt(np.maximum(sums[:, ps.DEPTH2] / n - z * z, 0.0)),
        "spread_x": spread[:, 0],
        "spread_y": spread[:, 1],
        "spread_z": spread[:, 2],
        "size_m2": superpixels.pixels * z * z / (camera.fx * camera.fy),
        "facing": normal[:, 0] * point[:, 0] + normal[:, 1] * point[:, 1] + normal[:, 2] * point[:, 2],
    }
    columns["facing"] = columns["facing"] / np.linalg.norm(point, axis=1)
    columns |= _reach(point, normal, extents)
    segments = compute_plane_segments(superpixels, normal, distance, point)
    for k, name in enumerate(("farther", "nearer", "coplanar", "concave", "convex")):
        columns[f"border_{name}"] = segments.border[:, k]
    columns |= _plane_columns(superpixels, segments, point, normal, room_low, room_high, bounds, extents, camera)
    columns |= _plane_reach(superpixels, segments, point, normal, bounds, extents)
    return columns


def _plane_reach(
    superpixels: Superpixels,
    segments: PlaneSegments,
    point: NDArray[np.float64],
    normal: NDArray[np.float64],
    bounds: NDArray[np.float32],
    extents: RoomExtents,
) -> Columns:
    """What lies beyond the mean plane of the segment each superpixel belongs to."""
    segment, count = segments.segment, segments.count
    flat = np.isfinite(normal[:, 0]) & np.isfinite(point[:, 0])
    area = np.where(flat, superpixels.pixels, 0.0)
    values = np.nan_to_num(np.concatenate([normal, point], axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        sums = np.stack([np.bincount(segment, area * value, count) for value in values.T], axis=1)
        mean = sums / np.bincount(segment, area, count)[:, None]
        unit = mean[:, :3] / np.linalg.norm(mean[:, :3], axis=1, keepdims=True)
    planes = np.concatenate([unit, (unit * mean[:, 3:]).sum(axis=1, keepdims=True)], axis=1)
    boxes = np.empty((count, 4))
    boxes[:, 0::2], boxes[:, 1::2] = np.inf, -np.inf
    for k in range(4):
        (np.fmax if k % 2 else np.fmin).at(boxes[:, k], segment, bounds[:, k].astype(np.float64))
    boxes[~np.isfinite(boxes)] = 0.0
    reach = compute_plane_reach(extents.cells, extents.low, extents.high, planes, boxes)[segment]
    return {name: reach[:, k] for k, name in enumerate(REACH_COLUMNS)}


def _reach(point: NDArray[np.float64], normal: NDArray[np.float64], extents: RoomExtents) -> Columns:
    """Where the superpixel stands between the scene's ends, and how much lies behind it."""
    low, high = extents.low, extents.high
    span = np.maximum(high - low, 0.3)
    horizontal = np.hypot(point[:, 0], point[:, 2])
    measured = np.isfinite(horizontal)
    k = azimuth_bin(np.where(measured, point[:, 0], 0.0), np.where(measured, point[:, 2], 1.0))
    farthest = extents.farthest
    around = np.maximum(np.maximum(farthest, np.roll(farthest, 1)), np.roll(farthest, -1))
    columns: Columns = {
        "to_ceiling": point[:, 1] - low[1],
        "to_floor": high[1] - point[:, 1],
        "to_left": point[:, 0] - low[0],
        "to_right": high[0] - point[:, 0],
        "to_front": high[2] - point[:, 2],
        "to_back": point[:, 2] - low[2],
        "share_x": (point[:, 0] - low[0]) / span[0],
        "share_y": (point[:, 1] - low[1]) / span[1],
        "share_z": (point[:, 2] - low[2]) / span[2],
        "span_x": np.full(len(point), span[0]),
        "span_y": np.full(len(point), span[1]),
        "span_z": np.full(len(point), span[2]),
        "camera_height": np.full(len(point), high[1]),
        "to_farthest": around[k] - horizontal,
        "range_share": horizontal / np.maximum(around[k], 0.1),
        "X": point[:, 0],
        "Y": point[:, 1],
        "Z": point[:, 2],
    }
    for axis, name in enumerate("xyz"):
        columns[f"behind_{name}"] = _behind(point[:, axis], axis, extents)
    aligned = np.argmax(np.nan_to_num(np.abs(normal)), axis=1)
    behind = np.stack([columns["behind_x"], columns["behind_y"], columns["behind_z"]], axis=1)
    ends = np.stack(
        [
            np.where(point[:, 0] < 0, columns["to_left"], columns["to_right"]),
            np.where(point[:, 1] < 0, columns["to_ceiling"], columns["to_floor"]),
            columns["to_front"],
        ],
        axis=1,
    )
    rows = np.arange(len(point))
    planar = np.isfinite(normal[:, 0])
    columns["behind_plane"] = np.where(planar, behind[rows, aligned], np.nan)
    columns["plane_to_end"] = np.where(planar, ends[rows, aligned], np.nan)
    columns["axis"] = np.where(planar, aligned, np.nan)
    return columns


def _behind(value: NDArray[np.float64], axis: int, extents: RoomExtents) -> NDArray[np.float64]:
    """Share of the scene's cells that lie farther out along the axis than the value and a margin."""
    side = (value > 0).astype(int)
    k = np.minimum((np.abs(np.nan_to_num(value)) + _BEHIND_MARGIN_M) / BEYOND_STEP_M, 63).astype(int)
    return np.where(np.isfinite(value), extents.beyond[axis, side, k], np.nan)


def _plane_columns(
    superpixels: Superpixels,
    segments: PlaneSegments,
    point: NDArray[np.float64],
    normal: NDArray[np.float64],
    room_low: NDArray[np.float64],
    room_high: NDArray[np.float64],
    bounds: NDArray[np.float32],
    extents: RoomExtents,
    camera: CameraIntrinsics,
) -> Columns:
    """Features of the plane segment each superpixel belongs to."""
    segment, count = segments.segment, segments.count
    area = superpixels.pixels.astype(np.float64)
    total = np.bincount(segment, area, count)

    def mean(value: NDArray[np.floating]) -> NDArray[np.float64]:
        known = np.isfinite(value)
        weight = np.bincount(segment[known], area[known], count)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.bincount(segment[known], area[known] * value[known], count) / weight)[segment]

    def extreme(value: NDArray[np.floating], low: bool) -> NDArray[np.float64]:
        out = np.full(count, np.inf if low else -np.inf)
        (np.fmin if low else np.fmax).at(out, segment, value)
        return np.where(np.isfinite(out), out, np.nan)[segment]

    top, bottom = extreme(room_low[:, 1], True), extreme(room_high[:, 1], False)
    wide_x = extreme(room_high[:, 0], False) - extreme(room_low[:, 0], True)
    wide_z = extreme(room_high[:, 2], False) - extreme(room_low[:, 2], True)
    size = superpixels.pixels * point[:, 2] ** 2 / (camera.fx * camera.fy)
    return {
        "segment_area": (total / area.sum())[segment],
        "segment_members": np.bincount(segment, minlength=count)[segment].astype(float),
        "segment_m2": np.bincount(segment, np.nan_to_num(size), count)[segment],
        "segment_top": top - extents.low[1],
        "segment_bottom": extents.high[1] - bottom,
        "segment_height": bottom - top,
        "segment_wide": np.hypot(wide_x, wide_z),
        "segment_wide_x": wide_x,
        "segment_wide_z": wide_z,
        "segment_box_top": extreme(bounds[:, 2], True) / camera.height,
        "segment_box_bottom": extreme(bounds[:, 3], False) / camera.height,
        "segment_normal_x": np.abs(mean(normal[:, 0])),
        "segment_normal_y": np.abs(mean(normal[:, 1])),
        "segment_normal_z": np.abs(mean(normal[:, 2])),
        "segment_farther": mean(segments.border[:, 0]),
        "segment_nearer": mean(segments.border[:, 1]),
        "segment_concave": mean(segments.border[:, 3]),
        "segment_convex": mean(segments.border[:, 4]),
    }


_SURROUNDINGS = (
    "L",
    "chroma",
    "gradient",
    "L_deviation",
    "om_2",
    "om_4",
    "normal_y",
    "cos_x",
    "cos_z",
    "depth",
    "Y",
    "to_farthest",
    "plane_residual",
    "behind_plane",
    "border_farther",
    "border_convex",
    "segment_area",
)


def _add_surroundings(columns: Columns, superpixels: Superpixels) -> None:
    """Append the border-weighted means of some columns over the neighbours."""
    names = [name for name in _SURROUNDINGS if name in columns]
    values = np.ascontiguousarray(np.stack([columns[name] for name in names], axis=1), np.float64)
    mean = _neighbour_means(values, superpixels.edges, superpixels.edge_length)
    for k, name in enumerate(names):
        columns[f"around_{name}"] = mean[:, k]


@njit(cache=True, nogil=True)
def _neighbour_means(values, edges, length):  # type: ignore[no-untyped-def]
    """(K, c) means over the neighbours that know the value, weighted by the common border; NaN where none does."""
    total = np.zeros_like(values)
    weight = np.zeros_like(values)
    for e in range(edges.shape[0]):
        for side in range(2):
            here, there = edges[e, side], edges[e, 1 - side]
            for k in range(values.shape[1]):
                value = values[there, k]
                if value == value:
                    total[here, k] += length[e] * value
                    weight[here, k] += length[e]
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            total[i, k] = total[i, k] / weight[i, k] if weight[i, k] > 0.0 else np.nan
    return total


_NEAR, _FAR = 0.12, 0.3
_VIEWS = {
    "above": (0.0, -_NEAR),
    "below": (0.0, _NEAR),
    "left": (-_NEAR, 0.0),
    "right": (_NEAR, 0.0),
    "far_above": (0.0, -_FAR),
    "far_below": (0.0, _FAR),
    "far_left": (-_FAR, 0.0),
    "far_right": (_FAR, 0.0),
}
"""Offsets in image widths at which `look_around` looks."""

_VIEWED = ("L", "gradient", "om_2", "om_4", "Y", "cos_y", "to_farthest", "border_farther", "depth")
_RELATIVE = ("L", "Y", "depth")


def look_around(columns: Columns, aspect: float) -> Columns:
    """Features of the superpixels at fixed offsets in the image, some relative to the own ones.

    Parameters
    ----------
    columns : with at least x, y, L, a, b of all superpixels of one image.
    aspect : height of the image over its width.

    Returns
    -------
    dict of (K,) arrays
        NaN where the offset leads out of the image.
    """
    x, y = columns["x"].astype(np.float64), columns["y"].astype(np.float64) * aspect
    lab = np.stack([columns["L"], columns["a"], columns["b"]], axis=1)
    names = [name for name in _VIEWED if name in columns]
    found: Columns = {}
    for view, (dx, dy) in _VIEWS.items():
        px, py = x + dx, y + dy
        there = ((px[:, None] - x) ** 2 + (py[:, None] - y) ** 2).argmin(axis=1)
        outside = (px < 0) | (px > 1) | (py < 0) | (py > aspect)
        found[f"{view}_contrast"] = np.where(outside, np.nan, np.sqrt(((lab[there] - lab) ** 2).sum(axis=1)))
        for name in names:
            value = columns[name][there] - (columns[name] if name in _RELATIVE else 0.0)
            found[f"{view}_{name}"] = np.where(outside, np.nan, value)
    return found
