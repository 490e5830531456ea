"""What the true labels say about each superpixel, with the walls named in the axes at hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.labels import N_LABELS, WALL_FACES
from ..core.layout import FACE_AXIS, FACE_SIGN, RoomCuboid
from ..datasets.sample import labels_from_classes


def label_histogram(index: NDArray[np.int32], count: int, labels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Count the labels in each superpixel.

    Parameters
    ----------
    index : (H, W) int32, 0..count-1. count : superpixels.
    labels : (H, W) uint8 label ids, 0 where unknown.

    Returns
    -------
    (count, 7) float32
        Pixels per label id 0..6.
    """
    flat = index.astype(np.int64) * (N_LABELS + 1) + labels
    counts = np.bincount(flat.ravel(), minlength=count * (N_LABELS + 1))
    return counts.reshape(count, N_LABELS + 1).astype(np.float32)


def class_histogram(index: NDArray[np.int32], count: int, labels40: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(count, 41) float32 pixels per NYU40 id in each superpixel."""
    flat = index.astype(np.int64) * 41 + labels40
    return np.bincount(flat.ravel(), minlength=count * 41).reshape(count, 41).astype(np.float32)


def translate_faces(cuboid: RoomCuboid, R_room_camera: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Translate the face ids of a true room to the names its faces have in other axes.

    A wall gets the name of the wall (left, front, right) of the other axes whose outward normal is nearest; two
    walls may share a name when the axes disagree by 45 degrees or more.

    Returns
    -------
    (7,) uint8
        New label id for each old one.
    """
    table = np.arange(N_LABELS + 1, dtype=np.uint8)
    outward = FACE_SIGN[:, None] * R_room_camera[FACE_AXIS]
    for k in WALL_FACES:
        true = FACE_SIGN[k] * cuboid.R_room_camera[FACE_AXIS[k]]
        table[k + 1] = WALL_FACES[int(np.argmax(outward[list(WALL_FACES)] @ true))] + 1
    return table


def true_labels(
    cuboid: RoomCuboid, layout: NDArray[np.uint8], labels40: NDArray[np.uint8], R_room_camera: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """(H, W) uint8 labels of a frame with a known room, walls named in the axes `R_room_camera`."""
    return labels_from_classes(translate_faces(cuboid, R_room_camera)[layout], labels40)
