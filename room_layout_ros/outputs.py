"""What the node publishes: one row per topic. Nothing is computed for a topic that nobody listens to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from msg_adapters import messages
from msg_adapters.encode_image import encode_image
from msg_adapters.encode_room import encode_markers, encode_polygons

from .core.estimate import RoomEstimate
from .core.frame import RgbdFrame
from .core.picture import draw_overlay
from .node_config import NodeConfig

Encode = Callable[[RgbdFrame, RoomEstimate, NodeConfig], Sequence[Any]]


@dataclass(frozen=True, slots=True)
class Output:
    """A topic, its message class and how an estimate becomes messages of it."""

    topic: str
    message: type
    depth: int
    """Messages that the publisher keeps for slow listeners."""
    encode: Encode
    meaning: str


def _labels(frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig) -> Sequence[Any]:
    return [encode_image(estimate.labels, frame.stamp_ns, frame.frame_id)]


def _layout(frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig) -> Sequence[Any]:
    return [encode_image(estimate.layout, frame.stamp_ns, frame.frame_id)]


def _furniture(frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig) -> Sequence[Any]:
    return [encode_image(estimate.furniture, frame.stamp_ns, frame.frame_id)]


def _overlay(frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig) -> Sequence[Any]:
    return [encode_image(draw_overlay(frame, estimate), frame.stamp_ns, frame.frame_id)]


def _polygons(frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig) -> Sequence[Any]:
    return encode_polygons(estimate)


def _markers(frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig) -> Sequence[Any]:
    return [encode_markers(estimate, config.marker_lifetime)]


OUTPUTS = (
    Output("~/labels", messages.Image, 5, _labels, "mono8: faces where seen, and clutter; ids on ~/label_names"),
    Output("~/layout", messages.Image, 5, _layout, "mono8 image of the empty room's faces, ids as ~/labels"),
    Output("~/furniture", messages.Image, 5, _furniture, "mono8 image: NYU40 class id on clutter, 0 elsewhere"),
    Output("~/overlay", messages.Image, 1, _overlay, "rgb8 picture for people"),
    Output(
        "~/polygons", messages.PolygonInstanceStamped, 5 * 5, _polygons,
        "a message per visible face: corners in metres, the id is the label id of the face",
    ),
    Output("~/markers", messages.MarkerArray, 5, _markers, "the room for RViz: fills, edges, names and distances"),
)  # fmt: skip


def send(
    frame: RgbdFrame, estimate: RoomEstimate, config: NodeConfig, publishers: Iterable[tuple[Output, Any]]
) -> None:
    """Encode and publish what has a listener."""
    for output, publisher in publishers:
        if publisher.get_subscription_count() > 0:
            for message in output.encode(frame, estimate, config):
                publisher.publish(message)
