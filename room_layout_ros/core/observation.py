"""All that is seen in a frame before anything is decided: depth, lines, axes, superpixels, features, scene."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config import EstimatorConfig
from .depth import CELL_PX, DepthGeometry, compute_depth_geometry
from .estimate import Status
from .evidence.features import SuperpixelFeatures, add_scene, compute_superpixel_features
from .evidence.orientation_map import map_orientation
from .evidence.room_extents import compute_room_extents
from .frame import RgbdFrame
from .joint_problem import FirstParts, gather_first_parts
from .lines import LineSegments, compute_line_segments
from .manhattan import ManhattanFrame, find_axes
from .network.scene_network import SceneScores, SuperpixelScene, pool_scene
from .stage_clock import StageClock
from .superpixels import Superpixels, compute_superpixels
from .tracking import TemporalPrior

LookAtScene = Callable[[RgbdFrame], SceneScores | None]
"""Asks a scene network; None where it has nothing to say (no colour)."""


def no_scene(_frame: RgbdFrame) -> SceneScores | None:
    """Ask no network."""
    return None


@dataclass(frozen=True, slots=True)
class Observation:
    """What is seen in a frame; None where the frame has no such thing.

    Attributes
    ----------
    geometry : of the depth. segments, line_class : lines of the picture, and their axes (n,) int8.
    axes : of the room. superpixels : of colour and depth.
    features : of the superpixels under `axes`, with those of the scene network.
    orientation : (H, W) uint8 orientation map under `axes`.
    scores : of the scene network by cell. scene : by superpixel.
    parts : of the joint problem, where they were asked for.
    """

    geometry: DepthGeometry | None
    segments: LineSegments | None
    line_class: NDArray[np.int8] | None
    axes: ManhattanFrame
    superpixels: Superpixels
    features: SuperpixelFeatures
    orientation: NDArray[np.uint8] | None
    scores: SceneScores | None
    scene: SuperpixelScene | None
    parts: FirstParts | None

    @property
    def way(self) -> tuple[bool, bool]:
        """With depth, with the scene network: the way of operation that models are learned for (`load_models`)."""
        return self.geometry is not None, self.scene is not None


def observe(
    frame: RgbdFrame,
    config: EstimatorConfig,
    look: LookAtScene = no_scene,
    prior: TemporalPrior | None = None,
    run: StageClock | None = None,
    axes: ManhattanFrame | None = None,
    with_parts: bool = False,
) -> Observation | Status:
    """Look at a frame.

    Parameters
    ----------
    frame : RgbdFrame
    config : EstimatorConfig
    look : LookAtScene
        The scene network; none by default.
    prior : TemporalPrior, optional
        Of the previous frame.
    run : StageClock, optional
        Books the time of each stage.
    axes : ManhattanFrame, optional
        Of the room, where they are not to be found but given.
    with_parts : bool
        Gather the parts of the joint problem too.

    Returns
    -------
    Observation or Status
        The reason where there is nothing to see.
    """
    run = run or StageClock()
    color = frame.color if config.use_color else None
    geometry = run("depth", compute_depth_geometry, frame, config)
    if geometry is None and color is None:
        return Status.NO_DEPTH
    if min(frame.camera.width, frame.camera.height) < CELL_PX:
        return Status.NO_ROOM
    inverse_depth = None if geometry is None else geometry.inverse_depth
    with (
        run.beside("scene", look, frame) as scores_found,
        run.beside("superpixels", compute_superpixels, color, inverse_depth, config) as superpixels_found,
    ):
        segments = None if color is None else run("lines", compute_line_segments, color, config)
        if axes is None:
            axes = run("axes", find_axes, geometry, segments, frame.camera, config, prior or TemporalPrior())
        if axes is None:
            return Status.NO_ROOM
        R, camera = axes.R_room_camera, frame.camera
        line_class, orientation = run("orientation", map_orientation, segments, R, camera, config.joint_variant)
        extents = None if inverse_depth is None else run("extents", compute_room_extents, inverse_depth, R, camera)
        superpixels = superpixels_found()
        counted: AbstractContextManager[Callable[[], FirstParts | None]] = nullcontext(lambda: None)
        if with_parts:
            counted = run.beside("counts", gather_first_parts, camera, superpixels, geometry, R, orientation, config)
        with counted as parts_found:
            features = run(
                "features", compute_superpixel_features, superpixels, color, inverse_depth, R, camera, segments,
                line_class, orientation, extents,
            )  # fmt: skip
            parts = parts_found()
    scores = scores_found()
    scene = run("pooling", pool_scene, scores, superpixels.index, superpixels.count)
    features = add_scene(features, scene)
    return Observation(geometry, segments, line_class, axes, superpixels, features, orientation, scores, scene, parts)
