"""Superpixels of a colour + depth image: SLIC with a plane per superpixel (paper 3.1; docs/method.md, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .color import compute_lab
from .config import EstimatorConfig
from .superpixel_assignment import N_CENTER, X, Y, assign, candidates_of_tiles, first_row
from .superpixel_connectivity import connect, expand, moments_of_frame, regroup_edges
from .superpixel_merging import merge_superpixels
from .superpixel_planes import fit_planes, inverse_depth_gradient
from .superpixel_sums import accumulate, move_centers

_COARSE_PASSES = 2
"""Iterations that only have to move the centres, before the one that assigns each pixel."""

_COARSE_ROWS, _COARSE_SHARE = 8, 0.29
"""They look at every eighth row, or, of small cells, at some four rows of each (ME 4.0 % as with every fourth row)."""

_THIN_ROWS = 20.0
"""From this spacing of the superpixels (px) on, every second row stands for two: a third less time, 1 % more errors."""

_COLOR_SCALE = 10.0
"""Difference in Lab that weighs as much as the grid's spacing at superpixel_lambda_color = 1."""

_REACH = 1.6
"""A centre is compared with the tiles up to so many grid spacings away."""

_MIN_SHARE = 0.1
"""Pieces below this share of the grid's cell join the neighbour of the longest border."""

_GAP_PX = 1
"""Grain of noisy borders that is taken out of a row."""

_MERGE_DEPTH = 0.3
"""Weight of a plane's misfit beside that of colour, when superpixels are merged, at the default weights of both."""

_MERGE_POWER = 1.5
"""Of the area in the cost of merging: 1 is Ward's criterion, more keeps areas more even (ME 4.3 % at 1, 3.7 at 1.5)."""

_DEFAULT = EstimatorConfig()


@dataclass(frozen=True, slots=True)
class Superpixels:
    """A partition of the image into K connected superpixels.

    Attributes
    ----------
    index : (H, W) int32, 0..K-1, each id a 4-connected region.
    count : K.
    pixels : (K,) int32 area.
    center_px : (K, 2) float32 mean (x, y).
    mean_lab : (K, 3) float32 mean colour, L 0..100, a and b signed; 0 without colour.
    plane : (K, 3) float64 (a, b, c) of inverse depth w = a x + b y + c in 1/m, x and y in pixels of the whole
        image; NaN where too little was measured.
    plane_rms : (K,) float32 root mean square of the residual of its inliers in 1/m; NaN without plane.
    measured : (K,) float32 share of pixels with depth.
        (Colour, plane and share are those of every second row, where superpixels are large.)
    edges : (E, 2) int32 touching pairs i < j, ascending. edge_length : (E,) int32 length of the border in pixels.
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


def compute_superpixels(
    color: NDArray[np.uint8] | None, inverse_depth: NDArray[np.float32] | None, config: EstimatorConfig
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

    Raises
    ------
    ValueError
        When both images are None or their shapes or dtypes are not as stated.
    """
    images = _images(color, inverse_depth, config)
    height, width = images.size
    spacing = float(np.sqrt(height * width / (config.superpixel_oversegmentation * config.superpixel_count)))
    index = np.empty((-(-height // images.row_px), width), np.int32)
    coarse = max(1, min(_COARSE_ROWS, int(_COARSE_SHARE * spacing)) // images.row_px)
    grid = max(1, round(height / spacing)), max(1, round(width / spacing))
    centers = _seed(images, index, grid, coarse, config)
    for _ in range(_COARSE_PASSES):
        _assign(images, centers, index, coarse, spacing, config)
        _update(images, centers, index, coarse, config)
    _assign(images, centers, index, 1, spacing, config)
    min_pixels = max(1, int(_MIN_SHARE * spacing**2))
    pieces, edges, edge_length = connect(index, min_pixels, _GAP_PX, images.row_px, height)
    nobody = np.zeros((int(pieces.max()) + 1, N_CENTER), np.float32)
    sums = accumulate(*images.planes, nobody, pieces, 1, images.row_px, images.has[2], True)
    ids, sums = merge_superpixels(sums, edges, config.superpixel_count, *_merge_weights(config))
    moments = moments_of_frame(sums, pieces, ids, images.row_px, height)
    edges, edge_length = regroup_edges(edges, edge_length, ids, len(sums))
    plane, plane_rms = fit_planes(*images.planes, pieces, ids, sums, images.row_px, images.has[1])
    return Superpixels(
        index=expand(pieces, ids, images.row_px, height),
        count=len(sums),
        pixels=moments[:, 0].astype(np.int32),
        center_px=(moments[:, 1:] / moments[:, :1]).astype(np.float32),
        mean_lab=(sums[:, 3:6] / sums[:, :1]).astype(np.float32) * np.float32(color is not None),
        plane=plane,
        plane_rms=plane_rms,
        measured=(sums[:, 6] / sums[:, 0]).astype(np.float32),
        edges=edges,
        edge_length=edge_length,
    )


@dataclass(frozen=True, slots=True)
class _Images:
    """The frame in planes, as the kernels read it, and which of them there are; absent ones are 0."""

    size: tuple[int, int]
    row_px: int
    """Every how many-th row of the frame is in the planes."""
    planes: tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]]
    """(3, rows, W) Lab, (rows, W) inverse depth, (2, rows, W) its gradient."""
    has: tuple[bool, bool, bool]


def _images(
    color: NDArray[np.uint8] | None, inverse_depth: NDArray[np.float32] | None, config: EstimatorConfig
) -> _Images:
    size = _checked_size(color, inverse_depth)
    row_px = 2 if size[0] * size[1] >= _THIN_ROWS**2 * config.superpixel_count else 1
    shape = -(-size[0] // row_px), size[1]
    lab = np.zeros((3, *shape), np.uint8) if color is None else compute_lab(np.ascontiguousarray(color), row_px)
    w, gradient = np.zeros(shape, np.float32), np.zeros((2, 1, 1), np.float32)
    by_gradient = inverse_depth is not None and config.superpixel_lambda_gradient > 0
    if inverse_depth is not None:
        w = np.ascontiguousarray(inverse_depth[::row_px])
        if by_gradient:
            gradient = np.ascontiguousarray(inverse_depth_gradient(inverse_depth)[:, ::row_px])
    return _Images(size, row_px, (lab, w, gradient), (color is not None, inverse_depth is not None, by_gradient))


def _checked_size(color: NDArray[np.uint8] | None, inverse_depth: NDArray[np.float32] | None) -> tuple[int, int]:
    if color is None and inverse_depth is None:
        raise ValueError("neither colour nor inverse depth is given; superpixels need at least one")
    if color is not None and (color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8):
        raise ValueError(f"colour image is {color.dtype} {color.shape}; it must be uint8 (H, W, 3)")
    if inverse_depth is not None and (inverse_depth.ndim != 2 or inverse_depth.dtype != np.float32):
        raise ValueError(f"inverse depth is {inverse_depth.dtype} {inverse_depth.shape}; it must be float32 (H, W)")
    if color is not None and inverse_depth is not None and color.shape[:2] != inverse_depth.shape:
        raise ValueError(f"colour image is {color.shape[:2]} and inverse depth {inverse_depth.shape}; they must agree")
    image = color if color is not None else inverse_depth
    assert image is not None
    return image.shape[0], image.shape[1]


def _seed(
    images: _Images, index: NDArray[np.int32], grid: tuple[int, int], step: int, config: EstimatorConfig
) -> NDArray[np.float32]:
    """Return centres on a regular grid, with the means and planes of their cells."""
    height, width = images.size
    down, across = grid
    row = np.arange(len(index), dtype=np.int32) * down // len(index)
    column = np.arange(width, dtype=np.int32) * across // width
    seen = slice(first_row(step, len(index)), None, step)
    np.add(row[seen, None] * across, column, out=index[seen])
    centers = np.zeros((down * across, N_CENTER), np.float32)
    centers[:, X] = (np.tile(np.arange(across), down) + 0.5) * width / across
    centers[:, Y] = (np.repeat(np.arange(down), across) + 0.5) * height / down
    _update(images, centers, index, step, config)
    return centers


def _assign(
    images: _Images,
    centers: NDArray[np.float32],
    index: NDArray[np.int32],
    step: int,
    spacing: float,
    config: EstimatorConfig,
) -> None:
    """Assign the pixels of every `step`-th row to their centres."""
    lists, count = candidates_of_tiles(centers, _REACH * spacing, len(index), index.shape[1], step, images.row_px)
    has_color, has_depth, has_gradient = images.has
    weights = (
        1.0 / spacing**2,
        config.superpixel_lambda_color / _COLOR_SCALE**2 if has_color else 0.0,
        1.0 if has_depth and config.superpixel_lambda_depth > 0 else 0.0,
        config.superpixel_lambda_gradient / config.superpixel_noise_gradient**2 if has_gradient else 0.0,
    )
    assign(*images.planes, centers, lists, count, step, images.row_px, weights, index)


def _update(
    images: _Images, centers: NDArray[np.float32], index: NDArray[np.int32], step: int, config: EstimatorConfig
) -> None:
    noise = (config.superpixel_noise_inverse_depth, config.superpixel_noise_depth_m)
    sums = accumulate(*images.planes, centers, index, step, images.row_px, images.has[2], True)
    move_centers(sums, centers, *noise, config.superpixel_lambda_depth, config.superpixel_depth_cap)


def _merge_weights(config: EstimatorConfig) -> tuple[float, float, float, float, float]:
    """Colour and depth weigh as in the assignment, relative to the defaults: 0 leaves an image out here too."""
    color = config.superpixel_lambda_color / _DEFAULT.superpixel_lambda_color
    depth = max(config.superpixel_lambda_depth, config.superpixel_lambda_gradient) / _DEFAULT.superpixel_lambda_depth
    noise = (config.superpixel_noise_inverse_depth, config.superpixel_noise_depth_m)
    return (color / _COLOR_SCALE**2, _MERGE_DEPTH * depth, *noise, _MERGE_POWER)
