"""One frame with its estimate and what is derived from it on demand, computed once for all outputs that want it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from .core.config import EstimatorConfig
from .core.depth import compute_depth_geometry
from .core.estimate import RoomEstimate
from .core.floor_plane import FloorPlane
from .core.frame import RgbdFrame
from .core.freespace import FreeSpace, compute_free_space
from .node_config import NodeConfig


@dataclass(frozen=True)
class Scene:
    """What the outputs are made of. `floor` is where the floor is expected, None where only the estimate can say."""

    frame: RgbdFrame
    estimate: RoomEstimate
    node: NodeConfig
    estimator: EstimatorConfig
    floor: FloorPlane | None = None

    @cached_property
    def free_space(self) -> FreeSpace | None:
        """Free space of the frame; None without depth or floor."""
        geometry = compute_depth_geometry(self.frame, self.estimator)
        if geometry is None:
            return None
        return compute_free_space(geometry, self.estimate, self.estimator, self.floor)

    @property
    def floor_frame(self) -> str:
        """Name of the frame on the floor below the camera."""
        return self.node.floor_frame or f"{self.frame.frame_id}_floor"
