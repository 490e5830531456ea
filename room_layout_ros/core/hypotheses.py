"""From what is seen in a frame to its evidence under each naming of the axes that the joint energy chooses from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .evidence.depth_cues import compute_depth_cues
from .evidence.features import SuperpixelFeatures
from .evidence.geometric_context import ContextModel, compute_geometric_context
from .frame import CameraIntrinsics
from .frame_evidence import FrameEvidence
from .labels import N_FACES
from .observation import Observation
from .wall_naming import rename_walls
from .weights import uses

_LEAST_FACING = np.cos(np.deg2rad(60.0))
"""A wall turned away from the camera by more is not tried as the front one where another is."""


def classify_superpixels(
    features: SuperpixelFeatures, model: ContextModel, variant: str = "full"
) -> NDArray[np.float64] | None:
    """(K, 6) geometric context, None in a variant of the model without it."""
    return compute_geometric_context(features, model) if uses(variant, "layout_gc") else None


def gather_hypotheses(
    seen: Observation, context: NDArray[np.float64] | None, camera: CameraIntrinsics, count: int
) -> tuple[FrameEvidence, ...]:
    """Evidence under each of the first `count` namings of the axes, best first.

    What is seen is of the first; walls are renamed for the others, and a front wall turned far away is left out.

    Parameters
    ----------
    seen : Observation
    context : (K, 6) float64 or None
        Geometric context under the first naming.
    camera : CameraIntrinsics
    count : int
    """
    first, scene, hypotheses = seen.axes.R_room_camera, seen.scene, []
    for k, R in enumerate(seen.axes.hypotheses[:count]):
        if k > 0 and R[2, 2] < _LEAST_FACING:
            continue
        hypotheses.append(
            FrameEvidence(
                R_room_camera=R,
                orientation=seen.orientation,
                orientation_names=_renamed_ids(first, R),
                context=None if context is None else rename_walls(context, first, R),
                depth_cues=None if seen.geometry is None else compute_depth_cues(seen.superpixels, R, camera),
                scene_layout=None if scene is None else rename_walls(scene.layout, first, R),
            )
        )
    return tuple(hypotheses)


def _renamed_ids(R_from: NDArray[np.float64], R_to: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(6,) what the ids 0..5 of an orientation map are called under other axes; 0 is no orientation."""
    names = rename_walls(np.eye(N_FACES), R_from, R_to).argmax(axis=1) + 1
    return np.append(0, names).astype(np.uint8)
