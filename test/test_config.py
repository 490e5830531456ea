"""The table of settings: every row is documented and bounded, every wrong value is refused in one sentence."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import pytest

from room_layout_ros.core.config import EstimatorConfig, Parameter, parameters

ROWS = list(parameters())
NUMBERS = [p for p in ROWS if isinstance(p.default, (int, float)) and not isinstance(p.default, bool)]
by_name = pytest.mark.parametrize("row", ROWS, ids=lambda p: p.name)


@by_name
def test_every_setting_says_what_it_means_and_its_default_is_allowed(row: Parameter) -> None:
    assert len(row.meaning) > 10
    assert row.check(row.default) == row.default


@pytest.mark.parametrize("row", NUMBERS, ids=lambda p: p.name)
def test_every_number_has_bounds_and_nothing_outside_is_accepted(row: Parameter) -> None:
    assert row.low is not None
    assert row.high is not None
    kind: Any = type(row.default)
    for edge in (row.low, row.high):
        EstimatorConfig(**{row.name: kind(edge)})
    outside: Any
    for outside in (kind(row.low - 1), kind(row.high + 1), float("nan"), float("inf")):
        with pytest.raises(ValueError, match=f"^{row.name} is "):
            EstimatorConfig(**{row.name: outside})


@by_name
def test_a_value_of_another_type_is_refused(row: Parameter) -> None:
    truth: Any = True
    other: Any = "five" if not isinstance(row.default, str) else 5
    kind = type(row.default).__name__
    with pytest.raises(ValueError, match=rf"^{row.name} is {other!r}; it must be of type {kind}$"):
        EstimatorConfig(**{row.name: other})
    if type(row.default) in (int, float):
        with pytest.raises(ValueError, match="must be of type"):
            EstimatorConfig(**{row.name: truth})  # a bool is an int to Python, not to us


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"min_depth_m": -0.1}, "min_depth_m is -0.1 m; allowed is 0.0 to 5.0"),
        ({"obstacle_min_area": 0.0}, "obstacle_min_area is 0.0; allowed is 0.001 to 1.0"),
        ({"method": "magic"}, "method is 'magic'; allowed are joint, depth"),
        ({"superpixel_count": 200.0}, "superpixel_count is 200.0; it must be of type int"),
        ({"use_color": 1}, "use_color is 1; it must be of type bool"),
    ],
)
def test_the_refusal_names_the_setting_the_value_and_what_is_allowed(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}$"):
        EstimatorConfig(**change)


def test_a_whole_number_does_for_a_real_one() -> None:
    config = EstimatorConfig(max_depth_m=8)
    assert config.max_depth_m == 8.0
    assert isinstance(config.max_depth_m, float)


def test_a_change_makes_a_new_value_and_is_checked_again() -> None:
    config = EstimatorConfig()
    assert dataclasses.replace(config, layout_rays=30).layout_rays == 30
    assert config == EstimatorConfig()
    with pytest.raises(ValueError, match="layout_rays is 1"):
        dataclasses.replace(config, layout_rays=1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.layout_rays = 30  # type: ignore[misc]


def test_the_nearest_depth_lies_before_the_farthest() -> None:
    """F33: a pair of settings that contradict each other."""
    with pytest.raises(ValueError, match=r"^min_depth_m is 5\.0 m and max_depth_m 1\.0 m; the first must be"):
        EstimatorConfig(min_depth_m=5.0, max_depth_m=1.0)


def test_the_lowest_obstacle_is_lower_than_the_robot() -> None:
    sentence = r"^obstacle_min_height_m is 0\.2 m; it must be below robot_height_m, which is 0\.2 m$"
    with pytest.raises(ValueError, match=sentence):
        EstimatorConfig(obstacle_min_height_m=0.2, robot_height_m=0.2)
    with pytest.raises(ValueError, match=r"^obstacle_min_height_m is 0\.5 m"):
        dataclasses.replace(EstimatorConfig(obstacle_min_height_m=0.5), robot_height_m=0.4)
    assert EstimatorConfig(obstacle_min_height_m=0.1, robot_height_m=0.2).robot_height_m == 0.2


def test_a_grid_that_would_take_seconds_and_gigabytes_is_refused() -> None:
    fine: dict[str, Any] = {"free_space_resolution_m": 0.01, "free_space_forward_m": 30.0}
    sentence = "free_space_resolution_m is 0.01 m for a grid of 30.0 m x 60.0 m: 18000000 cells; at most 4000000"
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}"):
        EstimatorConfig(**fine, free_space_side_m=30.0)
    assert EstimatorConfig(**fine, free_space_side_m=6.6).free_space_side_m == 6.6
    EstimatorConfig(free_space_resolution_m=0.03, free_space_forward_m=30.0, free_space_side_m=30.0)
