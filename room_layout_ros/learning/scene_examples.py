"""What the scene network learns from: small colour images with what each pixel is, and what is behind it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.labels import CEILING, CEILING_NYU40, FLOOR, FLOOR_NYU40
from ..core.layout import RoomCuboid
from ..datasets.sample import Sample, labels_from_classes
from .folds import SYNTHETIC_FIRST, frame_number

WIDTH, HEIGHT = 320, 240
"""Size the examples are kept in, in pixels; crops of it become the input of the network."""

SOME_WALL = 7
"""Label of wall, door, window... in a frame whose room is not known: one of the three walls."""


@dataclass(frozen=True, slots=True)
class SceneExamples:
    """Images and truth, all (n, HEIGHT, WIDTH).

    Attributes
    ----------
    color : (n, HEIGHT, WIDTH, 3) uint8 RGB.
    labels : uint8 label ids 1..6, `SOME_WALL`, 0 unknown.
    layout : uint8 faces of the empty room 1..5, 0 where the room is not known.
    classes : uint8 NYU40, 0 unlabelled.
    number : (n,) int64 frame number; synthetic ones start at `SYNTHETIC_FIRST`.
    """

    color: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    layout: NDArray[np.uint8]
    classes: NDArray[np.uint8]
    number: NDArray[np.int64]

    def subset(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> SceneExamples:
        """Return the examples of a mask or of indices."""
        return SceneExamples(*(getattr(self, name)[rows] for name in self.__slots__))


def collect_examples(
    samples: Iterable[Sample], rooms: Mapping[str, RoomCuboid], synthetic: bool = False
) -> SceneExamples:
    """Gather the examples of labelled frames with colour; others are left out.

    Parameters
    ----------
    samples : with NYU40 labels. The frame's number is its name where that is one, else its place.
    rooms : fitted rooms by name; a frame without one does not teach the layout.
    synthetic : the samples' own rooms are true, and their numbers start at `SYNTHETIC_FIRST`.

    Raises
    ------
    ValueError
        When no sample is left.
    """
    rows = []
    for ordinal, sample in enumerate(samples):
        if sample.truth is None or sample.truth.labels40 is None or sample.frame.color is None:
            continue
        room = sample.truth.cuboid if synthetic else rooms.get(sample.name)
        classes = sample.truth.labels40
        layout = np.zeros_like(classes) if room is None else room.raster(sample.frame.camera)
        rows.append(
            (
                cv2.resize(sample.frame.color, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA),
                *(_shrink(image) for image in (_labels(layout, classes, room is not None), layout, classes)),
                ordinal + SYNTHETIC_FIRST if synthetic else frame_number(sample.name, ordinal),
            )
        )
    if not rows:
        raise ValueError("no frame with colour and class labels is among the samples; at least one is needed")
    color, labels, layouts, classes40, numbers = zip(*rows, strict=True)
    return SceneExamples(
        np.stack(color), np.stack(labels), np.stack(layouts), np.stack(classes40), np.array(numbers, np.int64)
    )


def join_examples(parts: Iterable[SceneExamples]) -> SceneExamples:
    """Put examples one after the other."""
    parts = list(parts)
    return SceneExamples(*(np.concatenate([getattr(p, name) for p in parts]) for name in SceneExamples.__slots__))


def _shrink(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST), np.uint8)


def _labels(layout: NDArray[np.uint8], classes: NDArray[np.uint8], known: bool) -> NDArray[np.uint8]:
    faces = layout
    if not known:
        faces = np.full_like(classes, SOME_WALL)
        faces[np.isin(classes, FLOOR_NYU40)] = FLOOR
        faces[np.isin(classes, CEILING_NYU40)] = CEILING
    return labels_from_classes(faces, classes)
