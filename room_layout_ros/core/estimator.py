"""From one colour + depth frame to the room: the whole estimate on one screen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .conclusion import conclude
from .config import JOINT, KERNEL, SIMPLE, EstimatorConfig
from .cuboid_refinement import refine_cuboid
from .depth_estimator import estimate_from_depth
from .estimate import RoomEstimate, Status, no_estimate
from .frame import RgbdFrame
from .furniture import FurnitureModel, find_furniture
from .hypotheses import classify_superpixels, gather_hypotheses
from .joint import estimate_joint
from .kernel_furniture import find_furniture_by_kernels, load_kernel_classifier
from .models import load_models, load_scene_network, looks_at_scene
from .network.scene_network import SceneScores, compute_scene_scores
from .observation import Observation, observe
from .stage_clock import StageClock
from .tracking import TemporalPrior
from .upright import Turn
from .working_size import resize_frame, restore_estimate, working_factors


class LayoutEstimator:
    """Estimates layout and clutter of the room in a frame. Holds settings and models only; safe to share.

    Parameters
    ----------
    config : EstimatorConfig, optional
    models : Path, optional
        Folder with the learned models; the shipped ones by default.

    Raises
    ------
    WeightsError
        When a model cannot be used; one sentence.
    """

    def __init__(self, config: EstimatorConfig | None = None, models: Path | None = None) -> None:
        self.config = config or EstimatorConfig()
        looks = looks_at_scene(self.config)
        self.network = load_scene_network(models) if looks else None
        self.kernels = load_kernel_classifier(models) if self.config.furniture_features == KERNEL else None
        ways = product((True, False), (True, False) if looks else (False,))
        self.models = {way: load_models(*way, models) for way in ways}

    def estimate(
        self, frame: RgbdFrame, prior: TemporalPrior | None = None, expired: Callable[[], bool] = lambda: False
    ) -> RoomEstimate:
        """Estimate the room in one frame.

        Parameters
        ----------
        frame : RgbdFrame
        prior : TemporalPrior, optional
            Of the previous frame (`tracking.next_prior`); without it the frame stands alone and the result depends
            on nothing else.
        expired : callable, optional
            True once the time is up; asked between the steps of the search, which then ends with the best so far.

        Returns
        -------
        RoomEstimate
            Always; its `status` says whether a room was found.
        """
        run, config, camera = StageClock(), self.config, frame.camera
        if prior is not None and prior.gravity is not None and (turn := Turn.upright(prior.gravity)).quarters:
            return self._estimate_turned(turn, frame, prior, expired)
        if working_factors(camera, config.working_size_px) != (1, 1):
            return self._estimate_resized(frame, prior, expired)
        seen = observe(frame, config, self.look, prior, run, with_parts=config.method == JOINT)
        if isinstance(seen, Status):
            return no_estimate(seen, frame, run.timings_ms)
        geometry, superpixels = seen.geometry, seen.superpixels
        if config.method == SIMPLE and geometry is not None:
            return run("layout", estimate_from_depth, frame, geometry, seen.axes, superpixels, run.timings_ms)
        models = self.models[seen.way]
        context = run("context", classify_superpixels, seen.features, models.context, config.joint_variant)
        namings = config.namings(geometry is not None)
        evidence = run("evidence", gather_hypotheses, seen, context, camera, namings)
        joint = run(
            "joint", estimate_joint, camera, superpixels, evidence, geometry, models.joint, config, expired, seen.parts
        )
        with run.beside("furniture", self._name_furniture, frame, seen, joint.labels, models.furniture) as drawn:
            room = run("refinement", refine_cuboid, joint, seen, context, frame, config.refinement)
        return conclude(frame, seen, joint, room, drawn(), models.confidence, run.timings_ms)

    def _estimate_turned(
        self, turn: Turn, frame: RgbdFrame, prior: TemporalPrior, expired: Callable[[], bool]
    ) -> RoomEstimate:
        """Estimate the room in a picture in which down is down, and return the estimate of the frame as it is."""
        estimate = turn.back(self.estimate(turn.frame(frame), turn.prior(prior), expired))
        if estimate.cuboid is None:
            return estimate
        return replace(estimate, polygons=estimate.cuboid.polygons(frame.camera))

    def _estimate_resized(
        self, frame: RgbdFrame, prior: TemporalPrior | None, expired: Callable[[], bool]
    ) -> RoomEstimate:
        """Estimate the room at the working size, and return the estimate at that of the frame."""
        run, size = StageClock(), self.config.working_size_px
        resized = run("resize", resize_frame, frame, size)
        estimate = run("restore", restore_estimate, self.estimate(resized, prior, expired), frame.camera, size)
        return replace(estimate, timings_ms={**estimate.timings_ms, **run.timings_ms})

    def _name_furniture(
        self, frame: RgbdFrame, seen: Observation, labels: NDArray[np.uint8], model: FurnitureModel
    ) -> NDArray[np.uint8]:
        """Draw the furniture, told by the features that `furniture_features` names."""
        if self.kernels is None:
            return find_furniture(seen.superpixels, labels, seen.features, model)
        color = frame.color if self.config.use_color else None
        return find_furniture_by_kernels(color, seen.geometry, seen.superpixels, labels, self.kernels)

    def look(self, frame: RgbdFrame) -> SceneScores | None:
        """Ask the scene network about a frame; None without colour or network."""
        return compute_scene_scores(frame.color if self.config.use_color else None, self.network)
