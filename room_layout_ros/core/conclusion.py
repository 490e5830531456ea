"""From the joint solution to the estimate: continuous refinement, pixel labels, confidence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .depth import DepthGeometry
from .estimate import RoomEstimate, Status
from .frame import RgbdFrame
from .joint import JointEstimate
from .labels import CLUTTER, N_FACES
from .layout import RoomCuboid
from .manhattan import ManhattanFrame
from .room_fit import FittedRoom, refine_room, room_cells, search_room
from .superpixels import Superpixels
from .wall_naming import name_walls

_LEAST_FACE_PX = 30


def refine_cuboid(
    cuboid: RoomCuboid,
    geometry: DepthGeometry | None,
    superpixels: Superpixels,
    context: NDArray[np.float64],
) -> RoomCuboid:
    """Turn the axes and move the planes of the discrete optimum to the best continuous cuboid; needs depth.

    The refinement starts from the joint solution and from the best cuboid over candidate offsets (`room_fit`), and keeps
    the better one.

    Parameters
    ----------
    cuboid : RoomCuboid
    geometry : DepthGeometry or None
        Without depth the cuboid is returned as it is.
    context : (K, 6) float64 label probabilities.
    """
    if geometry is None:
        return cuboid
    cells = room_cells(geometry, context, superpixels.index)
    starts = (FittedRoom(cuboid.R_room_camera, cuboid.distances, np.inf), search_room(cells, cuboid.R_room_camera))
    room = min((refine_room(cells, start) for start in starts), key=lambda room: room.cost)
    return RoomCuboid(room.R_room_camera, room.distances)


def faces_in_view(layout: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(5,) bool: faces that cover more than a few pixels of a layout image."""
    return np.bincount(layout.ravel(), minlength=N_FACES + 1)[1 : N_FACES + 1] >= _LEAST_FACE_PX


def conclude(
    frame: RgbdFrame,
    axes: ManhattanFrame,
    superpixels: Superpixels,
    joint: JointEstimate,
    cuboid: RoomCuboid,
    timings_ms: Mapping[str, float],
) -> RoomEstimate:
    """Put the estimate together.

    A pixel of a superpixel that is structure has the face of the layout there (a superpixel may lie across an edge
    of the room); all pixels of a clutter superpixel are clutter.
    """
    cuboid, origin = name_walls(cuboid, faces_in_view(cuboid.raster(frame.camera)))
    layout = cuboid.raster(frame.camera)
    clutter = joint.labels == CLUTTER
    seen = faces_in_view(layout)
    face_confidence = np.where(seen & (origin >= 0), joint.solution.face_confidence[origin], 0.0)
    return RoomEstimate(
        status=Status.OK if joint.solution.finished else Status.DEADLINE,
        layout=layout,
        labels=np.where(clutter[superpixels.index], np.uint8(CLUTTER), layout),
        furniture=np.zeros_like(layout),
        superpixels=superpixels.index,
        R_room_camera=cuboid.R_room_camera,
        axes_confidence=axes.confidence,
        confidence=float(axes.confidence * face_confidence[seen].mean()) if seen.any() else 0.0,
        face_confidence=face_confidence,
        cuboid=cuboid,
        polygons=cuboid.polygons(frame.camera),
        metric=frame.depth_m is not None,
        energy=joint.solution.energy,
        lower_bound=joint.solution.bound,
        timings_ms=dict(timings_ms),
        stamp_ns=frame.stamp_ns,
        frame_id=frame.frame_id,
        name=frame.name,
    )
