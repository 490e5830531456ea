"""Transforms between frames from TF, where tf2 is installed. It is optional: without it nothing here is found."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .node_config import parse_pose


class Transforms:
    """Looks up the newest transform between two frames; knows none where tf2_ros is not installed.

    Parameters
    ----------
    node : rclpy node
        Gets subscriptions of /tf and /tf_static, only when `listen` is called.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._buffer: Any = None
        self._listener: Any = None
        self._broadcaster: Any = None

    def listen(self) -> bool:
        """Subscribe to TF; return False where tf2 is not installed."""
        if self._buffer is None:
            try:
                from tf2_ros import Buffer, TransformListener
            except ImportError:
                return False
            self._buffer = Buffer()
            self._listener = TransformListener(self._buffer, self._node)
        return True

    def find(self, target: str, source: str) -> NDArray[np.float64] | None:
        """Return the (4, 4) transform that takes points of `source` to `target`; None where it is not known."""
        if self._buffer is None or not target or not source:
            return None
        from rclpy.time import Time

        try:
            found = self._buffer.lookup_transform(target, source, Time())
        except Exception:  # noqa: BLE001  tf2 has an exception for each way of not knowing; all mean the same here
            return None
        t, q = found.transform.translation, found.transform.rotation
        return parse_pose(f"{t.x} {t.y} {t.z} {q.x} {q.y} {q.z} {q.w}")

    def broadcast(self, transform: Any) -> bool:
        """Send a geometry_msgs/TransformStamped on /tf; return False where tf2 is not installed."""
        if self._broadcaster is None:
            try:
                from tf2_ros import TransformBroadcaster
            except ImportError:
                return False
            self._broadcaster = TransformBroadcaster(self._node)
        self._broadcaster.sendTransform(transform)
        return True
