"""Frames and estimates for the Rerun viewer: pictures, points and the room in 3-D, confidences over time."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import FACES, LABEL_COLORS, LABEL_NAMES
from room_layout_ros.datasets import DataError
from room_layout_ros.extras import install_hint

from .face_text import face_text

_POINT_STRIDE = 4
_NO_VIEWER = "the viewer cannot be opened here; write a file with --rrd FILE"


class RerunLog:
    """Writes to one Rerun recording; make it by `to_file` or `to_viewer`."""

    def __init__(self, rerun: Any, stream: Any) -> None:
        self._rerun, self._stream = rerun, stream
        rows = zip(range(len(LABEL_NAMES)), LABEL_NAMES, LABEL_COLORS.tolist(), strict=True)
        stream.log("/", rerun.AnnotationContext([(i, name, color) for i, name, color in rows]), static=True)
        stream.log("room", rerun.ViewCoordinates.RDF, static=True)

    @classmethod
    def to_file(cls, path: Path) -> RerunLog:
        """Record to a .rrd file.

        Raises
        ------
        DataError
            When Rerun is not installed.
        """
        rerun = _rerun()
        stream = rerun.RecordingStream("room_layout_ros")
        stream.save(str(path))
        return cls(rerun, stream)

    @classmethod
    def to_viewer(cls) -> RerunLog:
        """Open the viewer.

        Raises
        ------
        DataError
            When Rerun is not installed, or there is no screen: the viewer would log for 20 s and die.
        """
        rerun = _rerun()
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise DataError(_NO_VIEWER)
        stream = rerun.RecordingStream("room_layout_ros")
        try:
            stream.spawn()
        except RuntimeError:
            raise DataError(_NO_VIEWER) from None
        return cls(rerun, stream)

    def add(self, frame: RgbdFrame, estimate: RoomEstimate, milliseconds: float) -> None:
        """Log one frame at its stamp; `milliseconds` is the wall time of its estimate."""
        rr, stream = self._rerun, self._stream
        stream.set_time("stamp", duration=frame.stamp_ns * 1e-9)
        camera = frame.camera
        lens = rr.Pinhole(image_from_camera=camera.matrix, width=camera.width, height=camera.height)
        stream.log("room/camera", lens)
        if frame.color is not None:
            stream.log("room/camera/color", rr.Image(frame.color).compress(jpeg_quality=85))
        stream.log("room/camera/labels", rr.SegmentationImage(estimate.labels))
        stream.log("layout", rr.SegmentationImage(estimate.layout))
        if frame.depth_m is not None:
            self._points(frame, estimate)
        outlines = [np.vstack([p.points_m, p.points_m[:1]]) for p in estimate.polygons]
        colors = [LABEL_COLORS[p.face] for p in estimate.polygons]
        labels = [face_text(p.face, p.distance, estimate.metric) for p in estimate.polygons]
        stream.log("room/faces", rr.LineStrips3D(outlines, colors=colors, labels=labels, radii=0.015))
        stream.log("confidence/frame", rr.Scalars(estimate.confidence))
        for face, confidence in zip(FACES, estimate.face_confidence, strict=True):
            stream.log(f"confidence/{LABEL_NAMES[face].replace(' ', '_')}", rr.Scalars(float(confidence)))
        stream.log("milliseconds", rr.Scalars(milliseconds))

    def close(self) -> None:
        """Write out what is still held back; raises DataError where the viewer has gone."""
        try:
            self._stream.flush()
        except RuntimeError:
            raise DataError(_NO_VIEWER) from None
        self._stream.disconnect()

    def _points(self, frame: RgbdFrame, estimate: RoomEstimate) -> None:
        assert frame.depth_m is not None
        step = _POINT_STRIDE
        depth, labels = frame.depth_m[::step, ::step], estimate.labels[::step, ::step]
        seen = np.isfinite(depth) & (depth > 0)
        points = frame.camera.rays()[::step, ::step][seen] * depth[seen][:, None]
        self._stream.log("room/points", self._rerun.Points3D(points, class_ids=labels[seen], radii=0.01))


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise DataError(f"the interactive view needs Rerun: {install_hint('viz')}") from None
    return rerun
