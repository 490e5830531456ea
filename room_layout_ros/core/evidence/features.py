"""Features of superpixels for the learned evidence: what they look like, where they are, what is around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..depth import depth_sigma
from ..frame import CameraIntrinsics
from ..labels import FURNITURE_IDS
from ..lines import LineSegments
from ..network.scene_network import SuperpixelScene
from ..superpixels import Superpixels
from . import pixel_statistics as ps
from .depth_cues import superpixel_planes
from .plane_segments import compute_plane_segments
from .room_extents import BEYOND_STEP_M, RoomExtents, azimuth_bin, compute_room_extents
from .segment_features import segment_columns
from .surroundings import Columns, average_around, color_alike, color_contrast, look_around

_BEHIND_MARGIN_M = 0.25
_LEAST_PROBABILITY = 1e-4


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
    extents: RoomExtents | None = None,
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
    extents : RoomExtents, optional
        Of the depth, where they are known already.

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
        extents = extents or compute_room_extents(inverse_depth, R_room_camera, camera)
        columns |= _depth(superpixels, sums, bounds, extents, R_room_camera, camera)
    columns |= average_around(columns, superpixels)
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
        **color_contrast(superpixels, mean),
        **color_alike(superpixels, mean),
    }


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
    furniture = list(FURNITURE_IDS)
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
    noise = depth_sigma(z)
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
    bounds[np.isnan(n), 4:] = np.nan
    columns |= segment_columns(superpixels, segments, point, normal, bounds, extents, camera)
    return columns


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
