"""Make the pictures of the documentation from rendered rooms: python docs/images/make.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.picture import draw_overlay
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.images import write_image
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation import pictures
from room_layout_ros.evaluation.top_down import draw_top_down

HERE = Path(__file__).parent
SEED, FRAME = 4, 25


def main() -> None:
    """Write room.jpg: what the camera sees, its depth, the estimate, the same from above."""
    sample = list(good_samples(SyntheticSource(frames=FRAME + 1, seed=SEED)))[FRAME]
    frame = sample.frame
    estimate = LayoutEstimator().estimate(frame)
    assert frame.color is not None
    assert frame.depth_m is not None
    row = [
        ("what the camera sees", frame.color),
        ("its depth, with holes", pictures.paint_depth(frame.depth_m)),
        ("room and clutter, from this one frame", draw_overlay(frame, estimate)),
        ("the same from above, a square a metre", draw_top_down(frame, estimate)),
    ]
    image = pictures.tiles(row, 2, (480, 360))
    write_image(HERE / "room.jpg", np.ascontiguousarray(image), 88)


if __name__ == "__main__":
    main()
