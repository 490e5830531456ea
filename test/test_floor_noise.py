"""The noise of the floor's height, measured from counts of heights."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.floor.floor_noise import sigma_bands
from room_layout_ros.core.floor.height_bins import BAND_M, BIN_M, BINS

HEIGHT_M, BANDS = 1.3, 24


def counts_of(heights: list[NDArray[np.float64]]) -> NDArray[np.int64]:
    """(2, bands, bins) heights below and above the floor, of the first bands."""
    counts = np.zeros((2, BANDS, BINS), np.int64)
    for band, h in enumerate(heights):
        bins = (np.abs(h) / BIN_M).astype(int)
        for side, here in enumerate((h <= 0, h > 0)):
            counts[side, band] = np.bincount(bins[here & (bins < BINS)], minlength=BINS)
    return counts


@pytest.mark.parametrize("sigma_m", [0.004, 0.010, 0.025])
def test_normal_noise_is_measured(sigma_m: float) -> None:
    rng = np.random.default_rng(0)
    sigma = sigma_bands(counts_of([rng.normal(0.0, sigma_m, 4000) for _ in range(6)]), HEIGHT_M)
    np.testing.assert_allclose(sigma[:6], sigma_m, rtol=0.12)


@pytest.mark.parametrize("on_floor", [0.4, 0.5, 0.6, 0.7])
def test_steps_of_the_depth_are_noise_though_half_of_the_pixels_lie_on_the_floor(on_floor: float) -> None:
    """A stereo camera's disparity comes in steps: heights of -17, 0 and 17 mm and nothing between."""
    rng = np.random.default_rng(0)
    steps = rng.choice([-1, 0, 1], size=2000, p=[(1 - on_floor) / 2, on_floor, (1 - on_floor) / 2])
    h = 0.017 * steps + rng.normal(0.0, 0.0008, 2000)
    sigma = sigma_bands(counts_of([h]), HEIGHT_M)[0]
    assert 0.009 < sigma < 0.03, "as far as the outer steps lie, about"


def test_things_on_the_floor_are_no_noise() -> None:
    """A third of the pixels of a band lies on things: their side does not count."""
    rng = np.random.default_rng(0)
    h = np.concatenate([rng.normal(0.0, 0.005, 2000), rng.uniform(0.02, 0.1, 1000)])
    assert sigma_bands(counts_of([h]), HEIGHT_M)[0] == pytest.approx(0.005, rel=0.15)


def test_a_band_without_floor_follows_the_others() -> None:
    rng = np.random.default_rng(0)
    h = rng.normal(0.0, 0.004, 3000)
    sigma = sigma_bands(counts_of([h, h, h, np.abs(h) + 0.03]), HEIGHT_M)
    assert np.isfinite(sigma).all()
    assert sigma[3] < 0.02
    assert BAND_M == 0.5
