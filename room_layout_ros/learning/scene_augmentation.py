"""Random views of the scene network's examples: other crops, tilts, mirrored rooms, other light."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.labels import LEFT_WALL, RIGHT_WALL
from ..core.network.scene_layers import INPUT_HEIGHT, INPUT_WIDTH, STRIDE
from ..core.network.scene_network import normalize_color
from .scene_examples import SceneExamples

_MIRRORED = np.arange(256, dtype=np.uint8)
_MIRRORED[[LEFT_WALL, RIGHT_WALL]] = RIGHT_WALL, LEFT_WALL
_GREY = 128


@dataclass(frozen=True, slots=True)
class Augmentation:
    """How far views differ from the recorded ones.

    Attributes
    ----------
    zoom : least and largest side of the crop, as a share of the image; above 1 there is a border without truth.
    aspect : largest factor between the zooms of the sides. tilt_deg : largest rotation.
    gain, tint, gamma : largest change of brightness, of a channel and of the exponent, as shares.
    grey : share of views without colour. noise : largest standard deviation, in 8-bit steps.
    holes, hole : most patches blotted out of a view, and their largest side, as a share of the image.
    """

    zoom: tuple[float, float] = (0.55, 1.25)
    aspect: float = 1.3
    tilt_deg: float = 6.0
    gain: float = 0.35
    tint: float = 0.15
    gamma: float = 0.35
    grey: float = 0.05
    noise: float = 8.0
    holes: int = 4
    hole: float = 0.3


@dataclass(frozen=True, slots=True)
class SceneBatch:
    """Inputs (b, 3, H, W) float32 of `normalize_color`, truth (b, H / STRIDE, W / STRIDE) uint8 each."""

    inputs: NDArray[np.float32]
    labels: NDArray[np.uint8]
    layout: NDArray[np.uint8]
    classes: NDArray[np.uint8]


def make_batch(examples: SceneExamples, settings: Augmentation | None, rng: np.random.Generator) -> SceneBatch:
    """Draw one view of each example; the recorded view where `settings` is None."""
    rows = [_view(examples, i, settings, rng) for i in range(len(examples.number))]
    inputs, labels, layout, classes = (np.stack(part) for part in zip(*rows, strict=True))
    return SceneBatch(inputs, labels, layout, classes)


def _view(
    examples: SceneExamples, i: int, settings: Augmentation | None, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
    height, width = examples.labels[i].shape
    mirrored = settings is not None and bool(rng.random() < 0.5)
    warp = _warp(width, height, settings, rng)
    if mirrored:
        warp = warp @ np.array([[-1.0, 0.0, width - 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    color = _warped(examples.color[i], warp, (INPUT_WIDTH, INPUT_HEIGHT), cv2.INTER_LINEAR, _GREY)
    if settings is not None:
        color = _relight(color, settings, rng)
    coarse = np.diag([1.0 / STRIDE, 1.0 / STRIDE, 1.0])
    coarse[:2, 2] = 0.5 / STRIDE - 0.5  # centre of a cell of STRIDE pixels
    size = (INPUT_WIDTH // STRIDE, INPUT_HEIGHT // STRIDE)
    labels, layout, classes = (
        _warped(image[i], coarse @ warp, size, cv2.INTER_NEAREST, 0)
        for image in (examples.labels, examples.layout, examples.classes)
    )
    if mirrored:
        labels, layout = _MIRRORED[labels], _MIRRORED[layout]
    return np.moveaxis(normalize_color(color), -1, 0), labels, layout, classes


def _warp(width: int, height: int, settings: Augmentation | None, rng: np.random.Generator) -> NDArray[np.float64]:
    """(3, 3) matrix from pixels of the example to pixels of the input."""
    zoom, aspect, tilt, place = 1.0, 1.0, 0.0, np.array([0.5, 0.5])
    if settings is not None:
        zoom = float(rng.uniform(*settings.zoom))
        aspect = float(np.exp(rng.uniform(-1.0, 1.0) * 0.5 * np.log(settings.aspect)))
        tilt = float(np.deg2rad(rng.uniform(-settings.tilt_deg, settings.tilt_deg)))
        place = rng.random(2)
    share = np.array([zoom * aspect, zoom / aspect])  # of the image's sides
    scale = np.array([INPUT_WIDTH / width, INPUT_HEIGHT / height]) / share
    centre = (0.5 + (place - 0.5) * (1.0 - share)) * (width, height) - 0.5
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    warp = np.eye(3)
    warp[:2, :2] = np.diag(scale) @ turn
    warp[:2, 2] = np.array([INPUT_WIDTH, INPUT_HEIGHT]) / 2.0 - 0.5 - warp[:2, :2] @ centre
    return warp


def _warped(
    image: NDArray[np.uint8], warp: NDArray[np.float64], size: tuple[int, int], interpolation: int, border: int
) -> NDArray[np.uint8]:
    border_value = (border,) * 3
    return np.asarray(cv2.warpAffine(image, warp[:2], size, flags=interpolation, borderValue=border_value), np.uint8)


def _relight(color: NDArray[np.uint8], settings: Augmentation, rng: np.random.Generator) -> NDArray[np.uint8]:
    values = color.astype(np.float32) / 255.0
    values = values ** np.exp(rng.uniform(-settings.gamma, settings.gamma))
    gain = np.exp(rng.uniform(-settings.gain, settings.gain))
    values *= gain * np.exp(rng.uniform(-settings.tint, settings.tint, 3)).astype(np.float32)
    if rng.random() < settings.grey:
        values[:] = values.mean(axis=2, keepdims=True)
    for _ in range(int(rng.integers(settings.holes + 1))):
        _blot(values, settings.hole, rng)
    values += rng.standard_normal(values.shape, np.float32) * (rng.uniform(0.0, settings.noise) / 255.0)
    return np.clip(values * 255.0, 0.0, 255.0).astype(np.uint8)


def _blot(values: NDArray[np.float32], largest: float, rng: np.random.Generator) -> None:
    """Paint a patch in one random colour: what is there must be told from what is around it."""
    height, width = values.shape[:2]
    rows, columns = (rng.uniform(0.05, largest, 2) * (height, width)).astype(int)
    top, left = int(rng.integers(height - rows + 1)), int(rng.integers(width - columns + 1))
    values[top : top + rows, left : left + columns] = rng.random(3)
