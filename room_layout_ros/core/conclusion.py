"""From the joint solution to the estimate: continuous refinement, pixel labels, confidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .confidence import ConfidenceModel, Signs, state_confidence
from .depth import DepthGeometry
from .edge_refinement import RoomPicture, refine_on_edges
from .estimate import RoomEstimate, Status
from .frame import CameraIntrinsics, RgbdFrame
from .joint import JointEstimate
from .labels import CLUTTER, N_LABELS
from .layout import RoomCuboid
from .lines import LineSegments
from .manhattan import ManhattanFrame
from .room_balance import balance_faces
from .room_cells import image_cells, room_cells
from .room_cost import IMAGE_COSTS, FittedRoom, cell_costs, rate_room
from .room_refinement import refine_room
from .room_search import search_room
from .scene_network import SceneScores
from .superpixels import Superpixels
from .wall_naming import name_walls, rename_walls

_LEAST_FACE_PX = 30
_HOPELESS = 1.03
"""A start that costs this much more than the other is not refined; it hardly ever ends up better."""


@dataclass(frozen=True, slots=True)
class RefinedRoom:
    """The final cuboid and what speaks for and against it.

    Attributes
    ----------
    cost : mean cost per cell of the fit (`room_cost`), 0 without depth.
    balance : (5, 3) support, violation and area per face (`room_balance`), 0 without depth.
    measured : share of pixels with depth. certainty : mean of the largest probability of the
        context, 0 without one.
    """

    cuboid: RoomCuboid
    cost: float
    balance: NDArray[np.float64]
    measured: float
    certainty: float


def refine_cuboid(
    joint: JointEstimate,
    geometry: DepthGeometry | None,
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    context: NDArray[np.float64] | None,
    axes: ManhattanFrame,
    scores: SceneScores | None,
    color: NDArray[np.uint8] | None = None,
    segments: LineSegments | None = None,
) -> RefinedRoom:
    """Turn the axes and move the planes of the discrete optimum to the best continuous cuboid.

    With depth the refinement starts from the joint solution and from the best cuboid over candidate offsets
    (`room_search`), keeps the better one and, where there is a picture, moves it onto the edges seen there
    (`edge_refinement`). Without, the image decides: context and labels in equal parts. Where no context is known, the
    labels alone are believed.

    Parameters
    ----------
    joint : JointEstimate
    geometry : DepthGeometry or None
    context : (K, 6) float64 label probabilities, None where there are none.
    axes : ManhattanFrame, in whose naming the scene network sees the walls.
    scores : SceneScores or None
        The face behind each part of the image, which counts besides.
    color : (H, W, 3) uint8 or None. segments : of it, or None.
    """
    cuboid = joint.cuboid
    labels = np.eye(N_LABELS)[joint.labels.astype(np.intp) - 1]
    believed = labels if context is None else context
    behind = None if scores is None else rename_walls(scores.layout, axes.R_room_camera, cuboid.R_room_camera)
    certainty = 0.0 if context is None else float(np.average(context.max(axis=1), weights=superpixels.pixels))
    start = FittedRoom(cuboid.R_room_camera, cuboid.distances, np.inf)
    if geometry is None:
        cells = image_cells(camera, 0.5 * believed + 0.5 * labels, superpixels.index, behind)
        room = refine_room(cell_costs(cells, IMAGE_COSTS), start, turn=False)
        measured = 0.0
    else:
        cells = room_cells(geometry, believed, superpixels.index, behind)
        rated = cell_costs(cells)
        starts = (rate_room(rated, start), search_room(rated, cuboid.R_room_camera))
        limit = _HOPELESS * min(start.cost for start in starts)
        room = min((refine_room(rated, start) for start in starts if start.cost <= limit), key=lambda room: room.cost)
        if color is not None and segments is not None:
            picture = RoomPicture(color, segments, superpixels.index, joint.labels == CLUTTER)
            moved = refine_on_edges(cells, camera, picture, room.R_room_camera, room.distances)
            room = rate_room(rated, FittedRoom(*moved, np.inf))
        measured = geometry.measured
    balance = balance_faces(cells, room.R_room_camera, room.distances)
    return RefinedRoom(RoomCuboid(room.R_room_camera, room.distances), room.cost, balance, measured, certainty)


def conclude(
    frame: RgbdFrame,
    axes: ManhattanFrame,
    superpixels: Superpixels,
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
    seen = pixels[1:] >= _LEAST_FACE_PX
    cuboid, origin = name_walls(room.cuboid, seen)
    if cuboid is not room.cuboid:
        layout, pixels = cuboid.view(frame.camera)
        seen = pixels[1:] >= _LEAST_FACE_PX
    metric = room.measured > 0.0  # depth that is empty or not used gives no scale
    if not metric:
        cuboid = cuboid.at_unit_scale()
    clutter = joint.labels == CLUTTER
    signs = gather_signs(axes, joint, room, origin)
    confidence, face_confidence = state_confidence(signs, seen, model)
    return RoomEstimate(
        status=Status.OK if joint.solution.finished else Status.DEADLINE,
        layout=layout,
        labels=_paint_labels(layout, superpixels.index, clutter),
        furniture=furniture,
        superpixels=superpixels.index,
        R_room_camera=cuboid.R_room_camera,
        axes_confidence=axes.confidence,
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
