"""What every source yields: a frame with what is known to be true about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CLUTTER, FURNITURE_IDS, STRUCTURE_NYU40, UNKNOWN
from room_layout_ros.core.layout import RoomCuboid

MAX_NYU40 = 40


@dataclass(frozen=True, slots=True)
class FloorMap:
    """Which floor cells around the camera are free, by construction of the scene.

    The grid lies in the floor plane. Its axes are the camera's level axes: forward is the optical axis laid
    flat on the floor, right is the optical x axis laid flat; the origin is the foot of the camera.

    Attributes
    ----------
    cells : (rows, columns) uint8, 0 free, 1 occupied (something stands there, or outside the room).
        Row i spans forward = origin_forward_m + [i, i+1) * cell_m; column j spans right likewise.
    height_m : (rows, columns) float32 top of the highest obstacle above the floor; 0 where free,
        inf outside the room.
    cell_m : side of a cell.
    origin_forward_m, origin_right_m : lower corner of cell (0, 0).
    """

    cells: NDArray[np.uint8]
    height_m: NDArray[np.float32]
    cell_m: float
    origin_forward_m: float
    origin_right_m: float


@dataclass(frozen=True, slots=True)
class FrameTruth:
    """Ground truth of one frame; None where the source does not hold it.

    Attributes
    ----------
    layout : (H, W) uint8 face ids 1..5 of the empty room, 0 where not annotated.
    labels40 : (H, W) uint8 NYU40 classes, 0 unlabelled.
    cuboid : the room in the camera frame (only for rooms that are one).
    depth_m : (H, W) float32 depth without noise; inf where nothing is hit.
    layout_depth_m : (H, W) float32 depth of the empty room.
    normal : (H, W, 3) float32 unit normals towards the camera, camera frame.
    floor_map : the free floor.
    down_camera : (3,) unit vector of gravity in the camera frame.
    camera_height_m : camera over the floor, NaN where unknown.
    """

    layout: NDArray[np.uint8] | None = None
    labels40: NDArray[np.uint8] | None = None
    cuboid: RoomCuboid | None = None
    depth_m: NDArray[np.float32] | None = None
    layout_depth_m: NDArray[np.float32] | None = None
    normal: NDArray[np.float32] | None = None
    floor_map: FloorMap | None = None
    down_camera: NDArray[np.float64] | None = None
    camera_height_m: float = float("nan")

    @property
    def labels(self) -> NDArray[np.uint8] | None:
        """(H, W) uint8 label ids 0..6 from layout and classes; None where one of them is missing."""
        if self.layout is None or self.labels40 is None:
            return None
        return labels_from_classes(self.layout, self.labels40)

    @property
    def furniture(self) -> NDArray[np.uint8] | None:
        """(H, W) uint8 NYU40 id of the six furniture classes, 0 elsewhere; None without classes."""
        if self.labels40 is None:
            return None
        return np.where(np.isin(self.labels40, FURNITURE_IDS), self.labels40, 0).astype(np.uint8)


def labels_from_classes(layout: NDArray[np.uint8], labels40: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return label ids by docs/method.md, section 1.

    The layout face where the class is structural, clutter elsewhere, 0 where unlabelled or where the
    layout is not annotated on a structural pixel.

    Parameters
    ----------
    layout, labels40 : (H, W) uint8 arrays
    """
    labels = np.where(np.isin(labels40, STRUCTURE_NYU40), layout, CLUTTER).astype(np.uint8)
    labels[labels40 == 0] = UNKNOWN
    return labels


@dataclass(frozen=True, slots=True)
class Sample:
    """One frame of a source.

    Attributes
    ----------
    frame : the input of the estimator.
    truth : what is known about it, or None.
    T_world_camera : (4, 4) float64 pose of the optical frame, or None.
    """

    frame: RgbdFrame
    truth: FrameTruth | None = None
    T_world_camera: NDArray[np.float64] | None = None

    @property
    def name(self) -> str:
        """Name of the frame in its source."""
        return self.frame.name


@dataclass(frozen=True, slots=True)
class BadFrame:
    """A frame that its source holds but that cannot be used: an error value, not an end."""

    name: str
    error: str
    stamp_ns: int = 0


@runtime_checkable
class FrameSource(Protocol):
    """Where frames come from: a folder, a bag, a .mat file, a synthetic walk. May be iterated again."""

    @property
    def title(self) -> str:
        """What it is, for people."""

    @property
    def length(self) -> int | None:
        """Number of items of one iteration, None where only reading tells."""

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield the frames in order."""


def good_samples(source: FrameSource) -> Iterator[Sample]:
    """Yield only the usable frames of a source."""
    for item in source:
        if isinstance(item, Sample):
            yield item
