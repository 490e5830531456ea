"""From one colour + depth frame to the room: the whole estimate on one screen."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from .config import EstimatorConfig
from .depth import compute_depth_geometry
from .depth_layout import ScoredLayout, gather_evidence, search_layout
from .estimate import RoomEstimate, Status
from .frame import CameraIntrinsics, RgbdFrame
from .geometric_labelling import label_by_geometry
from .labels import N_FACES
from .layout import RoomCuboid
from .lines import compute_line_segments
from .manhattan import ManhattanFrame, estimate_manhattan_frame
from .superpixels import compute_superpixels
from .tracking import TemporalPrior

P = ParamSpec("P")
T = TypeVar("T")


class StageClock:
    """Runs named stages and keeps their wall time in ms."""

    def __init__(self) -> None:
        self.timings_ms: dict[str, float] = {}

    def __call__(self, stage: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        start = time.perf_counter_ns()
        value = function(*args, **kwargs)
        self.timings_ms[stage] = self.timings_ms.get(stage, 0.0) + (time.perf_counter_ns() - start) * 1e-6
        return value


class LayoutEstimator:
    """Estimates layout and clutter of the room in a frame. Holds settings and weights only; safe to share.

    Parameters
    ----------
    config : EstimatorConfig, optional
    """

    def __init__(self, config: EstimatorConfig | None = None) -> None:
        self.config = config or EstimatorConfig()

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None = None) -> RoomEstimate:
        """Estimate the room in one frame.

        Parameters
        ----------
        frame : RgbdFrame
        prior : TemporalPrior, optional
            Of the previous frame (`tracking.next_prior`); without it the frame stands alone and the result depends
            on nothing else.

        Returns
        -------
        RoomEstimate
            Always; its `status` says whether a room was found.
        """
        run = StageClock()
        config = self.config
        prior = prior or TemporalPrior()

        geometry = run("depth", compute_depth_geometry, frame, config)
        if geometry is None:
            return no_estimate(Status.NO_DEPTH, frame, run)
        color = frame.color if config.use_color else None
        segments = None if color is None else run("lines", compute_line_segments, color, config)
        axes = run("axes", estimate_manhattan_frame, geometry, segments, prior.R_room_camera, prior.gravity)
        if axes is None:
            return no_estimate(Status.NO_ROOM, frame, run)
        superpixels = run("superpixels", compute_superpixels, color, geometry.inverse_depth, config)
        room = run("layout", lambda: best_layout([search_layout(gather_evidence(geometry, R), R) for R in axes.hypotheses[:4]]))
        cuboid = RoomCuboid(room.R_room_camera, room.distances)
        layout = run("raster", cuboid.raster, frame.camera)
        names = run("labelling", label_by_geometry, cuboid, layout, geometry, superpixels.index, superpixels.count)
        return RoomEstimate(
            status=Status.OK,
            layout=layout,
            labels=names[superpixels.index],
            furniture=np.zeros_like(layout),
            superpixels=superpixels.index,
            R_room_camera=room.R_room_camera,
            axes_confidence=axes.confidence,
            confidence=_confidence(axes, room),
            face_confidence=_face_confidence(room, frame.camera),
            cuboid=cuboid,
            polygons=run("polygons", cuboid.polygons, frame.camera),
            timings_ms=run.timings_ms,
            stamp_ns=frame.stamp_ns,
            frame_id=frame.frame_id,
            name=frame.name,
        )


def best_layout(rooms: list[ScoredLayout]) -> ScoredLayout:
    """The layout with the highest score; near ties go to the earlier hypothesis, so that names do not flicker."""
    best = rooms[0]
    for room in rooms[1:]:
        if room.score > best.score + 1e-3:
            best = room
    return best


def no_estimate(status: Status, frame: RgbdFrame, run: StageClock) -> RoomEstimate:
    """The answer where there is none: empty images and the reason."""
    size = (frame.camera.height, frame.camera.width)
    return RoomEstimate(
        status=status,
        layout=np.zeros(size, np.uint8),
        labels=np.zeros(size, np.uint8),
        furniture=np.zeros(size, np.uint8),
        superpixels=np.zeros(size, np.int32),
        R_room_camera=np.eye(3),
        axes_confidence=0.0,
        confidence=0.0,
        face_confidence=np.zeros(N_FACES),
        cuboid=None,
        polygons=(),
        timings_ms=run.timings_ms,
        stamp_ns=frame.stamp_ns,
        frame_id=frame.frame_id,
        name=frame.name,
    )


def _face_confidence(room: ScoredLayout, camera: CameraIntrinsics) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Support of each face against what lies beyond it; 0 for a face that is not in view."""
    return np.where(np.isfinite(room.distances), room.support / (room.support + room.violation + 0.05), 0.0)


def _confidence(axes: ManhattanFrame, room: ScoredLayout) -> float:
    return float(np.clip(axes.confidence * (0.5 + room.score), 0.0, 1.0))
