"""A step in the floor from its pixels alone: where it is, how high, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.floor.floor_step import are_before, find_step

INTRINSICS = (262.5, 262.5, 159.5, 119.5)
HEIGHT_M = 1.0


def tilted(pitch: float) -> NDArray[np.float64]:
    """Unit vector down for a camera that looks down by so much, rad."""
    return np.array([0.0, np.cos(pitch), np.sin(pitch)])


def floor_pixels(
    edge_m: float = 2.0, rise_m: float = 0.0, pitch: float = 0.35, noise: float = 0.0, weight: float = 1.0
) -> NDArray[np.float32]:
    """Pixels of a floor that steps up by `rise_m` at `edge_m` ahead; `noise` of the inverse depth in 1/m."""
    down = tilted(pitch)
    ahead = np.array([0.0, -np.sin(pitch), np.cos(pitch)])
    v, u = np.mgrid[0:240:2, 0:320:2]
    fx, fy, cx, cy = INTRINSICS
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=-1)
    fall, run = rays @ down, rays @ ahead
    with np.errstate(divide="ignore"):
        near, far = HEIGHT_M / fall, (HEIGHT_M - rise_m) / fall
        riser = edge_m / run
    depth = np.where(run * near < edge_m, near, np.where(run * far > edge_m, far, riser))
    seen = (fall > 0.1) & (depth < 5.0)
    inverse = 1.0 / depth[seen] + noise * np.random.default_rng(3).standard_normal(int(seen.sum()))
    weights = np.where((depth == riser)[seen], 0.3, weight)  # the riser is labelled clutter
    return np.column_stack([u[seen], v[seen], inverse, weights]).astype(np.float32)


def plane_of(height_m: float = HEIGHT_M, pitch: float = 0.35) -> NDArray[np.float64]:
    return tilted(pitch) / height_m


@pytest.mark.parametrize("noise", [0.0, 0.003])
@pytest.mark.parametrize("rise_m", [-0.15, -0.1, -0.06, 0.06, 0.1, 0.15])
@pytest.mark.parametrize(("height_m", "turn"), [(1.0, 0.0), (1.05, 0.0), (0.96, 0.03), (1.03, -0.03)])
def test_a_step_is_found_over_a_plane_that_is_wrong(height_m: float, turn: float, rise_m: float, noise: float) -> None:
    pixels = floor_pixels(rise_m=rise_m, noise=noise)
    step = find_step(pixels, INTRINSICS, plane_of(height_m, 0.35 + turn))
    assert step is not None
    assert abs(step.rise_m - rise_m) < 0.02
    # The edge is at 2 m ahead and at 2.34 m in the corners; behind a drop nothing is seen for a while.
    assert 1.9 <= step.distance_m <= 2.35 + 2.0 * max(-rise_m, 0.0)
    assert abs(1.0 / np.linalg.norm(step.plane) - HEIGHT_M) < 0.015
    angle = np.arccos(np.clip(step.plane @ tilted(0.35) / np.linalg.norm(step.plane), -1.0, 1.0))
    assert np.rad2deg(angle) < 0.6
    before = are_before(pixels, INTRINSICS, step)
    assert 0.1 < before.mean() < 0.9


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01])
@pytest.mark.parametrize(("height_m", "turn"), [(1.0, 0.0), (1.1, 0.0), (1.0, 0.06), (0.95, -0.05)])
def test_a_flat_floor_has_none_whatever_the_plane(height_m: float, turn: float, noise: float) -> None:
    assert find_step(floor_pixels(noise=noise), INTRINSICS, plane_of(height_m, 0.35 + turn)) is None


def test_what_is_no_step() -> None:
    assert find_step(np.empty((0, 4), np.float32), INTRINSICS, plane_of()) is None
    assert find_step(floor_pixels(rise_m=0.02), INTRINSICS, plane_of()) is None  # a rug
    assert find_step(floor_pixels(rise_m=0.25), INTRINSICS, plane_of()) is None  # a table's top may be level too
    assert find_step(floor_pixels(rise_m=0.1, weight=0.3), INTRINSICS, plane_of()) is None  # not labelled floor
    assert find_step(floor_pixels(edge_m=4.5, rise_m=0.1), INTRINSICS, plane_of()) is None  # the foot of a wall


def test_a_bump_is_no_step() -> None:
    pixels = floor_pixels()
    r = np.sqrt(np.maximum((1.0 / pixels[:, 2]) ** 2, 1.0) - 1.0)
    raised = 0.05 * np.exp(-(((r - 2.0) / 0.3) ** 2))
    pixels[:, 2] *= (HEIGHT_M / (HEIGHT_M - raised)).astype(np.float32)
    assert find_step(pixels, INTRINSICS, plane_of()) is None


def test_a_camera_that_looks_straight_down_sees_none() -> None:
    pixels = floor_pixels(pitch=np.pi / 2, edge_m=0.3, rise_m=0.1)
    assert find_step(pixels, INTRINSICS, plane_of(pitch=np.pi / 2)) is None
