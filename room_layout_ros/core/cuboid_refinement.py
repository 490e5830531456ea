"""From the room of the joint solution, whose planes are at states of the rays, to the best continuous cuboid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config import EDGES, NONE
from .edge_refinement import RoomPicture, refine_on_edges
from .frame import RgbdFrame
from .joint import JointEstimate
from .labels import CLUTTER, N_LABELS
from .layout import RoomCuboid
from .observation import Observation
from .room_balance import balance_faces
from .room_cells import image_cells, room_cells
from .room_cost import IMAGE_COSTS, CellCosts, FittedRoom, cell_costs, rate_room
from .room_refinement import refine_room
from .room_search import search_room
from .wall_naming import rename_walls

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
    seen: Observation,
    context: NDArray[np.float64] | None,
    frame: RgbdFrame,
    way: str = EDGES,
) -> RefinedRoom:
    """Turn the axes and move the planes of the discrete optimum to the best continuous cuboid.

    With depth the refinement starts from the joint solution and from the best cuboid over candidate offsets
    (`room_search`), keeps the better one and, where there is a picture, moves it onto the edges seen there
    (`edge_refinement`). Without, the image decides: context and labels in equal parts. Where no context is known, the
    labels alone are believed.

    Parameters
    ----------
    joint : JointEstimate
    seen : Observation
        Of `frame`. What the scene network says of the face behind each part of the image counts besides.
    context : (K, 6) float64 label probabilities, None where there are none.
    frame : RgbdFrame
        Its colour is looked at where line segments are seen in it.
    way : `config.EDGES`, `DEPTH` (not onto the edges of the picture) or `NONE` (the discrete optimum stays).
    """
    cuboid, geometry, index, scores = joint.cuboid, seen.geometry, seen.superpixels.index, seen.scores
    labels = np.eye(N_LABELS)[joint.labels.astype(np.intp) - 1]
    believed = labels if context is None else context
    behind = None if scores is None else rename_walls(scores.layout, seen.axes.R_room_camera, cuboid.R_room_camera)
    certainty = 0.0 if context is None else float(np.average(context.max(axis=1), weights=seen.superpixels.pixels))
    start = FittedRoom(cuboid.R_room_camera, cuboid.distances, np.inf)
    if geometry is None:
        cells = image_cells(frame.camera, 0.5 * believed + 0.5 * labels, index, behind)
        rated = cell_costs(cells, IMAGE_COSTS)
        room = rate_room(rated, start) if way == NONE else refine_room(rated, start, turn=False)
        measured = 0.0
    else:
        cells = room_cells(geometry, believed, index, behind)
        rated = cell_costs(cells)
        room = rate_room(rated, start) if way == NONE else _fit_depth(rated, start)
        if way == EDGES and frame.color is not None and seen.segments is not None:
            picture = RoomPicture(frame.color, seen.segments, index, joint.labels == CLUTTER)
            moved = refine_on_edges(cells, frame.camera, picture, room.R_room_camera, room.distances)
            room = rate_room(rated, FittedRoom(*moved, np.inf))
        measured = geometry.measured
    balance = balance_faces(cells, room.R_room_camera, room.distances)
    return RefinedRoom(RoomCuboid(room.R_room_camera, room.distances), room.cost, balance, measured, certainty)


def _fit_depth(rated: CellCosts, start: FittedRoom) -> FittedRoom:
    """The better of the room refined from the start and from the best one over candidate offsets."""
    starts = (rate_room(rated, start), search_room(rated, start.R_room_camera))
    limit = _HOPELESS * min(start.cost for start in starts)
    return min((refine_room(rated, start) for start in starts if start.cost <= limit), key=lambda room: room.cost)
