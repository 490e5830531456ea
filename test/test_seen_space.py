"""Floor is free only where enough of the space above it is in the picture, if that is asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnished import CONFIG, GREY, ahead_of, empty, free_space_of, with_truth

from room_layout_ros.datasets.synthetic import KINECT, NOISES, camera_pose, render
from room_layout_ros.datasets.synthetic.shapes import Solid

LEGS = tuple(Solid(x, y, 0.0, 0.06, 0.06, 0.0, 0.83, 5, GREY, thing=1) for x in (1.0, 1.6) for y in (-0.7, 0.7))
TABLE = (Solid(1.3, 0.0, 0.0, 0.7, 1.5, 0.83, 0.87, 5, GREY, thing=1), *LEGS)
POSE = camera_pose(-1.6, 0.0, 1.3, 0.0, -0.62)
"""Looks down by 36 degrees; the picture ends 0.81 m over the floor at the table's near edge, 0.67 m at its far one."""


@pytest.mark.parametrize("noise", ["clean", "kinect", "stereo"])
def test_below_a_table_whose_top_is_above_the_picture_nothing_is_free(noise: str) -> None:
    sample = render(empty(*TABLE), KINECT, POSE, NOISES[noise], np.random.default_rng(3))
    below = (2.7, 3.0)
    blind = free_space_of(sample.frame, with_truth(sample))
    assert (ahead_of(blind, below, 0.5) == 0).any()  # nothing in the picture tells of the top
    asked = free_space_of(sample.frame, with_truth(sample), replace(CONFIG, free_seen_height_m=0.8))
    assert (ahead_of(asked, below, 0.5) != 0).all()
    assert (ahead_of(asked, (1.2, 1.5), 0.3) == 0).mean() > 0.8
    np.testing.assert_array_equal(asked.grid[asked.grid != blind.grid], -1)


def test_a_level_camera_loses_only_what_leaves_its_sides() -> None:
    sample = render(empty(), KINECT, camera_pose(-1.6, 0.0, 1.3, 0.0, -0.1), NOISES["clean"], np.random.default_rng(3))
    plain = free_space_of(sample.frame, with_truth(sample)).grid
    asked = free_space_of(sample.frame, with_truth(sample), replace(CONFIG, free_seen_height_m=0.8)).grid
    lost = (plain == 0) & (asked != 0)
    assert 0 < lost.sum() < 0.2 * (plain == 0).sum()
    middle = slice(plain.shape[0] // 2 - 5, plain.shape[0] // 2 + 5)
    assert not lost[middle].any()
