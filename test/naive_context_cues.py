"""Slow twin of the reach of planes, a cue of the geometric context."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def plane_reach(
    points: NDArray[np.float32],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    plane: NDArray[np.float64],
    box: tuple[int, int, int, int],
) -> list[float]:
    """One row of `compute_plane_reach` by masks; box in cells: left, right, upper, lower."""
    seen = np.isfinite(points[..., 2])
    row, col = np.indices(seen.shape)
    off = points.astype(np.float64) @ plane[:3] - plane[3]
    tolerance = 0.10 + 0.005 * (points.astype(np.float64) ** 2).sum(axis=-1)
    beyond, on = seen & (off > tolerance), seen & (np.abs(off) <= tolerance)
    left, right, upper, lower = box
    in_rows, in_cols = (row >= upper) & (row <= lower), (col >= left) & (col <= right)
    around = (row >= upper - 6) & (row <= lower + 6) & (col >= left - 6) & (col <= right + 6)

    def share(where: NDArray[np.bool_]) -> float:
        return float(beyond[where].mean()) if where.any() else np.nan

    y = points[..., 1]
    top, bottom = beyond & (y < low[1] + 0.12), beyond & (y > high[1] - 0.12)
    return [
        float(beyond[seen].mean()),
        float((off < -tolerance)[seen].mean()),
        float(on[seen].mean()),
        float(y[on].min() - low[1]) if on.any() else np.nan,
        float(high[1] - y[on].max()) if on.any() else np.nan,
        share(seen & in_rows & ~in_cols),
        share(seen & in_cols & (row < upper)),
        share(seen & around & ~(in_rows & in_cols)),
        float(off[top].max()) if top.any() else 0.0,
        float(off[bottom].max()) if bottom.any() else 0.0,
    ]
