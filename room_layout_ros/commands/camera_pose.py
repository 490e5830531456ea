"""How the camera of an input hangs: what the node has as parameters of the same names, and else an upright camera."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.commands.counts import real
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.core.upright import Turn
from room_layout_ros.datasets import DataError
from room_layout_ros.node_config import down_in_camera

POSE = ("camera_roll_deg", "camera_pitch_deg")
"""Parameters of the node that are options here."""


def add_pose_arguments(parser: argparse.ArgumentParser, pitch: bool = True) -> None:
    """Add the angles, which are those of the node's parameters; a command without priors has no `pitch`."""
    group = parser.add_argument_group("how the camera hangs (taken to be upright, within 45 degrees, if not given)")
    group.add_argument(
        "--camera-roll-deg",
        type=real(-180, 180),
        metavar="DEG",
        help="it leans to its right by this angle: 90 or -90 on its side, 180 upside down; to 45 degrees is enough",
    )
    if pitch:
        group.add_argument(
            "--camera-pitch-deg",
            type=real(-90, 90),
            metavar="DEG",
            help="it looks down by this angle; where it is given, both have to be right to a few degrees",
        )


@dataclass(frozen=True, slots=True)
class CameraPose:
    """How a camera hangs.

    Attributes
    ----------
    turn : makes its pictures upright, but for 45 degrees. gravity : (3,) down in the camera frame, or None: not known
        so well.
    """

    turn: Turn = Turn(0)
    gravity: NDArray[np.float64] | None = None

    def estimate(
        self, estimator: LayoutEstimator, frame: RgbdFrame, prior: TemporalPrior | None = None
    ) -> RoomEstimate:
        """Estimate the room in a frame of the camera, as the picture is.

        Gravity that is told must be right: without depth it is taken at its word, and with a pitch of 0 in the place of
        15 degrees a third of the layout was another. So a camera of which the roll alone is told is only turned.
        """
        if self.gravity is not None:
            return estimator.estimate(frame, replace(prior or TemporalPrior(), gravity=self.gravity))
        if not self.turn.quarters:
            return estimator.estimate(frame, prior)
        turned = None if prior is None else self.turn.prior(prior)
        estimate = self.turn.back(estimator.estimate(self.turn.frame(frame), turned))
        return (
            estimate if estimate.cuboid is None else replace(estimate, polygons=estimate.cuboid.polygons(frame.camera))
        )


UPRIGHT = CameraPose()


def pose_of(arguments: argparse.Namespace) -> CameraPose:
    """Return how the camera hangs by the angles on the command line."""
    angles = given_angles(arguments)
    if not angles:
        return UPRIGHT
    down = down_in_camera(angles.get("camera_pitch_deg", 0.0), angles.get("camera_roll_deg", 0.0))
    return CameraPose(Turn.upright(down), down if "camera_pitch_deg" in angles else None)


def given_angles(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the angles that are given, by the names of the node's parameters."""
    return {name: value for name in POSE if (value := getattr(arguments, name, None)) is not None}


def refuse_pose(arguments: argparse.Namespace, why: str) -> None:
    """Refuse the angles where they are of no camera that is read.

    Raises
    ------
    DataError
        With the first that was given.
    """
    for name in given_angles(arguments):
        raise DataError(f"--{name.replace('_', '-')} is of the camera of an input, {why}")
