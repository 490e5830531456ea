"""One frame with its estimate and what is derived from it on demand, computed once for all outputs that want it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from .core.config import EstimatorConfig
from .core.cuboids import ObjectCuboid, compute_object_cuboids
from .core.depth import DepthGeometry, compute_depth_geometry
from .core.estimate import RoomEstimate
from .core.floor.floor_plane import FloorPlane
from .core.frame import RgbdFrame
from .core.freespace import FreeSpace, compute_free_space
from .core.working_size import original_of, restore_estimate
from .node_config import NodeConfig


@dataclass(frozen=True)
class Scene:
    """What the outputs are made of.

    Attributes
    ----------
    working_frame : RgbdFrame at the estimator's working size. working_estimate : of this frame.
    floor : where the floor is expected, None where only the estimate can say.
    """

    working_frame: RgbdFrame
    working_estimate: RoomEstimate
    node: NodeConfig
    estimator: EstimatorConfig
    floor: FloorPlane | None = None

    @property
    def frame(self) -> RgbdFrame:
        """The frame as the camera sent it."""
        return original_of(self.working_frame)

    @cached_property
    def estimate(self) -> RoomEstimate:
        """The estimate with its images at the size of the camera's."""
        return restore_estimate(self.working_estimate, self.frame.camera, self.estimator.working_size_px)

    @cached_property
    def geometry(self) -> DepthGeometry | None:
        """Geometry of the depth image at the working size; None without (enough) depth."""
        return compute_depth_geometry(self.working_frame, self.estimator)

    @cached_property
    def free_space(self) -> FreeSpace | None:
        """Free space of the frame; None without depth or floor."""
        if self.geometry is None:
            return None
        estimate, color = self.working_estimate, self.working_frame.color
        return compute_free_space(self.geometry, estimate, self.estimator, self.floor, color)

    @cached_property
    def objects(self) -> tuple[ObjectCuboid, ...]:
        """Things in the room; none without depth or floor."""
        if self.geometry is None or self.free_space is None:
            return ()
        return compute_object_cuboids(self.geometry, self.working_estimate, self.free_space, self.estimator)

    @property
    def floor_frame(self) -> str:
        """Name of the frame on the floor below the camera."""
        return self.node.floor_below(self.frame.frame_id)
