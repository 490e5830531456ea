"""The paper's Table 3: superpixels by the weights of colour and depth, against the true labels.

Depth has two terms here: the residual to a superpixel's plane, our default (`superpixel_lambda_depth`), and the paper's
own, the gradient (`superpixel_lambda_gradient`). Each has its rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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

TRUTHS = ("six labels", "40 classes")
"""Of the task, and of NYU v2; the paper says "the semantic labels provided with the dataset"."""


@dataclass(frozen=True, slots=True)
class Setting:
    """Factors on the weights of colour and of one depth term, "plane" or "gradient"; the other one is off."""

    factor_color: int
    factor_depth: int
    term: str

    @property
    def name(self) -> str:
        """What it varies, in words."""
        return f"colour × {self.factor_color}, {self.term} × {self.factor_depth}"

    def apply(self, config: EstimatorConfig) -> EstimatorConfig:
        """Return these settings with the weights times the factors; the gradient has the weight of the plane."""
        depth = min(100.0, config.superpixel_lambda_depth * self.factor_depth)
        return replace(
            config,
            superpixel_lambda_color=min(100.0, config.superpixel_lambda_color * self.factor_color),
            superpixel_lambda_depth=depth if self.term == "plane" else 0.0,
            superpixel_lambda_gradient=depth if self.term == "gradient" else 0.0,
        )


SETTINGS = tuple(
    Setting(color, depth, term)
    for term in ("plane", "gradient")
    for color, depth in TABLE_3
    if term == "plane" or depth
)
"""The paper's ratios of the weights with each depth term; that without depth once."""


def segmentation_of(sample: Sample, config: EstimatorConfig) -> dict[str, Row]:
    """Return the measures of one frame at every setting against every truth, by `row_name`.

    Unlabelled pixels are ignored. The weights here scale terms that are normalised by their noise, so the paper's
    (lambda_a, lambda_d) are taken as factors on ours: "colour × 1, plane × 1" is our default. A frame without labels
    has no measures.
    """
    labels = None if sample.truth is None else sample.truth.labels
    if sample.truth is None or labels is None or sample.truth.labels40 is None or not labels.any():
        return {}
    truths: dict[str, NDArray[np.uint8]] = dict(zip(TRUTHS, (labels, sample.truth.labels40), strict=True))
    geometry = compute_depth_geometry(sample.frame, config)
    depth = None if geometry is None else geometry.inverse_depth
    rows: dict[str, Row] = {}
    for setting in SETTINGS:
        found = compute_superpixels(sample.frame.color, depth, setting.apply(config))
        for name, truth in truths.items():
            scores = segmentation_scores(found.index, truth)
            rows[row_name(setting, name)] = scores.mean_error, scores.covering, scores.variation_of_information
    return rows


def row_name(setting: Setting, truth: str) -> str:
    """Return the key of a row."""
    return f"{truth}: {setting.name}"


def superpixel_figures(frames: Iterable[Mapping[str, Row]]) -> dict[str, dict[str, Figure]]:
    """Return the means over the frames of each row by measure, with their intervals; empty where no frame has any."""
    frames = [rows for rows in frames if rows]
    found: dict[str, dict[str, Figure]] = {}
    for name in frames[0] if frames else ():
        values = np.array([rows[name] for rows in frames])
        found[name] = {measure: mean_figure(values[:, k]) for k, measure in enumerate(MEASURES)}
    return found
