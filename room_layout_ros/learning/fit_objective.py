"""How badly a cuboid explains the labels and depths of a frame: the objective of the layout fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..core.layout import FACE_AXIS, FACE_SIGN
from .fit_observation import FitObservation


@dataclass(frozen=True, slots=True)
class FitCosts:
    """Costs per pixel; 1 is a wall pixel that does not lie on its face.

    Attributes
    ----------
    wrong_class : structural pixel on a face of another kind (wall on the floor...).
    clutter_beyond : clutter behind the room's faces. clutter_apart : clutter far in front of a wall (weak pull).
    fitted_apart : fitted furniture half a metre or more in front of a wall.
    open : clutter where no face is hit (a room has no hole).
    unlabelled : factor for unlabelled pixels, which count as clutter.
    opening_beyond : points seen through a window, door or mirror.
    face : for each face in use, as a share of all pixels: a face must pay for itself.
    tolerance_m, tolerance_per_m : residual at which a pixel counts as off its plane, at 0 m and per metre.
    floor_height_m, floor_sigma_m, floor_prior : camera height expected where no floor is seen.
    """

    wrong_class: float = 1.5
    clutter_beyond: float = 0.8
    clutter_apart: float = 0.12
    fitted_apart: float = 0.35
    open: float = 0.8
    unlabelled: float = 0.3
    opening_beyond: float = 0.3
    face: float = 0.004
    tolerance_m: float = 0.10
    tolerance_per_m: float = 0.025
    floor_height_m: float = 1.2
    floor_sigma_m: float = 0.3
    floor_prior: float = 0.01


def fit_cost(
    seen: FitObservation, R: NDArray[np.float64], distances: NDArray[np.float64], costs: FitCosts, stride: int = 1
) -> float:
    """Return the mean cost per pixel of a cuboid (about 0: perfect; above 0.5: no room).

    Parameters
    ----------
    R : (3, 3) rows are the room axes in the camera frame. distances : (5,) metres, inf where out of view.
    stride : use each stride-th pixel.
    """
    inverse_normals = FACE_SIGN[:, None] * R[FACE_AXIS] / distances[:, None]
    mean = _mean_cost(
        seen.rays, seen.inverse_depth, seen.kind, inverse_normals, distances, stride,
        costs.wrong_class, costs.clutter_beyond, costs.clutter_apart, costs.fitted_apart, costs.open,
        costs.unlabelled, costs.opening_beyond,
        costs.tolerance_m, costs.tolerance_per_m,
    )  # fmt: skip
    prior = 0.0
    if np.isfinite(distances[1]):
        prior = min(((float(distances[1]) - costs.floor_height_m) / costs.floor_sigma_m) ** 2, 9.0)
    return float(mean) + costs.face * int(np.isfinite(distances).sum()) + costs.floor_prior * prior


@njit(cache=True, nogil=True)
def _mean_cost(  # type: ignore[no-untyped-def]
    rays, inverse_depth, kind, m, distances, stride,
    wrong_class, clutter_beyond, clutter_apart, fitted_apart, open_cost,
    unlabelled, opening_beyond, tolerance, per_metre,
):  # fmt: skip
    total, used = 0.0, 0
    for i in range(0, rays.shape[0], stride):
        best, face = 1e-3, -1  # a face more than a kilometre away is no face
        for k in range(5):
            value = m[k, 0] * rays[i, 0] + m[k, 1] * rays[i, 1] + m[k, 2] * rays[i, 2]
            if value > best:
                best, face = value, k
        used += 1
        what = kind[i]
        w = inverse_depth[i]
        beyond = 0.0  # distance of the point behind the face's plane, in tolerances
        apart = 0.0  # in front of it, metres
        if w > 0.0 and face >= 0:
            offset = distances[face] * (best / w - 1.0)
            if offset > 0.0:
                beyond = min(offset / (tolerance + per_metre / w), 1.0)
            else:
                apart = -offset
        off = beyond * beyond
        if face < 0 and (what == 0 or what >= 5):
            cost = open_cost
        elif what == 0 or what == 5:
            cost = clutter_beyond * off + clutter_apart * min(apart, 1.0)
            if what == 0:
                cost *= unlabelled
        elif what == 6:
            cost = clutter_beyond * off + fitted_apart * min(2.0 * apart, 1.0)
        elif face < 0:
            cost = wrong_class
        elif (what == 2 and face != 1) or (what == 3 and face != 0) or ((what == 1 or what == 4) and face < 2):
            cost = wrong_class
        else:
            if apart > 0.0:
                near = min(apart / (tolerance + per_metre / w), 1.0)
                off = near * near
            elif what == 4:
                off *= opening_beyond
            cost = off
        total += cost
    return total / max(used, 1)
