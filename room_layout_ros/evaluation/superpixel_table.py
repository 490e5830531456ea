"""The paper's Table 3: superpixels by the weights of colour and depth gradient, against the true labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.superpixels import compute_superpixels
from room_layout_ros.datasets import Sample

from .published import TABLE_3
from .scores import Figure, mean_figure
from .segmentation import segmentation_scores

Row = tuple[float, float, float]
"""Mean error, covering (shares, 0..1) and variation of information in nats, as `MEASURES`."""

MEASURES = ("mean_error", "covering", "variation_of_information")


def segmentation_of(sample: Sample, config: EstimatorConfig) -> dict[str, Row]:
    """Return the measures of one frame at our settings and at the paper's ratios of the weights.

    The truth is the six labels of the task, unlabelled pixels are ignored. The weights here scale terms that are
    normalised by their noise, so the paper's (lambda_a, lambda_d) are taken as factors on ours: its "1, 1" is our
    default. A frame without labels has no measures.
    """
    truth = None if sample.truth is None else sample.truth.labels
    if truth is None or not truth.any():
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
        scores = segmentation_scores(found.index, truth)
        rows[row_name(factor_color, factor_depth)] = (
            scores.mean_error,
            scores.covering,
            scores.variation_of_information,
        )
    return rows


def row_name(factor_color: float, factor_depth: float) -> str:
    """Return the key of a row."""
    return f"{factor_color:g}, {factor_depth:g}"


def superpixel_figures(frames: Iterable[Mapping[str, Row]]) -> dict[str, dict[str, Figure]]:
    """Return the means over the frames of each row by measure, with their intervals; empty where no frame has any."""
    frames = [rows for rows in frames if rows]
    found: dict[str, dict[str, Figure]] = {}
    for name in frames[0] if frames else ():
        values = np.array([rows[name] for rows in frames])
        found[name] = {measure: mean_figure(values[:, k]) for k, measure in enumerate(MEASURES)}
    return found
