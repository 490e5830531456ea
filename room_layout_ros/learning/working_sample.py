"""Labelled frames at the size at which the estimator works on them: what is learned is what it will see."""

from __future__ import annotations

from dataclasses import replace

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.working_size import resize_frame, resize_labels
from room_layout_ros.datasets.sample import FrameTruth, Sample


def at_working_size(sample: Sample, config: EstimatorConfig) -> Sample:
    """Return the sample with frame, layout and classes at `config.working_size_px`; itself where it has that size.

    Of the truth only these and the room are kept where the size changes.
    """
    frame, camera, truth = resize_frame(sample.frame, config.working_size_px), sample.frame.camera, sample.truth
    if frame is sample.frame or truth is None:
        return replace(sample, frame=frame)
    layout, labels40 = (
        None if image is None else resize_labels(image, camera, config.working_size_px)
        for image in (truth.layout, truth.labels40)
    )
    return replace(sample, frame=frame, truth=FrameTruth(layout=layout, labels40=labels40, cuboid=truth.cuboid))
