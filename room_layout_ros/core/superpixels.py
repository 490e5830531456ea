"""Superpixels of a colour + depth image: SLIC with a plane per superpixel (paper 3.1; docs/method.md, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .color import compute_lab
from .config import EstimatorConfig
from .superpixel_assignment import (
    N_CENTER,
    N_SUMS,
    X,
    Y,
    accumulate,
    assign,
    candidates_of_tiles,
    move_centers,
    tile_image,
)
from .superpixel_connectivity import adjacency, connect
from .superpixel_planes import describe, inverse_depth_gradient

_ROW_STEPS = (4, 4, 2, 1)
"""Rows looked at per iteration: the first ones only have to move the centres (4.3 ms against 7)."""

_ROW_STEPS_WARM = (4, 1)
_COLOR_SCALE = 10.0
"""Difference in Lab that weighs as much as the grid's spacing at superpixel_lambda_color = 1."""

_REACH = 2.0
"""A centre is compared with the pixels up to so many grid spacings away."""

_MIN_SHARE = 0.1
"""Pieces below this share of the mean area join a neighbour."""


@dataclass(frozen=True, slots=True)
class Superpixels:
    """A partition of the image into K connected superpixels.

    Attributes
    ----------
    index : (H, W) int32, 0..K-1, each id a 4-connected region.
    count : K.
    pixels : (K,) int32 area.
    center_px : (K, 2) float32 mean (x, y).
    mean_lab : (K, 3) float32 mean colour, L 0..100, a and b about 128; 0 without colour.
    plane : (K, 3) float64 (a, b, c) of inverse depth w = a x + b y + c in 1/m, x and y in pixels of the whole
        image; NaN where too little was measured.
    plane_rms : (K,) float32 root mean square of the residual of its inliers in 1/m; NaN without plane.
    measured : (K,) float32 share of pixels with depth.
    edges : (E, 2) int32 touching pairs i < j, ascending. edge_length : (E,) int32 length of the border in pixels.
    centers : (K', 12) float32 state of the clustering, to start the next frame of a video from.
    """

    index: NDArray[np.int32]
    count: int
    pixels: NDArray[np.int32]
    center_px: NDArray[np.float32]
    mean_lab: NDArray[np.float32]
    plane: NDArray[np.float64]
    plane_rms: NDArray[np.float32]
    measured: NDArray[np.float32]
    edges: NDArray[np.int32]
    edge_length: NDArray[np.int32]
    centers: NDArray[np.float32]


def compute_superpixels(
    color: NDArray[np.uint8] | None,
    inverse_depth: NDArray[np.float32] | None,
    config: EstimatorConfig,
    start: Superpixels | None = None,
) -> Superpixels:
    """Segment an image into superpixels that are compact, of one colour and of one plane.

    Parameters
    ----------
    color : (H, W, 3) uint8 array or None
        RGB.
    inverse_depth : (H, W) float32 array or None
        1/Z in 1/m; 0 where not measured.
    config : EstimatorConfig
        The fields `superpixel_*`.
    start : Superpixels, optional
        Of the frame before (same size and settings): a warm start, with fewer iterations.

    Raises
    ------
    ValueError
        When both images are None or their shapes or dtypes are not as stated.
    """
    height, width = _checked_size(color, inverse_depth)
    tiles = _tiles(color, inverse_depth, config, height, width)
    spacing = float(np.sqrt(height * width / config.superpixel_count))
    index = np.zeros((height, width), np.int32)
    if start is None or start.index.shape != index.shape:
        centers = _seed(tiles, index, spacing, config)
        steps = _ROW_STEPS
    else:
        centers = start.centers.copy()
        steps = _ROW_STEPS_WARM
    for step in steps:
        _iterate(tiles, centers, index, step, spacing, color is not None, config)
    connected, count = connect(index, max(1, int(_MIN_SHARE * spacing**2)))
    edges, edge_length = adjacency(connected)
    pixels, center_px, mean_lab, plane, plane_rms, measured = describe(tiles, connected, count)
    return Superpixels(
        connected, count, pixels, center_px, mean_lab, plane, plane_rms, measured, edges, edge_length, centers
    )


def _checked_size(color: NDArray[np.uint8] | None, inverse_depth: NDArray[np.float32] | None) -> tuple[int, int]:
    if color is None and inverse_depth is None:
        raise ValueError("neither colour nor inverse depth is given; superpixels need at least one")
    if color is not None and (color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8):
        raise ValueError(f"colour image is {color.dtype} {color.shape}; it must be uint8 (H, W, 3)")
    if inverse_depth is not None and (inverse_depth.ndim != 2 or inverse_depth.dtype != np.float32):
        raise ValueError(
            f"inverse depth is {inverse_depth.dtype} {inverse_depth.shape}; it must be float32 (H, W)"
        )
    if color is not None and inverse_depth is not None and color.shape[:2] != inverse_depth.shape:
        raise ValueError(f"colour image is {color.shape[:2]} and inverse depth {inverse_depth.shape}; they must agree")
    image = color if color is not None else inverse_depth
    assert image is not None
    return image.shape[0], image.shape[1]


def _tiles(
    color: NDArray[np.uint8] | None,
    inverse_depth: NDArray[np.float32] | None,
    config: EstimatorConfig,
    height: int,
    width: int,
) -> NDArray[np.float32]:
    """Return the image cut in tiles; what is switched off by a weight of 0 is left out."""
    lab = np.zeros((1, 1, 3), np.uint8) if color is None else compute_lab(np.ascontiguousarray(color))
    has_depth = inverse_depth is not None
    w = np.zeros((1, 1), np.float32) if inverse_depth is None else np.ascontiguousarray(inverse_depth)
    by_gradient = has_depth and config.superpixel_lambda_gradient > 0
    gradient = inverse_depth_gradient(w) if by_gradient else np.zeros((1, 1, 2), np.float32)
    tiles: NDArray[np.float32] = tile_image(
        lab, w, gradient, color is not None, has_depth, by_gradient, height, width
    )
    return tiles


def _seed(
    tiles: NDArray[np.float32], index: NDArray[np.int32], spacing: float, config: EstimatorConfig
) -> NDArray[np.float32]:
    """Return centres on a regular grid, with the means and planes of their cells."""
    height, width = index.shape
    down, across = max(1, round(height / spacing)), max(1, round(width / spacing))
    row = np.arange(height, dtype=np.int32) * down // height
    column = np.arange(width, dtype=np.int32) * across // width
    index[...] = row[:, None] * across + column
    centers = np.zeros((down * across, N_CENTER), np.float32)
    centers[:, X] = (np.tile(np.arange(across), down) + 0.5) * width / across
    centers[:, Y] = (np.repeat(np.arange(down), across) + 0.5) * height / down
    _update(tiles, centers, index, 4, 2, config)
    return centers


def _iterate(
    tiles: NDArray[np.float32],
    centers: NDArray[np.float32],
    index: NDArray[np.int32],
    step: int,
    spacing: float,
    has_color: bool,
    config: EstimatorConfig,
) -> None:
    lists, count = candidates_of_tiles(centers, _REACH * spacing, tiles.shape[0], tiles.shape[1])
    color = config.superpixel_lambda_color / _COLOR_SCALE**2 if has_color else 0.0
    gradient = config.superpixel_lambda_gradient / config.superpixel_noise_gradient**2
    phase = step // 2
    depth = config.superpixel_lambda_depth > 0
    assign(tiles, centers, lists, count, step, phase, 1.0 / spacing**2, color, gradient, depth, index)
    if step > 1:
        _update(tiles, centers, index, step, phase, config)


def _update(
    tiles: NDArray[np.float32],
    centers: NDArray[np.float32],
    index: NDArray[np.int32],
    step: int,
    phase: int,
    config: EstimatorConfig,
) -> None:
    sums = np.zeros((len(centers), N_SUMS))
    accumulate(tiles, centers, step, phase, index, sums)
    move_centers(
        sums,
        centers,
        config.superpixel_noise_inverse_depth,
        config.superpixel_noise_depth_m,
        config.superpixel_lambda_depth,
        config.superpixel_depth_cap,
    )
