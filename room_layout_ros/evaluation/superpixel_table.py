"""The paper's Table 3: superpixels by the weights of colour and depth gradient, against the semantic classes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.superpixels import compute_superpixels
from room_layout_ros.datasets import Sample

from .published import TABLE_3
from .segmentation import segmentation_scores

Row = tuple[float, float, float]
"""ME %, covering %, variation of information."""


def segmentation_of(sample: Sample, config: EstimatorConfig) -> dict[str, Row]:
    """Return the measures of one frame at our settings and at the paper's ratios of the weights.

    The weights here scale terms that are normalised by their noise, so the paper's (lambda_a, lambda_d) are
    taken as factors on ours: its "1, 1" is our default.
    """
    if sample.truth is None or sample.truth.labels40 is None or not sample.truth.labels40.any():
        return {}
    geometry = compute_depth_geometry(sample.frame, config)
    depth = None if geometry is None else geometry.inverse_depth
    rows: dict[str, Row] = {}
    for factor_color, factor_depth in TABLE_3:
        settings = replace(
            config,
            superpixel_lambda_color=min(100.0, config.superpixel_lambda_color * factor_color),
            superpixel_lambda_depth=min(100.0, config.superpixel_lambda_depth * factor_depth),
        )
        found = compute_superpixels(sample.frame.color, depth, settings)
        scores = segmentation_scores(found.index, sample.truth.labels40)
        rows[row_name(factor_color, factor_depth)] = (
            100 * scores.mean_error,
            100 * scores.covering,
            scores.variation_of_information,
        )
    return rows


def row_name(factor_color: float, factor_depth: float) -> str:
    """Return the key of a row."""
    return f"{factor_color:g}, {factor_depth:g}"


def mean_rows(frames: Iterable[Mapping[str, Row]]) -> dict[str, Row]:
    """Return the mean over the frames of each row."""
    frames = [rows for rows in frames if rows]
    if not frames:
        return {}
    means = {name: np.mean([rows[name] for rows in frames], axis=0) for name in frames[0]}
    return {name: (float(m[0]), float(m[1]), float(m[2])) for name, m in means.items()}
