"""All evidence of one frame: what each superpixel looks like, and what that says under each naming of the axes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .evidence.depth_cues import compute_depth_cues
from .evidence.features import SuperpixelFeatures
from .evidence.geometric_context import ContextModel, compute_geometric_context
from .evidence.orientation_map import compute_orientation_map
from .frame import CameraIntrinsics
from .labels import N_FACES
from .lines import LineSegments, classify_segments
from .manhattan import ManhattanFrame
from .network.scene_network import SuperpixelScene
from .superpixels import Superpixels
from .wall_naming import rename_walls
from .weights import uses

_LEAST_FACING = np.cos(np.deg2rad(60.0))
"""A wall turned away from the camera by more is not tried as the front one where another is."""

SAME_NAMES = np.arange(N_FACES + 1, dtype=np.uint8)
"""Of the ids of an orientation map: each keeps its own."""


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """What the earlier stages found under one naming of the axes; what is None is not known.

    Attributes
    ----------
    R_room_camera : (3, 3) float64.
    orientation : (H, W) uint8 orientation map, 0 or face id 1..5, under some naming of the axes.
    orientation_names : (6,) uint8 what the ids 0..5 of that map are called under this one.
    context : (K, 6) probabilities of geometric context, in the order of the labels.
    depth_cues : (K, 12) six cosines and six distances, each in the order of the labels.
    scene_layout : (K, 5) probabilities of the faces of the empty room, by the scene network.
    """

    R_room_camera: NDArray[np.float64]
    orientation: NDArray[np.uint8] | None = None
    context: NDArray[np.float64] | None = None
    depth_cues: NDArray[np.float64] | None = None
    scene_layout: NDArray[np.float64] | None = None
    orientation_names: NDArray[np.uint8] = field(default_factory=lambda: SAME_NAMES)


def map_orientation(
    segments: LineSegments | None, axes: ManhattanFrame, camera: CameraIntrinsics, variant: str = "full"
) -> tuple[NDArray[np.int8] | None, NDArray[np.uint8] | None]:
    """Axis of each segment, and the orientation map, under the first naming of the axes.

    Parameters
    ----------
    segments : LineSegments or None
        None without colour.
    variant : str
        Of the model (`weights.VARIANTS`).

    Returns
    -------
    line_class : (n,) int8 or None
    orientation : (H, W) uint8 or None
        None also in a variant without the map.
    """
    if segments is None:
        return None, None
    R = axes.R_room_camera
    line_class = classify_segments(segments, R, camera)
    seen = uses(variant, "layout_om")
    return line_class, compute_orientation_map(segments, line_class, R, camera) if seen else None


def classify_superpixels(
    features: SuperpixelFeatures, model: ContextModel, variant: str = "full"
) -> NDArray[np.float64] | None:
    """(K, 6) geometric context, None in a variant of the model without it."""
    return compute_geometric_context(features, model) if uses(variant, "layout_gc") else None


def gather_hypotheses(
    superpixels: Superpixels,
    axes: ManhattanFrame,
    camera: CameraIntrinsics,
    context: NDArray[np.float64] | None,
    orientation: NDArray[np.uint8] | None,
    scene: SuperpixelScene | None,
    with_depth: bool,
    count: int,
) -> tuple[FrameEvidence, ...]:
    """Evidence under each of the first `count` namings of the axes.

    Parameters
    ----------
    context : (K, 6) float64 or None
        Geometric context under `axes.R_room_camera`; walls are renamed for the others.
    orientation : (H, W) uint8 or None
        Orientation map under `axes.R_room_camera`; its ids are renamed likewise.
    scene : SuperpixelScene or None
        What the scene network says; its layout is renamed likewise.
    """
    hypotheses = []
    for k, R in enumerate(axes.hypotheses[:count]):
        if k > 0 and R[2, 2] < _LEAST_FACING:
            continue
        hypotheses.append(
            FrameEvidence(
                R_room_camera=R,
                orientation=orientation,
                orientation_names=_renamed_ids(axes.R_room_camera, R),
                context=None if context is None else rename_walls(context, axes.R_room_camera, R),
                depth_cues=compute_depth_cues(superpixels, R, camera) if with_depth else None,
                scene_layout=None if scene is None else rename_walls(scene.layout, axes.R_room_camera, R),
            )
        )
    return tuple(hypotheses)


def _renamed_ids(R_from: NDArray[np.float64], R_to: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(6,) what the ids 0..5 of an orientation map are called under other axes; 0 is no orientation."""
    names = rename_walls(np.eye(N_FACES), R_from, R_to).argmax(axis=1) + 1
    return np.append(0, names).astype(np.uint8)
