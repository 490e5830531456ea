"""A page in the browser that shows rooms as they are estimated: overlay, 3-D, free space, timings.

With INPUT (frames folder, rosbag2, NYU .mat) the frames are estimated here, in their own time. Without it the page
shows what a running `estimator` node publishes. The page is served to this machine alone. Ctrl-C ends it.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import numpy as np

from room_layout_ros.commands.camera_pose import UPRIGHT, CameraPose, add_pose_arguments, pose_of, refuse_pose
from room_layout_ros.commands.compiling import told_first
from room_layout_ros.commands.counts import real
from room_layout_ros.commands.dashboard_ears import SETTLE_S, Ears
from room_layout_ros.commands.dashboard_room import MOST_POINTS, Cloud, Room
from room_layout_ros.commands.dashboard_server import HOST, Board, serve
from room_layout_ros.commands.topics import add_topic_arguments, open_with_topics, refuse_bag_options
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.core.labels import LABEL_COLORS, LABEL_NAMES
from room_layout_ros.core.picture import draw_overlay
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.datasets import DataError, FrameSource
from room_layout_ros.datasets.images import encode_image
from room_layout_ros.datasets.usable import usable_samples
from room_layout_ros.evaluation.face_text import distance_text
from room_layout_ros.evaluation.floor_picture import FloorGrid
from room_layout_ros.listening import listen

_NODE = "/estimator"
_JPEG_QUALITY = 85
_LONGEST_WAIT_S = 2.0
_ENDED = "the input has ended; with --loop it starts again"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `dashboard`."""
    parser.add_argument("input", type=Path, nargs="?", metavar="INPUT", help="default: listen to the running node")
    parser.add_argument("--port", type=int, default=8641, help="of the page, 0 takes a free one (default %(default)s)")
    parser.add_argument("--loop", action="store_true", help="start again at the end of the input")
    parser.add_argument("--seconds", type=real(0), metavar="S", help="end after this time (default: Ctrl-C)")
    parser.add_argument("--node", metavar="NAME", help=f"node to listen to (default {_NODE})")
    add_pose_arguments(parser)
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until interrupted."""
    if not 0 <= arguments.port <= 65535:
        raise DataError(f"--port is {arguments.port}; allowed is 0 to 65535")
    if arguments.input is None:
        refuse_bag_options(arguments, "and without INPUT the page listens to the node")
        refuse_pose(arguments, "and without INPUT the page listens to the node, which has its parameters")
    elif arguments.node is not None:
        raise DataError(f"--node {arguments.node} is for the page without INPUT, and {arguments.input} is given")
    node = _NODE if arguments.node is None else arguments.node
    end = float("inf") if arguments.seconds is None else time.monotonic() + arguments.seconds
    source = None if arguments.input is None else open_with_topics(arguments.input, arguments)
    board = Board(f"node {node}", SETTLE_S) if source is None else Board(source.title)
    server = serve(board, arguments.port)
    print(f"http://{HOST}:{server.server_address[1]}/", flush=True)
    try:
        if source is None:
            listen("room_layout_dashboard", Ears(board, node).listeners(), end)
        else:
            show_source(board, source, end, arguments.loop, pose_of(arguments))
            if time.monotonic() < end:
                stay(board, end)
    except KeyboardInterrupt:
        pass
    finally:
        server.shutdown()
        server.server_close()
    if board.look()[0] < 0 and (reason := board.reason()):
        print(f"no room was shown: {reason}", file=sys.stderr)
    return 0


def stay(board: Board, end: float) -> None:
    """Keep the last room on show, and say that it is the last."""
    board.ended = _ENDED
    print(f"{_ENDED}; its last frame stays on the page", file=sys.stderr, flush=True)
    while (left := end - time.monotonic()) > 0:
        time.sleep(min(0.2, left))


def show_source(board: Board, source: FrameSource, end: float, loop: bool = False, pose: CameraPose = UPRIGHT) -> None:
    """Estimate the frames in the time of their stamps, or as fast as it goes, and show each.

    `pose` : how the camera of all of them hangs.

    Raises
    ------
    DataError
        When there is no usable frame, with the first reason.
    """
    estimator = LayoutEstimator()
    while True:
        prior, begun, first_ns = TemporalPrior(), time.monotonic(), None
        for sample in told_first(usable_samples(source.title, source), estimator.config):
            if time.monotonic() > end:
                return
            frame = sample.frame
            if first_ns is None:
                first_ns = frame.stamp_ns
            due = begun + (frame.stamp_ns - first_ns) * 1e-9
            time.sleep(min(max(0.0, due - time.monotonic()), _LONGEST_WAIT_S))
            start = time.perf_counter()
            estimate = pose.estimate(estimator, frame, prior)
            milliseconds = 1e3 * (time.perf_counter() - start)
            prior = next_prior(estimate)
            board.show(room_of(frame, estimate, estimator.config, milliseconds))
        if not loop:
            return


def room_of(
    frame: RgbdFrame, estimate: RoomEstimate, config: EstimatorConfig, milliseconds: float | None = None
) -> Room:
    """Return what the page shows of a frame and its estimate; `milliseconds` is the wall time that it took."""
    faces = {LABEL_NAMES[p.face]: distance_text(p.distance, estimate.metric) for p in estimate.polygons}
    return Room(
        name=frame.name or str(frame.stamp_ns),
        overlay=encode_image(".jpg", draw_overlay(frame, estimate), _JPEG_QUALITY),
        polygons=[(p.face, p.points_m.round(4).tolist()) for p in estimate.polygons],
        grid=_grid_of(frame, estimate, config),
        cloud=_cloud_of(frame, estimate),
        numbers={"status": estimate.status.value, "confidence": f"{estimate.confidence:.2f}", **faces},
        stages={stage: round(ms, 2) for stage, ms in estimate.timings_ms.items()},
        milliseconds=milliseconds,
        metric=estimate.metric,
    )


def _grid_of(frame: RgbdFrame, estimate: RoomEstimate, config: EstimatorConfig) -> FloorGrid | None:
    """Find the free space; None without depth or floor."""
    space = free_space_of_frame(frame, estimate, config)
    return None if space is None else FloorGrid(space.grid, space.resolution_m, space.origin_m)


def _cloud_of(frame: RgbdFrame, estimate: RoomEstimate) -> Cloud | None:
    """Points of the depth in the colours of the picture, or of the labels without one; None without depth."""
    if frame.depth_m is None:
        return None
    step = max(1, math.ceil(math.sqrt(frame.depth_m.size / MOST_POINTS)))
    depth = frame.depth_m[::step, ::step]
    seen = np.isfinite(depth) & (depth > 0)
    colors = LABEL_COLORS[estimate.labels] if frame.color is None else frame.color
    points = frame.camera.rays()[::step, ::step][seen] * depth[seen][:, None]
    return Cloud(points.astype(np.float32), colors[::step, ::step][seen])
