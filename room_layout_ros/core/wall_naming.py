"""Names of the walls: front is the visible wall that faces the camera most, left and right follow.

Which axis is called Z is a convention, not a measurement, so evidence can be turned to another naming, and every
estimate ends in the same one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .labels import FRONT_WALL, LEFT_WALL, N_FACES, RIGHT_WALL
from .layout import RoomCuboid

_LEFT, _FRONT, _RIGHT = LEFT_WALL - 1, FRONT_WALL - 1, RIGHT_WALL - 1


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
        turned[..., _FRONT] = probability[..., _RIGHT]
        turned[..., _LEFT] = probability[..., _FRONT] + probability[..., _LEFT]
        turned[..., _RIGHT] = 0.0
    else:
        turned[..., _FRONT] = probability[..., _LEFT]
        turned[..., _RIGHT] = probability[..., _FRONT] + probability[..., _RIGHT]
        turned[..., _LEFT] = 0.0
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
    facing = [abs(R[axis, 2]) if seen[wall] else -1.0 for wall, axis in ((_LEFT, 0), (_FRONT, 2), (_RIGHT, 0))]
    best = int(np.argmax(facing))
    if best == 1 or facing[best] <= facing[1] or (seen[_LEFT] and seen[_RIGHT]):
        return cuboid, np.arange(N_FACES)
    x, y, z = R
    origin = np.array([0, 1, -1, -1, -1])
    if best == 0:
        axes, origin[_FRONT], origin[_RIGHT] = np.array([z, y, -x]), _LEFT, _FRONT
    else:
        axes, origin[_FRONT], origin[_LEFT] = np.array([-z, y, x]), _RIGHT, _FRONT
    named = np.where(origin >= 0, distances[origin], np.inf)
    return RoomCuboid(axes, named), origin
