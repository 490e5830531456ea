"""The scene network: what each part of a colour image is, and which face of the room is behind it, at one look.

A small convolutional network (`scene_layers`) on one thread. Beyond the paper: it stands beside geometric context as
evidence, and it is all that sees furniture as such.
"""

from __future__ import annotations

import queue
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import softmax

from ..color import blank_border
from ..labels import N_FACES, N_LABELS
from ..model_file import WeightsError, read_arrays, write_arrays
from .scene_layers import COLUMNS, INPUT_HEIGHT, INPUT_WIDTH, N_SCORES, ROWS, SceneLayers, Work

_KIND = "room_layout scene network"
_MEAN, _SPREAD = 127.0, 128.0
_POOL_ROWS, _POOL_COLUMNS = 2, 4
"""One in so many rows and columns is looked at when scores are averaged over superpixels."""


@dataclass(frozen=True, slots=True)
class SceneScores:
    """Scores of the network, not yet probabilities.

    Attributes
    ----------
    values : (N_SCORES, ROWS, COLUMNS) float32; the softmax of each part is a probability.
        Six labels (faces, clutter), five faces of the empty room, `N_CLASSES` NYU40 classes.
    """

    values: NDArray[np.float32]

    @property
    def labels(self) -> NDArray[np.float64]:
        """(ROWS, COLUMNS, 6) probability of each label."""
        scores = np.moveaxis(self.values[:N_LABELS], 0, -1)
        return np.asarray(softmax(scores.astype(np.float64), axis=-1))

    @property
    def layout(self) -> NDArray[np.float64]:
        """(ROWS, COLUMNS, 5) probability of each face of the empty room."""
        return np.asarray(
            softmax(np.moveaxis(self.values[N_LABELS : N_LABELS + N_FACES], 0, -1).astype(np.float64), axis=-1)
        )


@dataclass(frozen=True, slots=True)
class SuperpixelScene:
    """What the network says about each superpixel.

    Attributes
    ----------
    labels : (K, 6). layout : (K, 5). classes : (K, 41) float64 probabilities; rows sum to 1.
    """

    labels: NDArray[np.float64]
    layout: NDArray[np.float64]
    classes: NDArray[np.float64]


class SceneNetwork:
    """A trained network; may be used by several threads at once.

    Parameters
    ----------
    arrays : {name: array} its weights (`scene_layers.SceneLayers`).
    card : what the trainer says about it; JSON values.

    Raises
    ------
    ValueError
        When they are not the weights of such a network.
    """

    def __init__(self, arrays: Mapping[str, NDArray[Any]], card: Mapping[str, Any] | None = None) -> None:
        self.arrays, self.card = dict(arrays), dict(card or {})
        self._layers = SceneLayers(self.arrays)
        self._idle: queue.LifoQueue[Work] = queue.LifoQueue()

    def __call__(self, color: NDArray[np.uint8]) -> SceneScores:
        """Look at an (H, W, 3) uint8 RGB image of any size."""
        top, bottom, left, right = blank_border(color)
        filled = color
        if top or bottom or left or right:
            inside = color[top : color.shape[0] - bottom, left : color.shape[1] - right]
            filled = np.asarray(cv2.copyMakeBorder(inside, top, bottom, left, right, cv2.BORDER_REPLICATE), np.uint8)
        small = cv2.resize(filled, (INPUT_WIDTH, INPUT_HEIGHT), interpolation=cv2.INTER_AREA)
        try:
            work = self._idle.get_nowait()
        except queue.Empty:
            work = self._layers.workspace()
        try:
            return SceneScores(self._layers.run(normalize_color(np.asarray(small, np.uint8)), work))
        finally:
            self._idle.put(work)


def compute_scene_scores(color: NDArray[np.uint8] | None, network: SceneNetwork | None) -> SceneScores | None:
    """Look at a colour image; None without one or without a network."""
    return None if color is None or network is None else network(color)


def normalize_color(color: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(..., 3) float32 input of the network for (..., 3) uint8 RGB."""
    return np.asarray((color.astype(np.float32) - _MEAN) / _SPREAD, np.float32)


def pool_scene(scores: SceneScores | None, index: NDArray[np.int32], count: int) -> SuperpixelScene | None:
    """Average the scores over superpixels and turn them into probabilities; None without scores.

    Parameters
    ----------
    index : (H, W) int32 superpixel of each pixel, 0..count-1.
    """
    if scores is None:
        return None
    return SuperpixelScene(*_pool(scores.values, index, count))


def save_network(network: SceneNetwork, path: Path) -> None:
    """Write a network; the same network gives the same bytes."""
    write_arrays(path, _KIND, network.arrays, network.card)


def load_network(path: Path) -> SceneNetwork:
    """Read a network.

    Raises
    ------
    WeightsError
        When the file is missing, damaged, of another kind, or holds other weights than the network's.
    """
    try:
        return SceneNetwork(*read_arrays(path, _KIND))
    except WeightsError:
        raise
    except ValueError as error:
        raise WeightsError(f"{path}: {error}") from error


@njit(cache=True, nogil=True)
def _softmax_rows(scores):  # type: ignore[no-untyped-def]
    """(n, c) probabilities of rows of scores."""
    result = np.empty(scores.shape)
    for k in range(len(scores)):
        highest, total = scores[k].max(), 0.0
        for c in range(scores.shape[1]):
            result[k, c] = np.exp(scores[k, c] - highest)
            total += result[k, c]
        for c in range(scores.shape[1]):
            result[k, c] /= total
    return result


@njit(cache=True, nogil=True)
def _first_samples(size, step, parts):  # type: ignore[no-untyped-def]
    """(parts + 1,) first of the samples 1, 1 + step, ... below `size` in each of as many equal parts."""
    first, sample = np.empty(parts + 1, np.int64), 1
    for part in range(parts + 1):
        while sample < size and sample * parts // size < part:
            sample += step
        first[part] = sample
    return first


@njit(cache=True, nogil=True)
def _pool(values, index, count):  # type: ignore[no-untyped-def]
    """Probabilities of the parts by the mean score of each superpixel over some of its pixels, each with the scores of
    the cell it lies in.
    """
    height, width = index.shape
    first_y, first_x = _first_samples(height, _POOL_ROWS, ROWS), _first_samples(width, _POOL_COLUMNS, COLUMNS)
    total, seen = np.zeros((count, N_SCORES)), np.zeros(count)
    cells = np.empty((COLUMNS, N_SCORES), np.float32)
    here, met = np.zeros(count, np.int64), np.empty(count + 1, np.int64)  # pixels of each, and who has any, in a cell
    for row in range(ROWS):
        for c in range(N_SCORES):
            for column in range(COLUMNS):
                cells[column, c] = values[c, row, column]
        for column in range(COLUMNS):
            kinds = 0
            for y in range(first_y[row], first_y[row + 1], _POOL_ROWS):
                for x in range(first_x[column], first_x[column + 1], _POOL_COLUMNS):
                    one = np.uint32(index[y, x])
                    met[kinds] = one
                    kinds += here[one] == 0
                    here[one] += 1
            for k in met[:kinds]:  # few superpixels meet in a cell: its scores are added once to each
                _add_cell(total[k], cells[column], here[k])
                seen[k] += here[k]
                here[k] = 0
    for k in range(count):
        for c in range(N_SCORES):
            total[k, c] /= max(seen[k], 1.0)
    end = N_LABELS + N_FACES
    return _softmax_rows(total[:, :N_LABELS]), _softmax_rows(total[:, N_LABELS:end]), _softmax_rows(total[:, end:])


@njit(cache=True, nogil=True, inline="always")
def _add_cell(total, cell, times):  # type: ignore[no-untyped-def]
    for c in range(N_SCORES):
        total[c] += times * cell[c]
