"""Each stage of the estimate as a picture that a person can look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.depth_profiles import DepthProfiles
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.evidence import pictures as evidence_pictures
from room_layout_ros.core.evidence.depth_cues import compute_depth_cues
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.frame_evidence import FrameEvidence
from room_layout_ros.core.hypotheses import classify_superpixels
from room_layout_ros.core.joint_problem import build_joint_problem
from room_layout_ros.core.observation import Observation, observe
from room_layout_ros.core.wall_naming import rename_walls
from room_layout_ros.core.working_size import resize_frame

from . import pictures
from .top_down import draw_top_down

Image = NDArray[np.uint8]

_SUPPORT, _BEYOND, _BEFORE = (80, 200, 110), (235, 70, 60), (150, 150, 150)
_WITHIN_M, _WITHIN_SHARE = 0.05, 0.02
_TILE_PX = 360


@dataclass(frozen=True, slots=True)
class Look:
    """A frame, its estimate, and what the estimate was made of; None where the frame has no such evidence.

    Attributes
    ----------
    seen : in the frame, under the first naming of the axes that is tried; of that the context and the cues are, too.
    context : (K, 6) geometric context. cues : (K, 12) depth cues.
    profiles : what depth says of the planes, under the naming of the estimate.
    """

    frame: RgbdFrame
    estimate: RoomEstimate
    seen: Observation | None = None
    context: NDArray[np.float64] | None = None
    cues: NDArray[np.float64] | None = None
    profiles: DepthProfiles | None = None


def look_at(frame: RgbdFrame, estimator: LayoutEstimator) -> Look:
    """Estimate a frame and gather its evidence, at the working size, under the first naming of the axes."""
    frame = resize_frame(frame, estimator.config.working_size_px)
    estimate, config, camera = estimator.estimate(frame), estimator.config, frame.camera
    seen = observe(frame, config, estimator.look)
    if isinstance(seen, Status):
        return Look(frame, estimate)
    context = classify_superpixels(seen.features, estimator.models[seen.way].context, config.joint_variant)
    superpixels, R, cues, profiles = seen.superpixels, seen.axes.R_room_camera, None, None
    if seen.geometry is not None:
        cues = compute_depth_cues(superpixels, R, camera)
    if seen.geometry is not None and estimate.cuboid is not None:
        named = None if context is None else rename_walls(context, R, estimate.R_room_camera)
        evidence = FrameEvidence(estimate.R_room_camera, context=named)
        profiles = build_joint_problem(camera, superpixels, evidence, seen.geometry, config).profiles
    return Look(frame, estimate, seen, context, cues, profiles)


def _color(look: Look) -> Image:
    return pictures.base_image(look.frame)


def _depth(look: Look) -> Image | None:
    return None if look.frame.depth_m is None else pictures.paint_depth(look.frame.depth_m)


def _superpixels(look: Look) -> Image:
    return pictures.draw_superpixels(pictures.base_image(look.frame), look.estimate.superpixels)


def _lines(look: Look) -> Image | None:
    seen = look.seen
    if seen is None or seen.segments is None or seen.line_class is None:
        return None
    image, R = pictures.base_image(look.frame), seen.axes.R_room_camera
    return evidence_pictures.draw_lines(image, seen.segments, seen.line_class, R, look.frame.camera)


def _orientation(look: Look) -> Image | None:
    if look.seen is None or look.seen.orientation is None:
        return None
    return evidence_pictures.draw_orientation(look.frame.color, look.seen.orientation)


def _context(look: Look) -> Image | None:
    if look.seen is None or look.context is None:
        return None
    return evidence_pictures.draw_context(look.frame.color, look.seen.superpixels, look.context)


def _scene(look: Look) -> Image | None:
    if look.seen is None or look.seen.scores is None:
        return None
    return evidence_pictures.draw_scene(pictures.base_image(look.frame), look.seen.scores.labels)


def _behind(look: Look) -> Image | None:
    if look.seen is None or look.seen.scores is None:
        return None
    return evidence_pictures.draw_scene(pictures.base_image(look.frame), look.seen.scores.layout)


def _cues(look: Look) -> Image | None:
    if look.seen is None or look.cues is None:
        return None
    cosines, distances = np.vsplit(evidence_pictures.draw_depth_cues(look.seen.superpixels, look.cues), 2)
    rows = [row for sheet in (cosines, distances) for row in np.hsplit(sheet, 2)]  # three in a row are larger than six
    return pictures.fit(np.vstack(rows), (look.frame.camera.width, look.frame.camera.height))


def _planes(look: Look) -> Image | None:
    if look.profiles is None or look.estimate.cuboid is None:
        return None
    size = (look.frame.camera.width, look.frame.camera.height)
    return evidence_pictures.draw_planes(look.profiles, look.estimate.cuboid.distances, size)


def _support(look: Look) -> Image | None:
    """Measured depth against the empty room's: on a face green, beyond it red, before it grey."""
    depth_m, cuboid = look.frame.depth_m, look.estimate.cuboid
    if depth_m is None or cuboid is None:
        return None
    empty = cuboid.depth(look.frame.camera)
    out = (pictures.base_image(look.frame) // 3).astype(np.uint8)
    with np.errstate(invalid="ignore"):
        seen, slack = np.isfinite(depth_m) & (depth_m > 0), _WITHIN_M + _WITHIN_SHARE * empty
        out[seen & (depth_m < empty - slack)] = _BEFORE
        out[seen & (np.abs(depth_m - empty) <= slack)] = _SUPPORT
        out[seen & (depth_m > empty + slack)] = _BEYOND
    return out


def _labels(look: Look) -> Image:
    return pictures.paint_labels(pictures.base_image(look.frame), look.estimate.labels)


def _layout(look: Look) -> Image:
    tinted = pictures.paint_labels(pictures.base_image(look.frame), look.estimate.layout, 0.35)
    return pictures.draw_outlines(tinted, look.estimate.layout, pictures.ESTIMATE_COLOR)


def _furniture(look: Look) -> Image | None:
    if not look.estimate.furniture.any():
        return None
    painted = pictures.paint_classes(pictures.base_image(look.frame), look.estimate.furniture)
    return pictures.draw_legend(painted, pictures.furniture_legend())


def _top_down(look: Look) -> Image | None:
    if look.frame.depth_m is None or look.estimate.cuboid is None:
        return None
    height, width = look.estimate.labels.shape
    return draw_top_down(look.frame, look.estimate, (width, height))


STAGES: dict[str, tuple[str, Callable[[Look], Image | None]]] = {
    "color": ("colour", _color),
    "depth": ("depth: near red, far blue, black unmeasured", _depth),
    "superpixels": ("superpixels", _superpixels),
    "lines": ("lines and pencils of X red, Y green, Z blue; horizon", _lines),
    "orientation": ("orientation map", _orientation),
    "context": ("geometric context: mixed colours are doubt", _context),
    "scene": ("scene network: labels", _scene),
    "behind": ("scene network: the face behind", _behind),
    "cues": ("depth cues: six cosines, six distances", _cues),
    "planes": ("offset of each plane: support, violation, chosen", _planes),
    "support": ("depth on a face green, beyond red, before grey", _support),
    "labels": ("labels", _labels),
    "layout": ("layout, behind furniture too", _layout),
    "furniture": ("furniture", _furniture),
    "top-down": ("from above, a square a metre", _top_down),
}
"""Name for --stage: caption, and what draws it (None where the frame has nothing of it)."""


def draw_stage(name: str, look: Look) -> Image | None:
    """Return the picture of one stage at the size of the frame, None where there is nothing to show."""
    return STAGES[name][1](look)


def draw_all(look: Look) -> Image:
    """Return all stages that have something to show, three in a row, in the shape of the frame."""
    size = pictures.tile_size(pictures.base_image(look.frame), _TILE_PX)
    drawn = [(caption, draw(look)) for caption, draw in STAGES.values()]
    return pictures.tiles([(caption, image) for caption, image in drawn if image is not None], 3, size)
