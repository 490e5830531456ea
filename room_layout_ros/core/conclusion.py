"""From the joint solution and the refined room to the estimate: names of the walls, pixel labels, confidence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .confidence import ConfidenceModel, Signs, state_confidence
from .cuboid_refinement import RefinedRoom
from .estimate import RoomEstimate, Status
from .frame import RgbdFrame
from .joint import JointEstimate
from .labels import CLUTTER
from .manhattan import ManhattanFrame
from .observation import Observation
from .wall_naming import name_walls

_LEAST_FACE_PX = 30


def conclude(
    frame: RgbdFrame,
    seen: Observation,
    joint: JointEstimate,
    room: RefinedRoom,
    furniture: NDArray[np.uint8],
    model: ConfidenceModel,
    timings_ms: Mapping[str, float],
) -> RoomEstimate:
    """Put the estimate together.

    A pixel of a superpixel that is structure has the face of the layout there (a superpixel may lie across an edge
    of the room); all pixels of a clutter superpixel are clutter.
    """
    layout, pixels = room.cuboid.view(frame.camera)
    in_view = pixels[1:] >= _LEAST_FACE_PX
    cuboid, origin = name_walls(room.cuboid, in_view)
    if cuboid is not room.cuboid:
        layout, pixels = cuboid.view(frame.camera)
        in_view = pixels[1:] >= _LEAST_FACE_PX
    cuboid = cuboid.in_view(pixels)
    metric = room.measured > 0.0  # depth that is empty or not used gives no scale
    if not metric:
        cuboid = cuboid.at_unit_scale()
    clutter = joint.labels == CLUTTER
    signs = gather_signs(seen.axes, joint, room, origin)
    confidence, face_confidence = state_confidence(signs, in_view, model)
    return RoomEstimate(
        status=Status.OK if joint.solution.finished else Status.DEADLINE,
        layout=layout,
        labels=_paint_labels(layout, seen.superpixels.index, clutter),
        furniture=furniture,
        superpixels=seen.superpixels.index,
        R_room_camera=cuboid.R_room_camera,
        axes_confidence=seen.axes.confidence,
        confidence=confidence,
        face_confidence=face_confidence,
        cuboid=cuboid,
        polygons=cuboid.polygons(frame.camera),
        metric=metric,
        energy=joint.solution.energy,
        lower_bound=joint.solution.bound,
        timings_ms=dict(timings_ms),
        stamp_ns=frame.stamp_ns,
        frame_id=frame.frame_id,
        name=frame.name,
        signs=signs,
    )


def gather_signs(axes: ManhattanFrame, joint: JointEstimate, room: RefinedRoom, origin: NDArray[np.intp]) -> Signs:
    """Collect what the confidences are computed from; `origin` is each face's index before the walls were named."""
    belief = joint.solution.face_confidence
    in_view = belief > 0
    mean_belief = float(belief[in_view].mean()) if in_view.any() else 0.0
    of_frame = np.array([room.cost, axes.confidence, room.certainty, mean_belief, room.measured])
    of_faces = np.column_stack([room.balance, belief])
    return Signs(of_frame, np.where((origin >= 0)[:, None], of_faces[origin], 0.0))


@njit(cache=True, nogil=True)
def _paint_labels(layout, index, clutter):  # type: ignore[no-untyped-def]
    """The layout, with clutter over the superpixels that are."""
    labels = np.empty_like(layout)
    height, width = layout.shape
    for y in range(height):
        for x in range(width):
            labels[y, x] = CLUTTER if clutter[np.uint32(index[y, x])] else layout[y, x]
    return labels
