"""What the outputs make of a scene: one unit per topic, and only what the scene has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, empty, with_truth

from room_layout_ros.datasets.synthetic import CLEAN, KINECT, camera_pose, render
from room_layout_ros.node_config import NodeConfig
from room_layout_ros.outputs import OUTPUTS
from room_layout_ros.scene import Scene


@pytest.mark.parametrize(
    ("metric", "use_depth", "sent"), [(True, True, True), (False, False, True), (False, True, False)]
)
def test_a_topic_in_metres_stays_in_metres(metric: bool, use_depth: bool, sent: bool) -> None:
    """A frame whose depth came empty is estimated from colour: its room has no metres, and its listeners want them."""
    sample = render(empty(), KINECT, camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35), CLEAN)
    depth = sample.frame.depth_m if metric else np.zeros((480, 640), np.float32)
    frame = replace(sample.frame, depth_m=depth)
    estimate = with_truth(sample)
    assert estimate.cuboid is not None
    estimate = replace(estimate, metric=metric, polygons=estimate.cuboid.polygons(KINECT))
    scene = Scene(frame, estimate, NodeConfig(), replace(CONFIG, use_depth=use_depth))
    encode = {output.topic: output.encode for output in OUTPUTS}
    assert bool(encode["~/polygons"](scene)) == sent
    assert bool(encode["~/markers"](scene)) == sent
    assert encode["~/labels"](scene)
    assert bool(encode["~/scan"](scene)) == metric


def test_the_scans_reach_holds_its_ranges() -> None:
    """A wall of the cuboid may be farther than depth is taken."""
    sample = render(empty(), KINECT, camera_pose(-1.4, 0.0, 1.2, 0.0, -0.35), CLEAN)
    scene = Scene(sample.frame, with_truth(sample), NodeConfig(), replace(CONFIG, max_depth_m=2.5))
    (scan,) = next(output.encode for output in OUTPUTS if output.topic == "~/scan")(scene)
    ranges = np.asarray(scan.ranges)
    assert ranges[np.isfinite(ranges)].max() > 2.5
    assert scan.range_max >= ranges[np.isfinite(ranges)].max()
