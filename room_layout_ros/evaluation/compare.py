"""One frame, every method: its scores and a picture beside the truth. What a worker of `evaluate` does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.datasets import DataError, Sample
from room_layout_ros.datasets.images import encode_image

from . import pictures
from .floor_truth import called_free
from .prediction import Prediction
from .scores import FrameScore, Method, score_frame
from .stages import draw_stage, look_at
from .superpixel_table import Row, segmentation_of

_WARM: set[EstimatorMethod] = set()


@dataclass(frozen=True, slots=True)
class EstimatorMethod:
    """Our estimator as a method.

    `rgb_only` leaves the depth unused; `models` : folder of the learned models, None are the shipped ones.
    """

    config: EstimatorConfig
    rgb_only: bool = False
    models: Path | None = None

    def __call__(self, sample: Sample) -> Prediction:
        """Estimate the frame by itself, without memory of others.

        Raises
        ------
        DataError
            When it shall be estimated by colour alone and has none.
        """
        if self.rgb_only and sample.frame.color is None:
            raise DataError(f"frame {sample.name} has no colour, and an estimate by colour alone is asked for")
        frame = sample.frame.without_depth() if self.rgb_only else sample.frame
        estimate_frame = _make(self.config, self.models).estimate
        if self not in _WARM:  # the first call of a process compiles or loads the kernels: no time of a frame
            estimate_frame(frame)
            _WARM.add(self)
        start = perf_counter()
        estimate = estimate_frame(frame)
        milliseconds = 1e3 * (perf_counter() - start)
        return Prediction.of_estimate(estimate, milliseconds, self._free_floor(sample, estimate))

    def _free_floor(self, sample: Sample, estimate: RoomEstimate) -> NDArray[np.bool_] | None:
        """Return the cells called free where the sample knows the true ones and depth is used."""
        if self.rgb_only or sample.truth is None or sample.truth.floor_map is None:
            return None
        return called_free(free_space_of_frame(sample.frame, estimate, self.config), sample.truth.floor_map)


@dataclass(frozen=True, slots=True)
class CompareJob:
    """What to do with every frame.

    Attributes
    ----------
    methods : by title; the picture shows the first one. superpixels : their settings for Table 3, None leaves it out.
    picture : whether to draw.
    """

    methods: Mapping[str, Method]
    superpixels: EstimatorConfig | None = None
    picture: bool = True


@dataclass(frozen=True, slots=True)
class ComparedFrame:
    """Scores by method title, a JPEG (truth and first method side by side; or none), measures of superpixels."""

    name: str
    scores: Mapping[str, FrameScore]
    picture: bytes | None
    superpixels: Mapping[str, Row]


def compare(job: CompareJob, sample: Sample) -> ComparedFrame:
    """Apply every method to a sample and score it."""
    scores: dict[str, FrameScore] = {}
    first: Prediction | None = None
    for title, method in job.methods.items():
        start = perf_counter()
        prediction = method(sample)
        if prediction.milliseconds is None:
            prediction = replace(prediction, milliseconds=1e3 * (perf_counter() - start))
        first = first or prediction
        scores[title] = score_frame(sample, prediction)
    assert first is not None
    rows = segmentation_of(sample, job.superpixels) if job.superpixels else {}
    if not job.picture:
        return ComparedFrame(sample.name, scores, None, rows)
    leading = next(iter(job.methods.values()))
    evidence = _evidence(leading, sample) if isinstance(leading, EstimatorMethod) else []
    return ComparedFrame(sample.name, scores, _picture(sample, first, next(iter(scores.values())), evidence), rows)


def _evidence(method: EstimatorMethod, sample: Sample) -> list[tuple[str, pictures.Image]]:
    """Return the first columns of the paper's Figure 5: orientation map and geometric context."""
    frame = sample.frame.without_depth() if method.rgb_only else sample.frame
    look = look_at(frame, _make(method.config, method.models))
    drawn = [
        (name, draw_stage(stage, look)) for name, stage in (("orientation map", "orientation"), ("context", "context"))
    ]
    return [(name, image) for name, image in drawn if image is not None]


def _picture(
    sample: Sample, prediction: Prediction, score: FrameScore, evidence: list[tuple[str, pictures.Image]]
) -> bytes:
    truth = sample.truth
    assert truth is not None
    assert truth.layout is not None
    image = pictures.base_image(sample.frame)
    rename = np.array(score.pixels.wall_names, np.uint8)
    layout, labels = rename[prediction.layout], rename[prediction.labels]
    outlined = pictures.draw_outlines(image, truth.layout, pictures.TRUTH_COLOR)
    outlined = pictures.draw_outlines(outlined, layout, pictures.ESTIMATE_COLOR, 2)
    row = [("layout: truth red, ours blue", outlined), *evidence]
    if sample.frame.depth_m is not None:
        row.append(("depth", pictures.paint_depth(sample.frame.depth_m)))
    if truth.labels is not None:
        row.append(("true labels", pictures.paint_labels(image, truth.labels)))
    row.append(("our labels", pictures.paint_labels(image, labels)))
    if truth.furniture is not None and prediction.furniture is not None:
        row.append(("true furniture", pictures.paint_classes(image, truth.furniture)))
        row.append(("our furniture", pictures.paint_classes(image, prediction.furniture)))
    return encode_image(".jpg", pictures.tiles(row, 4, (280, 210)), jpeg_quality=82)


@lru_cache(maxsize=2)
def _make(config: EstimatorConfig, models: Path | None) -> LayoutEstimator:
    cv2.setNumThreads(1)
    return LayoutEstimator(config, models)
