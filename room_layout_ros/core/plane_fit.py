"""Metric agreement of labels and layout: does a superpixel lie on the plane of the face it is labelled as?

Beyond the paper, whose compatibility only counts pixels. For a superpixel labelled face k the term depends on the
offset of plane k alone: with the layout fixed it is a unary term of the labels, with the labels fixed a unary term of
the rays, so both half steps of the alternation stay as they are.

All values are linear interpolations over the offsets of `depth_profiles`, so that both half steps see the same energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import depth_sigma
from .depth_profiles import OFFSETS, curve_position
from .frame import CameraIntrinsics
from .labels import N_FACES
from .layout import FACE_AXIS, FACE_SIGN
from .superpixels import Superpixels

N_FIT = 3
"""On the plane, in front of it, beyond it."""

_TOLERANCE_M = 0.06
_SPAN_M = 0.30
"""Fully in front or beyond, this much outside the tolerance."""
_NORMAL_RAD = np.deg2rad(12.0)


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """Where the superpixels lie along the normals of the five faces.

    Attributes
    ----------
    offset : (K, 5) float64, m of the centroid along each outward normal; NaN where no plane was found.
    agreement : (K, 5) float64 0..1, how well the superpixel's normal is the face's.
    tolerance : (K,) float64, m within which it is on the plane.
    """

    offset: NDArray[np.float64]
    agreement: NDArray[np.float64]
    tolerance: NDArray[np.float64]

    def at(self, distances: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (K, 5, 3) shares on, in front of and beyond planes at (5,) distances in m, +inf an absent one."""
        return _at(self.offset, self.agreement, self.tolerance, OFFSETS, distances)

    def curves(
        self, labels: NDArray[np.int64], area: NDArray[np.float64], weights: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the cost of labels (K,) as a function of each plane's offset, (5, n), and where it is absent, (5,)."""
        return _curves(self.offset, self.agreement, self.tolerance, OFFSETS, labels, area, weights)

    def least(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the least cost per area that each label can have at any offset: (K, 6), clutter 0."""
        result = np.zeros((len(self.offset), N_FACES + 1))
        result[:, :N_FACES] = np.inf
        for distance in (*OFFSETS, np.inf):
            cost = np.einsum("kfr,fr->kf", self.at(np.full(N_FACES, distance)), weights)
            np.minimum(result[:, :N_FACES], cost, out=result[:, :N_FACES])
        return result


def compute_plane_fit(camera: CameraIntrinsics, superpixels: Superpixels, R: NDArray[np.float64]) -> PlaneFit:
    """Place the superpixels' planes in the room axes R (rows X right, Y down, Z front)."""
    camera_numbers = camera.numbers
    return PlaneFit(
        *_place(superpixels.center_px, superpixels.plane, FACE_SIGN[:, None] * R[FACE_AXIS], camera_numbers)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _place(centre, plane, outward, camera):  # type: ignore[no-untyped-def]
    """Offset and agreement (K, 5) and tolerance (K,), for the outward normals (5, 3)."""
    fx, fy, cx, cy = camera
    offset, agreement = np.full((len(plane), 5), np.nan), np.zeros((len(plane), 5))
    tolerance = np.empty(len(plane))
    for k in range(len(plane)):
        a, b, c = plane[k, 0], plane[k, 1], plane[k, 2]
        x, y = float(centre[k, 0]), float(centre[k, 1])
        inverse = a * x + b * y + c
        z = 1.0 / inverse if inverse > 0.0 else 1.0  # for the noise, where nothing is known
        tolerance[k] = _TOLERANCE_M + 2.0 * depth_sigma(z)
        mx, my, mz = a * fx, b * fy, c + a * cx + b * cy
        length = np.sqrt(mx * mx + my * my + mz * mz)
        for f in range(5):
            cosine = (mx * outward[f, 0] + my * outward[f, 1] + mz * outward[f, 2]) / length
            if cosine == cosine:
                agreement[k, f] = np.exp(-(1.0 - min(max(cosine, -1.0), 1.0)) / _NORMAL_RAD**2)
            if inverse > 0.0:
                u, v = (x - cx) / fx, (y - cy) / fy
                offset[k, f] = z * (u * outward[f, 0] + v * outward[f, 1] + outward[f, 2])
    return offset, agreement, tolerance


@njit(cache=True, nogil=True)
def _shares(gap, agreement, tolerance):  # type: ignore[no-untyped-def]
    """On, in front, beyond for a plane `gap` m behind the superpixel."""
    on = max(0.0, 1.0 - abs(gap) / tolerance) * agreement
    front = min(1.0, max(0.0, (gap - tolerance) / _SPAN_M))
    beyond = min(1.0, max(0.0, (-gap - tolerance) / _SPAN_M))
    return on, front, beyond


@njit(cache=True, nogil=True)
def _at(offset, agreement, tolerance, offsets, distances):  # type: ignore[no-untyped-def]
    result = np.zeros((len(offset), 5, 3))
    n = len(offsets)
    for f in range(5):
        position = curve_position(distances[f])
        absent = not position == position
        low = 0 if absent else min(int(position), n - 2)
        part = 0.0 if absent else position - low
        for k in range(len(offset)):
            if not offset[k, f] == offset[k, f]:
                continue
            if absent:
                result[k, f, 1] = 1.0
                continue
            first = _shares(offsets[low] - offset[k, f], agreement[k, f], tolerance[k])
            second = _shares(offsets[low + 1] - offset[k, f], agreement[k, f], tolerance[k])
            for r in range(3):
                result[k, f, r] = (1.0 - part) * first[r] + part * second[r]
    return result


@njit(cache=True, nogil=True)
def _curves(offset, agreement, tolerance, offsets, labels, area, weights):  # type: ignore[no-untyped-def]
    """A superpixel's cost changes only near it; before it is that of beyond, after it of in front, added as steps."""
    n = len(offsets)
    curves, steps, absent = np.zeros((5, n)), np.zeros((5, n + 1)), np.zeros(5)
    for k in range(len(offset)):
        f = labels[k]
        if f >= 5 or not offset[k, f] == offset[k, f]:
            continue
        near, far = area[k] * weights[f, 2], area[k] * weights[f, 1]
        absent[f] += far
        reach = tolerance[k] + _SPAN_M
        b = np.searchsorted(offsets, offset[k, f] - reach)
        steps[f, 0] += near
        steps[f, b] -= near
        while b < n and offsets[b] < offset[k, f] + reach:
            on, front, beyond = _shares(offsets[b] - offset[k, f], agreement[k, f], tolerance[k])
            curves[f, b] += area[k] * weights[f, 0] * on + far * front + near * beyond
            b += 1
        steps[f, b] += far
    for f in range(5):
        level = 0.0
        for b in range(n):
            level += steps[f, b]
            curves[f, b] += level
    return curves, absent
