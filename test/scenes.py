"""Rooms and views whose truth is known exactly, and what every estimate must hold, for the tests of the core."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.labels import CLUTTER, LABEL_COLORS, N_FACES
from room_layout_ros.core.layout import RoomCuboid

SMALL = CameraIntrinsics(160, 120, 131.25, 131.25, 79.5, 59.5)
TINY = CameraIntrinsics(40, 30, 33.0, 34.0, 18.2, 15.7)
HALF = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
ROOM = np.array([1.2, 1.3, 1.8, 3.5, 2.2])
"""Distances of ceiling, floor, left, front, right in m."""


def look(yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> NDArray[np.float64]:
    """Return R_room_camera of a camera turned right, then nodding down, then tilted."""
    a, b, c = np.deg2rad([yaw_deg, pitch_deg, roll_deg])
    yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(b), np.sin(b)], [0, -np.sin(b), np.cos(b)]])
    roll = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return np.asarray(yaw @ pitch @ roll)


def seen_from_inside(
    camera: CameraIntrinsics = SMALL, R: NDArray[np.float64] | None = None, distances: NDArray[np.float64] = ROOM
) -> tuple[RgbdFrame, RoomCuboid]:
    """Return a frame of an empty room, each face in its own colour, and the room."""
    room = RoomCuboid(look(20.0, 8.0, 1.5) if R is None else R, distances)
    return RgbdFrame(camera, LABEL_COLORS[room.raster(camera)], room.depth(camera)), room


def check(estimate: RoomEstimate, frame: RgbdFrame) -> None:
    """What every answer holds, whatever was asked."""
    size = (frame.camera.height, frame.camera.width)
    for image in (estimate.layout, estimate.labels, estimate.furniture):
        assert image.shape == size
        assert image.dtype == np.uint8
    assert estimate.superpixels.shape == size
    assert 0.0 <= estimate.confidence <= 1.0
    assert 0.0 <= estimate.axes_confidence <= 1.0 + 1e-9
    assert estimate.face_confidence.shape == (N_FACES,)
    assert ((estimate.face_confidence >= 0) & (estimate.face_confidence <= 1)).all()
    assert (estimate.stamp_ns, estimate.frame_id, estimate.name) == (frame.stamp_ns, frame.frame_id, frame.name)
    np.testing.assert_allclose(estimate.R_room_camera @ estimate.R_room_camera.T, np.eye(3), atol=1e-9)
    if estimate.cuboid is None:
        assert estimate.status in (Status.NO_DEPTH, Status.NO_ROOM)
        assert not estimate.layout.any()
        assert not estimate.labels.any()
        assert estimate.confidence == 0.0
        assert not estimate.face_confidence.any()
        assert estimate.polygons == ()
        return
    np.testing.assert_array_equal(estimate.layout, estimate.cuboid.raster(frame.camera))
    if estimate.signs is not None:  # the baseline labels whole superpixels, across the edges of the room
        assert ((estimate.labels == CLUTTER) | (estimate.labels == estimate.layout)).all()
    in_view = set(np.unique(estimate.layout).tolist()) - {0}
    assert {k + 1 for k in np.flatnonzero(estimate.face_confidence)} <= in_view
    assert in_view <= {polygon.face for polygon in estimate.polygons}


def ask(estimator: LayoutEstimator, frame: RgbdFrame) -> RoomEstimate:
    """Estimate with warnings as errors, and check what always holds."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate = estimator.estimate(frame)
    check(estimate, frame)
    return estimate
