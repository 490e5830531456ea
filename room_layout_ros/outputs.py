"""What the node publishes: one row per topic. Nothing is computed for a topic that nobody listens to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters import messages
from msg_adapters.encode_image import encode_image
from msg_adapters.encode_navigation import encode_cloud, encode_grid, encode_outline, encode_pose, encode_scan
from msg_adapters.encode_objects import encode_objects
from msg_adapters.encode_room import encode_markers, encode_polygons

from .core.freespace import FreeSpace
from .core.picture import draw_overlay
from .scene import Scene

Encode = Callable[[Scene], Sequence[Any]]
"""Return the messages of a scene; none where it has nothing of the kind (no floor in view)."""


@dataclass(frozen=True, slots=True)
class Output:
    """A topic, its message class and how a scene becomes messages of it."""

    topic: str
    message: type
    depth: int
    """Messages that the publisher keeps for slow listeners."""
    encode: Encode
    meaning: str
    on_floor: bool = False
    """True where the message lies in the floor frame, not in the camera's."""
    needs_floor: bool = False
    """True where there is nothing to send without a floor."""


def _labels(scene: Scene) -> Sequence[Any]:
    return [encode_image(scene.estimate.labels, scene.frame.stamp_ns, scene.frame.frame_id)]


def _layout(scene: Scene) -> Sequence[Any]:
    return [encode_image(scene.estimate.layout, scene.frame.stamp_ns, scene.frame.frame_id)]


def _furniture(scene: Scene) -> Sequence[Any]:
    return [encode_image(scene.estimate.furniture, scene.frame.stamp_ns, scene.frame.frame_id)]


def _overlay(scene: Scene) -> Sequence[Any]:
    return [encode_image(draw_overlay(scene.frame, scene.estimate), scene.frame.stamp_ns, scene.frame.frame_id)]


def _in_its_unit(scene: Scene) -> bool:
    """Whether the room has the unit that its listeners count on: metres, or by choice that of colour alone."""
    return scene.estimate.metric or not scene.estimator.use_depth


def _polygons(scene: Scene) -> Sequence[Any]:
    return encode_polygons(scene.estimate) if _in_its_unit(scene) else []


def _markers(scene: Scene) -> Sequence[Any]:
    return [encode_markers(scene.estimate, scene.node.marker_lifetime)] if _in_its_unit(scene) else []


def _of_free_space(encode: Callable[[FreeSpace, Scene], Any]) -> Encode:
    def encode_if_seen(scene: Scene) -> Sequence[Any]:
        space = scene.free_space
        return [] if space is None else [encode(space, scene)]

    return encode_if_seen


@_of_free_space
def _free_space(space: FreeSpace, scene: Scene) -> Any:
    return encode_grid(space.grid, space.resolution_m, space.origin_m, scene.frame.stamp_ns, scene.floor_frame)


@_of_free_space
def _obstacles(space: FreeSpace, scene: Scene) -> Any:
    return encode_cloud(space.obstacles, scene.frame.stamp_ns, scene.frame.frame_id)


@_of_free_space
def _floor(space: FreeSpace, scene: Scene) -> Any:
    return encode_cloud(space.floor, scene.frame.stamp_ns, scene.frame.frame_id)


@_of_free_space
def _scan(space: FreeSpace, scene: Scene) -> Any:
    scan = space.scan
    told = scan.ranges_m[np.isfinite(scan.ranges_m)]  # a wall may be farther than the depth is taken
    reach = max(scene.estimator.max_depth_m, float(told.max(initial=0.0)))
    stamp_ns, frame_id = scene.frame.stamp_ns, scene.floor_frame
    return encode_scan(scan.ranges_m, scan.angle_min, scan.angle_increment, reach, stamp_ns, frame_id)


@_of_free_space
def _objects(space: FreeSpace, scene: Scene) -> Any:
    return encode_objects(scene.objects, space.T_camera_floor, scene.estimate, scene.node.marker_lifetime)


@_of_free_space
def _outline(space: FreeSpace, scene: Scene) -> Any:
    return encode_outline(space.room_polygon_m, scene.frame.stamp_ns, scene.floor_frame)


@_of_free_space
def _floor_pose(space: FreeSpace, scene: Scene) -> Any:
    return encode_pose(space.T_camera_floor, scene.frame.stamp_ns, scene.frame.frame_id)


OUTPUTS = (
    Output("~/labels", messages.Image, 5, _labels, "mono8: faces where seen, and clutter; ids on ~/label_names"),
    Output("~/layout", messages.Image, 5, _layout, "mono8 image of the empty room's faces, ids as ~/labels"),
    Output("~/furniture", messages.Image, 5, _furniture, "mono8 image: NYU40 class id on clutter, 0 elsewhere"),
    Output("~/overlay", messages.Image, 1, _overlay, "rgb8 picture for people"),
    Output(
        "~/polygons", messages.PolygonInstanceStamped, 25, _polygons,
        "a message per visible face: corners in metres (colour alone: front wall at 1), the id is its label id",
    ),
    Output(
        "~/markers", messages.MarkerArray, 5, _markers,
        "the room for RViz: fills, edges, names, distances; unit as ~/polygons",
    ),
    Output(
        "~/free_space", messages.OccupancyGrid, 2, _free_space,
        "floor around the camera: 0 seen free, 100 occupied, -1 not known", on_floor=True, needs_floor=True,
    ),
    Output(
        "~/obstacles", messages.PointCloud2, 2, _obstacles, "things on the floor, for marking; no walls",
        needs_floor=True,
    ),
    Output("~/floor", messages.PointCloud2, 2, _floor, "free floor, for clearing", needs_floor=True),
    Output(
        "~/scan", messages.LaserScan, 5, _scan,
        "nearest thing or wall per beam; +Inf where floor was seen and nothing stands, NaN where nothing is known",
        on_floor=True, needs_floor=True,
    ),
    Output(
        "~/objects", messages.MarkerArray, 5, _objects, "things for RViz: upright boxes with class and size",
        needs_floor=True,
    ),
    Output(
        "~/room_outline", messages.PolygonStamped, 2, _outline, "the room on the floor, clipped to the grid",
        on_floor=True, needs_floor=True,
    ),
    Output(
        "~/floor_pose", messages.PoseStamped, 5, _floor_pose, "pose of the floor frame in the camera's frame",
        needs_floor=True,
    ),
)  # fmt: skip
