"""The kernels of the scene network are convolutions, and the table of layers is the network it says it is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from itertools import count
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.models import load_scene_network
from room_layout_ros.core.network.convolution import filter_rows, multiply, pack_panels
from room_layout_ros.core.network.scene_layers import (
    COLUMNS,
    INPUT_HEIGHT,
    INPUT_WIDTH,
    N_SCORES,
    ROWS,
    STAGES,
    SceneLayers,
)
from room_layout_ros.core.network.vector_tiles import HALF_LANES, LANES

Image = NDArray[np.float64]
LOW, HIGH = np.float32(-np.inf), np.float32(np.inf)


def _convolved(image: Image, weight: NDArray[Any], bias: NDArray[Any], stride: int = 1) -> Image:
    """(H, W, C) image by a (k, k, C) filter per channel, zeros outside, more of them after than before."""
    size = len(weight)
    before = (size - stride) // 2
    padded = np.pad(image, ((before, size), (before, size), (0, 0)))
    rows, columns = image.shape[0] // stride, image.shape[1] // stride
    result = np.zeros((rows, columns, image.shape[2])) + bias
    for y in range(size):
        for x in range(size):
            seen = padded[y : y + stride * rows : stride, x : x + stride * columns : stride]
            result += seen * weight[y, x].astype(np.float64)
    return result


@pytest.mark.parametrize("channels", [HALF_LANES, LANES, LANES + HALF_LANES, 3 * LANES])
@pytest.mark.parametrize(("rows", "columns", "depth"), [(1, 8, 1), (3, 16, 5), (2, 8, 40)])
def test_a_product_is_the_matrix_product(
    rng: np.random.Generator, rows: int, columns: int, depth: int, channels: int
) -> None:
    """Held between the bounds, each row where the step says; between the rows nothing is touched."""
    source = rng.standard_normal((rows * columns, depth)).astype(np.float32)
    weight, bias = rng.standard_normal((depth, channels)).astype(np.float32), rng.standard_normal(channels)
    step = columns * channels + 5
    target = np.full(rows * step, 77.0, np.float32)
    panels = pack_panels(weight)
    multiply(
        source.ravel(), rows, columns, depth, panels, bias.astype(np.float32), channels, target, step,
        np.float32(-0.5), np.float32(1.5),
    )  # fmt: skip
    found = target.reshape(rows, step)
    expected = (source @ weight + bias).clip(-0.5, 1.5).reshape(rows, -1)
    np.testing.assert_allclose(found[:, : columns * channels], expected, atol=1e-5)
    assert (found[:, columns * channels :] == 77.0).all()


@pytest.mark.parametrize("channels", [HALF_LANES, LANES, 2 * LANES + HALF_LANES])
@pytest.mark.parametrize(("size", "stride"), [(3, 1), (3, 2), (5, 1), (5, 2)])
def test_a_filter_is_a_convolution_of_each_channel(
    rng: np.random.Generator, size: int, stride: int, channels: int
) -> None:
    """At every border too, and in bands of rows as in one piece."""
    image = rng.standard_normal((6, 8, channels))
    weight, bias = rng.standard_normal((size, size, channels)), rng.standard_normal(channels)
    before = (size - stride) // 2
    wide = np.pad(image, ((0, 0), (before, size - 1 - before), (0, 0))).astype(np.float32).ravel()
    expected = _convolved(image, weight, bias, stride)
    for start, stop in ((0, 6 // stride), (1, 3)):
        found = np.empty((stop - start, 8 // stride, channels), np.float32)
        filter_rows(
            wide, 6, 8, channels, size, stride, before, weight.astype(np.float32).ravel(), bias.astype(np.float32),
            start, stop, found.reshape(-1), LOW, HIGH,
        )  # fmt: skip
        np.testing.assert_allclose(found, expected[start:stop], atol=1e-4)


def test_the_layers_are_the_network(rng: np.random.Generator) -> None:
    """The same scores as the network written down a second time in plain NumPy."""
    arrays = load_scene_network().arrays
    layers = SceneLayers(arrays)
    color = rng.standard_normal((INPUT_HEIGHT, INPUT_WIDTH, 3)).astype(np.float32)
    scores = layers.run(color, layers.workspace())
    assert scores.shape == (N_SCORES, ROWS, COLUMNS)
    assert scores.std() > 0.5
    np.testing.assert_allclose(scores, _plain_network(arrays, color.astype(np.float64)), atol=2e-4)


def test_what_was_in_the_workspace_does_not_matter(rng: np.random.Generator) -> None:
    layers = SceneLayers(load_scene_network().arrays)
    color = rng.standard_normal((INPUT_HEIGHT, INPUT_WIDTH, 3)).astype(np.float32)
    clean, used = layers.workspace(), layers.workspace()
    for part in used:
        part[:] = np.nan
    np.testing.assert_array_equal(layers.run(color, clean), layers.run(color, used))


def test_tiles_are_the_same_in_plain_python() -> None:
    """With NUMBA_DISABLE_JIT=1 the tiles are NumPy: the tests of products and filters hold there too."""
    here = f"{__file__}::test_a_"
    chosen = [f"{here}{name}" for name in ("product_is_the_matrix_product", "filter_is_a_convolution_of_each_channel")]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *chosen],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]


# --- the network once more ---------------------------------------------------------------------------------


def _plain_network(arrays: Mapping[str, NDArray[Any]], color: Image) -> Image:
    def mixed(name: str, image: Image) -> Image:
        return image @ arrays[f"{name}.weight"].astype(np.float64) + arrays[f"{name}.bias"]

    def filtered(name: str, image: Image, stride: int = 1) -> Image:
        return _convolved(image, arrays[f"{name}.weight"], arrays[f"{name}.bias"], stride)

    def separable(name: str, image: Image) -> Image:
        return mixed(f"{name}.mix", filtered(f"{name}.filter", image)).clip(0.0)

    def enlarged(image: Image) -> Image:
        for axis in (0, 1):
            padded = np.concatenate([image.take([0], axis), image, image.take([-1], axis)], axis)
            size = image.shape[axis]
            before, here, after = (padded.take(range(k, k + size), axis) for k in (0, 1, 2))
            pairs = np.stack([0.25 * before + 0.75 * here, 0.75 * here + 0.25 * after], axis + 1)
            image = pairs.reshape([2 * n if k == axis else n for k, n in enumerate(image.shape)])
        return image

    patches = np.pad(color, ((0, 1), (0, 1), (0, 0)))
    under = [patches[y : y + INPUT_HEIGHT : 2, x : x + INPUT_WIDTH : 2] for y in range(3) for x in range(3)]
    image = mixed("stem", np.concatenate(under, axis=-1)).clip(0.0, 6.0)
    seen: dict[int, Image] = {}
    number = count()
    for repeats, _, stride, expansion, _, out in STAGES:
        for k in range(repeats):
            name, step = f"blocks.{next(number)}", stride if k == 0 else 1
            wide = mixed(f"{name}.expand", image).clip(0.0, 6.0) if expansion > 1 else image
            new = mixed(f"{name}.project", filtered(f"{name}.filter", wide, step).clip(0.0, 6.0))
            image = image + new if step == 1 and image.shape[2] == out else new
            seen[image.shape[1]] = image  # the last of each size
    deepest, *larger = (seen[width] for width in (8, 16, 32, 64))
    image = mixed("lateral.3", deepest) + arrays["position"] + mixed("whole", deepest.mean(axis=(0, 1)))
    image = separable("top.1", separable("top.0", image))
    for k, tap in enumerate(larger):
        image = separable(f"smooth.{k}", enlarged(image) + mixed(f"lateral.{2 - k}", tap))
    parts = mixed("labels", image), mixed("layout", separable("behind", image)), mixed("classes", image)
    return np.moveaxis(np.concatenate(parts, axis=-1), -1, 0)
