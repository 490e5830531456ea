"""The named baseline "depth": no learning; planes by support and violation, labels by distance, colour for segments."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .depth import DepthGeometry
from .depth_cells import gather_depth_cells
from .depth_layout import ScoredLayout, search_layout
from .estimate import RoomEstimate, Status
from .frame import RgbdFrame
from .geometric_labelling import label_by_geometry
from .layout import RoomCuboid
from .manhattan import ManhattanFrame
from .superpixels import Superpixels
from .wall_naming import NAME_TIE

_HYPOTHESES = 4


def estimate_from_depth(
    frame: RgbdFrame,
    geometry: DepthGeometry,
    axes: ManhattanFrame,
    superpixels: Superpixels,
    timings_ms: Mapping[str, float],
) -> RoomEstimate:
    """Estimate the room from depth alone (`depth_layout`, `geometric_labelling`)."""
    cells = gather_depth_cells(geometry)
    room = best_layout([search_layout(cells, R) for R in axes.hypotheses[:_HYPOTHESES]])
    cuboid = RoomCuboid(room.R_room_camera, room.distances)
    layout = cuboid.raster(frame.camera)
    labels = label_by_geometry(cuboid, layout, geometry, superpixels.index, superpixels.count)
    belief = room.support / (room.support + room.violation + 0.05)
    return RoomEstimate(
        status=Status.OK,
        layout=layout,
        labels=labels[superpixels.index],
        furniture=np.zeros_like(layout),
        superpixels=superpixels.index,
        R_room_camera=cuboid.R_room_camera,
        axes_confidence=axes.confidence,
        confidence=float(np.clip(axes.confidence * (0.5 + room.score), 0.0, 1.0)),
        face_confidence=np.where(np.isfinite(room.distances), belief, 0.0),
        cuboid=cuboid,
        polygons=cuboid.polygons(frame.camera),
        timings_ms=timings_ms,
        stamp_ns=frame.stamp_ns,
        frame_id=frame.frame_id,
        name=frame.name,
    )


def best_layout(rooms: list[ScoredLayout]) -> ScoredLayout:
    """The layout with the highest score; near ties go to the earlier hypothesis, so that names do not flicker."""
    best = rooms[0]
    for room in rooms[1:]:
        if room.score > best.score + NAME_TIE:
            best = room
    return best
