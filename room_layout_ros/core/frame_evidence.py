"""All evidence of one frame under one naming of the axes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .labels import N_FACES

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
