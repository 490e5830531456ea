"""The slow obvious twins of resized depth: block by block, pixel by pixel."""

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
            from_middle = np.roll(block, -(step // 2 * step + step // 2))
            measured = from_middle[np.isfinite(from_middle) & (from_middle > 0.0)]
            if measured.size:
                near = 3.0 * (0.01 + 0.0019 * measured[0] ** 2)
                reduced[i, j] = measured[np.abs(measured - measured[0]) <= near].mean()
    return reduced


def naive_enlarged_depth(depth_m: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    """(H step, W step) float32: between the four nearest pixels where they are of one surface, else the nearest."""
    height, width = depth_m.shape
    enlarged = np.empty((height * step, width * step), np.float32)
    for y, x in np.ndindex(enlarged.shape):
        v = np.clip((y + 0.5) / step - 0.5, 0, height - 1)
        u = np.clip((x + 0.5) / step - 0.5, 0, width - 1)
        i, j = min(int(v), height - 2), min(int(u), width - 2)
        four = depth_m[i : i + 2, j : j + 2].astype(np.float64)
        enlarged[y, x] = depth_m[y // step, x // step]
        if (four > 0).all() and np.isfinite(four).all() and four.min() >= 0.93 * four.max():
            rows = np.array([1 - (v - i), v - i])
            enlarged[y, x] = 1.0 / (rows @ (1.0 / four) @ np.array([1 - (u - j), u - j]))
    return enlarged
