"""Slow, obvious twin of core/depth_profiles.py: every cell against every offset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.depth_profiles import OFFSETS


def naive_profiles(
    points: NDArray[np.float64],
    agreement: NDArray[np.float64],
    structure: NDArray[np.float64],
    sigma: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Support and violation by their definition."""
    support, violation = np.zeros((5, len(OFFSETS))), np.zeros((5, len(OFFSETS)))
    outward = ((1, -1), (1, 1), (0, -1), (2, 1), (0, 1))
    for c in range(len(points)):
        if np.isnan(points[c, 2]):
            continue
        width = 2.0 * np.hypot(sigma[c], 0.03)
        for k, (axis, sign) in enumerate(outward):
            gap = (OFFSETS - sign * points[c, axis]) / width
            on = np.abs(gap) < 1.0
            support[k] += on * (1.0 - np.abs(gap)) * agreement[c, axis] * structure[c, k] / len(points)
            violation[k] += np.where(gap <= -1.0, 1.0, np.where(gap < 0.0, gap**2, 0.0)) / len(points)
    return support, violation
