"""Names of the walls: front is the visible wall that faces the camera most, left and right follow.

Which axis is called Z is a convention, not a measurement, so evidence can be turned to another naming, and every
estimate ends in the same one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .labels import FRONT_FACE, LEFT_FACE, N_FACES, RIGHT_FACE, WALL_FACES
from .layout import RoomCuboid

NAME_TIE = 1e-3
"""A naming of the axes wins over an earlier one by more than this (of an energy or a score), so that names do not
flicker."""


def rename_walls(
    probability: NDArray[np.float64], R_from: NDArray[np.float64], R_to: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (..., 5 or 6) probabilities of faces or labels given under the axes `R_from`, named by the axes `R_to`.

    When the new front axis is the old X, the right wall becomes the front one, the front one the left, and the old left
    wall is behind the camera; its probability stays with left, the nearest name. The other side likewise. Axes that are
    no such turn of each other (another triple altogether) leave the names as they are.
    """
    turned = probability.copy()
    along_x = float(R_to[2] @ R_from[0])
    if abs(along_x) < np.cos(np.deg2rad(30.0)):
        return turned
    if along_x > 0:
        turned[..., FRONT_FACE] = probability[..., RIGHT_FACE]
        turned[..., LEFT_FACE] = probability[..., FRONT_FACE] + probability[..., LEFT_FACE]
        turned[..., RIGHT_FACE] = 0.0
    else:
        turned[..., FRONT_FACE] = probability[..., LEFT_FACE]
        turned[..., RIGHT_FACE] = probability[..., FRONT_FACE] + probability[..., RIGHT_FACE]
        turned[..., LEFT_FACE] = 0.0
    return turned


def name_walls(cuboid: RoomCuboid, seen: NDArray[np.bool_]) -> tuple[RoomCuboid, NDArray[np.intp]]:
    """Name the walls of a cuboid by the rule; only a side wall whose opposite is out of view can become the front one.

    Parameters
    ----------
    cuboid : RoomCuboid
    seen : (5,) bool, faces in view.

    Returns
    -------
    cuboid : RoomCuboid
        The same planes, other names; a plane that ends up behind the camera is dropped (it was not seen).
    origin : (5,) index of each face among the old ones, -1 for a face that is new and absent.
    """
    R, distances = cuboid.R_room_camera, cuboid.distances
    facing = [abs(R[axis, 2]) if seen[wall] else -1.0 for wall, axis in zip(WALL_FACES, (0, 2, 0), strict=True)]
    best = int(np.argmax(facing))
    if best == 1 or facing[best] <= facing[1] or (seen[LEFT_FACE] and seen[RIGHT_FACE]):
        return cuboid, np.arange(N_FACES)
    x, y, z = R
    origin = np.array([0, 1, -1, -1, -1])
    if best == 0:
        axes, origin[FRONT_FACE], origin[RIGHT_FACE] = np.array([z, y, -x]), LEFT_FACE, FRONT_FACE
    else:
        axes, origin[FRONT_FACE], origin[LEFT_FACE] = np.array([-z, y, x]), RIGHT_FACE, FRONT_FACE
    named = np.where(origin >= 0, distances[origin], np.inf)
    return RoomCuboid(axes, named), origin
