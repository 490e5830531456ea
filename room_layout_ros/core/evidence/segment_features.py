"""Features of the plane segment each superpixel belongs to: how large, where it ends, what lies beyond its plane."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..frame import CameraIntrinsics
from ..superpixels import Superpixels
from .plane_reach import COLUMNS as REACH_COLUMNS
from .plane_reach import compute_plane_reach
from .plane_segments import PlaneSegments
from .room_extents import RoomExtents
from .surroundings import Columns


def segment_columns(
    superpixels: Superpixels,
    segments: PlaneSegments,
    point: NDArray[np.float64],
    normal: NDArray[np.float64],
    bounds: NDArray[np.float32],
    extents: RoomExtents,
    camera: CameraIntrinsics,
) -> Columns:
    """Compute the features of each superpixel's segment.

    Parameters
    ----------
    superpixels, segments : K superpixels in S segments.
    point, normal : (K, 3) float64 mean point and plane normal in room axes, m; NaN where not known.
    bounds : (K, 10) float32 of `pixel_statistics.sum_pixels`.
    extents : RoomExtents
    camera : CameraIntrinsics
    """
    segment, count = segments.segment, segments.count
    area = superpixels.pixels.astype(np.float64)
    size = np.nan_to_num(area * point[:, 2] ** 2 / (camera.fx * camera.fy))
    averaged = np.concatenate([normal, segments.border[:, [0, 1, 3, 4]]], axis=1, dtype=np.float64)
    mean = _segment_means(segment, count, area, averaged)
    box = _segment_bounds(segment, count, bounds)
    wide_x, wide_z = box[:, 5] - box[:, 4], box[:, 9] - box[:, 8]
    columns: Columns = {
        "segment_area": np.bincount(segment, area, count) / area.sum(),
        "segment_members": np.bincount(segment, minlength=count).astype(np.float64),
        "segment_m2": np.asarray(np.bincount(segment, size, count), np.float64),
        "segment_top": box[:, 6] - extents.low[1],
        "segment_bottom": extents.high[1] - box[:, 7],
        "segment_height": box[:, 7] - box[:, 6],
        "segment_wide": np.hypot(wide_x, wide_z),
        "segment_wide_x": wide_x,
        "segment_wide_z": wide_z,
        "segment_box_top": box[:, 2] / camera.height,
        "segment_box_bottom": box[:, 3] / camera.height,
        "segment_normal_x": np.abs(mean[:, 0]),
        "segment_normal_y": np.abs(mean[:, 1]),
        "segment_normal_z": np.abs(mean[:, 2]),
        "segment_farther": mean[:, 3],
        "segment_nearer": mean[:, 4],
        "segment_concave": mean[:, 5],
        "segment_convex": mean[:, 6],
    }
    planes = _mean_planes(segment, count, area, normal, point)
    reach = compute_plane_reach(extents.cells, extents.low, extents.high, planes, np.nan_to_num(box[:, :4]))
    columns |= {name: reach[:, k] for k, name in enumerate(REACH_COLUMNS)}
    return {name: values[segment] for name, values in columns.items()}


def _mean_planes(
    segment: NDArray[np.int32],
    count: int,
    area: NDArray[np.float64],
    normal: NDArray[np.float64],
    point: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(S, 4) mean normal and distance of each segment; NaN without a plane."""
    flat = np.isfinite(normal[:, 0]) & np.isfinite(point[:, 0])
    values = np.concatenate([normal, point], axis=1)
    values[~flat] = np.nan
    mean = _segment_means(segment, count, area, values)
    unit = mean[:, :3] / np.sqrt((mean[:, :3] ** 2).sum(axis=1, keepdims=True))
    return np.concatenate([unit, (unit * mean[:, 3:]).sum(axis=1, keepdims=True)], axis=1)


@njit(cache=True, nogil=True)
def _segment_means(segment, count, area, values):  # type: ignore[no-untyped-def]
    """(S, c) means by area over the members that know the value; NaN where none does."""
    total = np.zeros((count, values.shape[1]))
    weight = np.zeros((count, values.shape[1]))
    for i in range(len(segment)):
        for k in range(values.shape[1]):
            if not np.isnan(values[i, k]):
                total[segment[i], k] += area[i] * values[i, k]
                weight[segment[i], k] += area[i]
    for s in range(count):
        for k in range(values.shape[1]):
            total[s, k] = total[s, k] / weight[s, k] if weight[s, k] > 0.0 else np.nan
    return total


@njit(cache=True, nogil=True)
def _segment_bounds(segment, count, bounds):  # type: ignore[no-untyped-def]
    """(S, 10) bounds of the members together, low and high in turn; NaN where none has any."""
    box = np.full((count, bounds.shape[1]), np.nan)
    for i in range(len(segment)):
        whole = box[segment[i]]
        for k in range(bounds.shape[1]):
            value = bounds[i, k]
            if np.isnan(whole[k]) or (value > whole[k] if k % 2 else value < whole[k]):
                whole[k] = value
    return box
