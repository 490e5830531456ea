"""Evidence under another naming of the walls: which visible wall is called front is a convention, not a measurement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .labels import FRONT_WALL, LEFT_WALL, RIGHT_WALL

_LEFT, _FRONT, _RIGHT = LEFT_WALL - 1, FRONT_WALL - 1, RIGHT_WALL - 1


def rename_walls(
    probability: NDArray[np.float64], R_from: NDArray[np.float64], R_to: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (K, 6) label probabilities given under the axes `R_from`, named by the axes `R_to`.

    When the new front axis is the old X, the right wall becomes the front one, the front one the left, and the old left
    wall is behind the camera; its probability stays with left, the nearest name. The other side likewise. Axes that are
    no such turn of each other (another triple altogether) leave the names as they are.
    """
    turned = probability.copy()
    along_x = float(R_to[2] @ R_from[0])
    if abs(along_x) < np.cos(np.deg2rad(30.0)):
        return turned
    if along_x > 0:
        turned[:, _FRONT] = probability[:, _RIGHT]
        turned[:, _LEFT] = probability[:, _FRONT] + probability[:, _LEFT]
        turned[:, _RIGHT] = 0.0
    else:
        turned[:, _FRONT] = probability[:, _LEFT]
        turned[:, _RIGHT] = probability[:, _FRONT] + probability[:, _RIGHT]
        turned[:, _LEFT] = 0.0
    return turned
