"""Whether a plane is the floor or runs through things: clutter that crosses a wrong start makes a plane, too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..depth import NOISE_FLOOR_M, NOISE_QUADRATIC, DepthGeometry, depth_sigma
from ..labels import CLUTTER, FLOOR

_ON_M, _ON_RAD = 0.05, np.deg2rad(1.5)
"""What is measured no farther than this from a plane, and than this angle seen from the camera, lies on it."""

LEAST_PIXELS, STRIDE = 500, 4
"""Fewer pixels tell nothing; one in so many rows and columns is looked at."""

_LEAST_ON_PLANE = 0.25
"""Of what is labelled floor so much, at least, lies on a plane that is the floor (with steps it may be little); of one
through things next to nothing does."""

_HALF_WIDTH_M, _PEAK_WIDTHS, _PEAK_SHARE, _LEAST_PEAK = 0.03, 4.0, 0.75, 0.05
"""What lies on a plane is as thin as its noise; what crosses it is spread. So of what is within so many half widths of
it (the first, and noise) the share after that lies within one, and fills the last of the picture."""


def holds_floor(
    normal: NDArray[np.float64], distance_m: float, geometry: DepthGeometry, labels: NDArray[np.uint8]
) -> bool:
    """Whether what is labelled floor lies on a plane, or all that is near it.

    The second before stairs down, where the label of floor goes to the lower level.

    Parameters
    ----------
    normal : (3,) float64 unit vector down, camera frame. distance_m : height of the camera over the plane.
    labels : (H, W) uint8 of the estimate.
    """
    floor = labelled_points(geometry, labels, FLOOR)
    if len(floor) * STRIDE**2 < LEAST_PIXELS:
        return True
    if np.mean(lies_on(distance_m - floor @ normal, floor[:, 2])) >= _LEAST_ON_PLANE:
        return True
    both = np.concatenate([floor, labelled_points(geometry, labels, CLUTTER)])
    return _is_peak(np.abs(distance_m - both @ normal), both[:, 2], distance_m, labels.size // STRIDE**2)


def labelled_points(geometry: DepthGeometry, labels: NDArray[np.uint8], label: int) -> NDArray[np.float64]:
    """Return (n, 3) measured points of one label, camera frame, m: of one in `STRIDE` rows and columns."""
    points = geometry.points(STRIDE)[labels[::STRIDE, ::STRIDE] == label].astype(np.float64)
    return points[np.isfinite(points[:, 2])]


def _is_peak(off_m: NDArray[np.float64], depth_m: NDArray[np.float64], camera_height_m: float, pixels: int) -> bool:
    """Whether what is so far off a plane, at a depth, lies on it rather than crosses it; of so many pixels in all."""
    noise_m = 2.0 * depth_sigma(depth_m, NOISE_FLOOR_M, NOISE_QUADRATIC) * camera_height_m / depth_m
    half_width_m = _HALF_WIDTH_M + noise_m
    on, near = np.count_nonzero(off_m < half_width_m), np.count_nonzero(off_m < _PEAK_WIDTHS * half_width_m)
    return bool(on >= _LEAST_PEAK * pixels and on >= _PEAK_SHARE * near)


def lies_on(off_m: NDArray[np.float64], depth_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether what is measured so far off a plane, at a depth, may be of it."""
    return np.asarray(np.abs(off_m) < _ON_M + np.tan(_ON_RAD) * depth_m)
