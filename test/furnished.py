"""Bare synthetic rooms with a few boxes, and the estimate that an estimator without fault would give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import FreeSpace, compute_free_space
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import SyntheticRoom, random_scene
from room_layout_ros.datasets.synthetic.shapes import Material, Solid

CONFIG = EstimatorConfig()
GREY = Material((120, 120, 120))


def with_truth(sample: Sample) -> RoomEstimate:
    """The estimate that an estimator without fault would give."""
    assert sample.truth is not None
    assert sample.truth.layout is not None
    assert sample.truth.labels is not None
    assert sample.truth.furniture is not None
    assert sample.truth.cuboid is not None
    blank = no_estimate_of(sample)
    return replace(
        blank,
        layout=sample.truth.layout,
        labels=sample.truth.labels,
        furniture=sample.truth.furniture,
        cuboid=sample.truth.cuboid,
        R_room_camera=sample.truth.cuboid.R_room_camera,
    )


def no_estimate_of(sample: Sample) -> RoomEstimate:
    size = (sample.frame.camera.height, sample.frame.camera.width)
    return RoomEstimate(
        Status.OK, np.zeros(size, np.uint8), np.zeros(size, np.uint8), np.zeros(size, np.uint8),
        np.zeros(size, np.int32), np.eye(3), 1.0, 1.0, np.ones(5), None, (),
    )  # fmt: skip


def free_space_of(frame: RgbdFrame, estimate: RoomEstimate, config: EstimatorConfig = CONFIG) -> FreeSpace:
    geometry = compute_depth_geometry(frame, config)
    assert geometry is not None
    result = compute_free_space(geometry, estimate, config, color=frame.color)
    assert result is not None
    return result


def ahead_of(
    free_space: FreeSpace, ahead: tuple[float, float], half_width: float, left: float = 0.0
) -> NDArray[np.int8]:
    """Cells of a rectangle before the camera, its middle so far to the left, m."""
    (x0, y0), (rows, cols) = free_space.origin_m, free_space.grid.shape
    x, y = x0 + 0.05 * (np.arange(cols) + 0.5), y0 + 0.05 * (np.arange(rows) + 0.5)
    return np.asarray(free_space.grid[np.ix_(np.abs(y - left) < half_width, (x > ahead[0]) & (x < ahead[1]))])


def empty(*solids: Solid) -> SyntheticRoom:
    return random_scene(np.random.default_rng(0), furniture=0.0, decorate=False).furnished(solids)


def box(x: float, y: float, size: float, top: float, bottom: float = 0.0) -> Solid:
    return Solid(x, y, 0.0, size, size, bottom, top, 5, GREY, thing=1)
