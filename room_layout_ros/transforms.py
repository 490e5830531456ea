"""Transforms between frames from TF, where tf2 is installed. It is optional: without it nothing here is found."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.stamp import NS_PER_S

from .node_config import parse_pose

_BACK_NS = NS_PER_S
"""Stamps that step back by more than this are of a bag that starts over or a simulation that is reset."""


class Transforms:
    """Looks up transforms between two frames at a time; knows none where tf2_ros is not installed.

    May be called from several threads.

    Parameters
    ----------
    node : rclpy node
        Gets subscriptions of /tf and /tf_static, only when `listen` is called.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._buffer: Any = None
        self._intake: _Intake | None = None
        self._listener: Any = None
        self._broadcaster: Any = None
        self._lock = threading.Lock()
        self._notes: dict[tuple[str, str], tuple[int, float]] = {}

    def listen(self) -> bool:
        """Subscribe to TF; return False where tf2 is not installed."""
        if self._buffer is None:
            try:
                from tf2_ros import Buffer, TransformListener
            except ImportError:
                return False
            self._buffer = Buffer()  # given the node it would clear itself, but the callback that does so raises
            self._intake = _Intake(self._buffer)
            self._listener = TransformListener(self._intake, self._node)
        return True

    def find(self, target: str, source: str, stamp_ns: int) -> NDArray[np.float64] | None:
        """Return the (4, 4) transform that takes points of `source` to `target`; None where it is not known.

        It is that of `stamp_ns`. Where TF does not know that time (a robot's transforms may come later than its
        images) it is the newest, and `said` tells.
        """
        if self._intake is None or not target or not source:
            return None
        self._intake.follow(stamp_ns)
        found = self._at(target, source, stamp_ns)
        if found is None:
            found = self._at(target, source, 0)
            if found is None:
                return None
            self._note(target, source, (stamp_ns - _stamp_ns(found)) * 1e-9)
        t, q = found.transform.translation, found.transform.rotation
        return parse_pose(f"{t.x} {t.y} {t.z} {q.x} {q.y} {q.z} {q.w}")

    def said(self) -> str:
        """Say which transforms were not known at the time of a frame, for the diagnostics; "" where none."""
        with self._lock:
            notes = sorted(self._notes.items())
        return "; ".join(
            f"{source} to {target}: {count} times not known at the frame's time, the newest was used "
            f"(last {abs(late_s):.3f} s {'older' if late_s > 0 else 'younger'})"
            for (target, source), (count, late_s) in notes
        )

    def reset(self) -> None:
        """Forget what was said."""
        with self._lock:
            self._notes.clear()

    def clear(self) -> None:
        """Forget all transforms but the static ones: time starts over."""
        if self._intake is not None:
            self._intake.clear()

    def _note(self, target: str, source: str, late_s: float) -> None:
        with self._lock:
            count = self._notes.get((target, source), (0, 0.0))[0]
            self._notes[target, source] = (count + 1, late_s)

    def _at(self, target: str, source: str, stamp_ns: int) -> Any:
        from rclpy.time import Time

        try:
            return self._buffer.lookup_transform(target, source, Time(nanoseconds=stamp_ns))
        except Exception:  # noqa: BLE001  tf2 has an exception for each way of not knowing; all mean the same here
            return None

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


class _Intake:
    """Stands between /tf and tf2's buffer, and clears it when stamps step back.

    The buffer ignores what is older than the newest transform of its frame by more than it keeps (10 s): from the
    second loop of a longer bag on, all that moves would stand where the bag ends. What is static outlives the
    clearing (geometry2, tf2/src/static_cache.cpp). May be called from several threads.
    """

    def __init__(self, buffer: Any) -> None:
        self._buffer = buffer
        self._lock = threading.Lock()
        self._newest: dict[str, int] = {}
        self._frame_ns = 0

    def set_transform(self, transform: Any, authority: str) -> None:
        """Take a transform of /tf. Each frame has stamps of its own: some are sent late, some ahead of time."""
        stamp_ns, frame = _stamp_ns(transform), transform.child_frame_id
        with self._lock:
            if stamp_ns < self._newest.get(frame, 0) - _BACK_NS:
                self._clear()
            self._newest[frame] = max(stamp_ns, self._newest.get(frame, 0))
            self._buffer.set_transform(transform, authority)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Take a transform of /tf_static."""
        self._buffer.set_transform_static(transform, authority)

    def follow(self, stamp_ns: int) -> None:
        """Take the stamp of an image: the first of a loop may come before the transforms of its time."""
        with self._lock:
            back = stamp_ns < self._frame_ns - _BACK_NS
            self._frame_ns = stamp_ns
            if back and max(self._newest.values(), default=0) > stamp_ns + _BACK_NS:
                self._clear()

    def clear(self) -> None:
        """Forget all but what is static."""
        with self._lock:
            self._clear()

    def _clear(self) -> None:
        self._newest.clear()
        self._buffer.clear()


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * NS_PER_S + int(message.header.stamp.nanosec)
