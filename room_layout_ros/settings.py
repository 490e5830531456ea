"""One consistent set of settings and what is made of them; replaced as a whole, so that each frame uses one set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Protocol

from msg_adapters.camera_info import CameraReading

from .core.config import EstimatorConfig
from .core.estimate import RoomEstimate
from .core.frame import RgbdFrame
from .core.tracking import TemporalPrior
from .datasets.calibration import read_calibration
from .inputs import used_inputs
from .node_config import NodeConfig
from .runtime.pairing import PairingRules
from .runtime.session import SessionRules

_OF_SUBSCRIPTIONS = attrgetter("color_transport", "depth_transport", "depth_registered", "pose_source")


class Estimator(Protocol):
    """What the node needs of the algorithm."""

    config: EstimatorConfig

    def estimate(
        self, frame: RgbdFrame, prior: TemporalPrior | None = None, expired: Callable[[], bool] = ...
    ) -> RoomEstimate:
        """Estimate the room in one frame."""
        ...


def check_streams(config: EstimatorConfig) -> None:
    """Raise ValueError where a live node would wait for ever: with neither stream there is no frame."""
    if not (config.use_color or config.use_depth):
        raise ValueError("use_color and use_depth are both false; the node needs at least one of the two streams")


MakeEstimator = Callable[[EstimatorConfig], Estimator]


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of the node, and the estimator made of the algorithm's.

    Attributes
    ----------
    camera : from `camera_file`, in the place of camera_info; None where the topic is used.
    depth_camera : the same of the depth camera, from `depth_camera_file`.
    """

    node: NodeConfig
    estimator: Estimator
    camera: CameraReading | None = None
    depth_camera: CameraReading | None = None

    @classmethod
    def make(cls, config: EstimatorConfig, node: NodeConfig, make_estimator: MakeEstimator) -> Settings:
        """Return the set; reads the calibration files.

        Raises
        ------
        ValueError
            When one is no calibration, or no stream is used.
        """
        check_streams(config)
        cameras = (_read_camera(Path(f)) if f else None for f in (node.camera_file, node.depth_camera_file))
        return cls(node, make_estimator(config), *cameras)

    def changed(self, config: EstimatorConfig, node: NodeConfig, make_estimator: MakeEstimator) -> Settings:
        """Return the set with other values; the estimator stays where its settings stay."""
        same = config == self.estimator.config
        return Settings(node, self.estimator if same else make_estimator(config), self.camera, self.depth_camera)

    def used(self) -> dict[str, bool]:
        """Return which streams are needed."""
        return used_inputs(self.node, self.estimator.config)

    def subscribes_like(self, other: Settings) -> bool:
        """Return whether both need the same subscriptions."""
        return self.used() == other.used() and _OF_SUBSCRIPTIONS(self.node) == _OF_SUBSCRIPTIONS(other.node)

    def rules(self) -> SessionRules:
        """Return what the session needs to know; the whole set travels with each frame."""
        config = self.estimator.config
        pairing = PairingRules(
            max_gap_ns=round(self.node.max_stamp_gap * 1e9),
            reset_gap_ns=round(self.node.reset_gap * 1e9),
            queue_size=self.node.queue_size,
            use_color=config.use_color,
            use_depth=config.use_depth,
        )
        return SessionRules(pairing, self.node.warm_start, self)


def _read_camera(path: Path) -> CameraReading:
    """Return the camera of a calibration file, with the warning that camera_info of the same values would get."""
    calibration = read_calibration(path)
    return CameraReading(calibration.intrinsics, "", calibration.warning)
