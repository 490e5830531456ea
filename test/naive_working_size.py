"""The slow obvious twin of the reduction of depth: block by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def naive_reduced_depth(depth_m: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    """(H // step, W // step) float32: mean of what is within three standard deviations of the middle of a block.

    Where the middle was not measured, of the pixels after it in reading order, around to the first, the first that was.
    """
    rows, cols = depth_m.shape[0] // step, depth_m.shape[1] // step
    reduced = np.full((rows, cols), np.nan, np.float32)
    for i in range(rows):
        for j in range(cols):
            block = depth_m[i * step : (i + 1) * step, j * step : (j + 1) * step].ravel().astype(np.float64)
            from_middle = np.roll(block, -(step * step // 2))
            measured = from_middle[np.isfinite(from_middle) & (from_middle > 0.0)]
            if measured.size:
                near = 3.0 * (0.01 + 0.0019 * measured[0] ** 2)
                reduced[i, j] = measured[np.abs(measured - measured[0]) <= near].mean()
    return reduced
