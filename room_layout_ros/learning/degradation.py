"""Depth as other cameras would have measured it: training frames with noise, holes and other steps."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_SMOOTH_SHARE = 0.6
_HOLE_SHARES = (0.0, 0.05, 0.15, 0.35)
_FAR_LIMITS_M = (4.0, 6.0, 8.0, 20.0)
_EDGE_PER_M = 0.15


def degrade_depth(depth_m: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return the depth as a random other sensor might have seen it.

    The data set's own steps (39 mm) are smoothed away in 60 % of the cases; then comes noise (Kinect-like and
    white, smooth as of stereo, or smooth and quantised in disparity), holes in blobs, at jumps of depth, and
    beyond a range.

    Parameters
    ----------
    depth_m : (H, W) float32, NaN where not measured.
    rng : numpy.random.Generator

    Returns
    -------
    (H, W) float32
        NaN where not measured.
    """
    measured = np.isfinite(depth_m) & (depth_m > 0)
    inverse = np.where(measured, 1.0 / np.where(measured, depth_m, 1.0), 0.0).astype(np.float32)
    edges = np.abs(cv2.Sobel(inverse, cv2.CV_32F, 1, 0)) > _EDGE_PER_M
    if rng.random() < _SMOOTH_SHARE:
        inverse = np.asarray(cv2.bilateralFilter(inverse, 9, 0.02, 4), np.float32)
    depth = 1.0 / np.maximum(inverse, 1e-3)
    depth = _add_noise(depth, rng)
    lost = _holes(depth.shape, rng) | (cv2.dilate(edges.astype(np.uint8), np.ones((3, 5), np.uint8)) > 0)
    lost |= depth > rng.choice(_FAR_LIMITS_M)
    depth[lost | ~measured] = np.nan
    return depth.astype(np.float32)


def _add_noise(depth: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.float64]:
    kind = rng.integers(3)
    if kind == 0:
        sigma = (0.002 + 0.0014 * depth**2) * rng.uniform(0.5, 1.5)
        return np.asarray(depth + sigma * rng.standard_normal(depth.shape))
    sigma = 0.002 * depth**2 * rng.uniform(0.5, 2.0)
    noise = cv2.GaussianBlur(rng.standard_normal(depth.shape).astype(np.float32), (0, 0), 3)
    noisy = depth + sigma * noise / noise.std()
    if kind == 1:
        return np.asarray(noisy, np.float64)
    step = 1.0 / (8.0 * rng.uniform(350.0, 700.0))
    return np.asarray(1.0 / (np.round(1.0 / np.maximum(noisy, 0.1) / step) * step + 1e-6), np.float64)


def _holes(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.bool_]:
    share = rng.choice(_HOLE_SHARES)
    height, width = shape
    field = rng.standard_normal((max(height // 4, 1), max(width // 4, 1))).astype(np.float32)
    blobs = cv2.resize(cv2.GaussianBlur(field, (0, 0), rng.uniform(3.0, 12.0)), (width, height))
    return np.asarray(blobs > np.quantile(blobs, 1.0 - share)) if share > 0 else np.zeros(shape, bool)
