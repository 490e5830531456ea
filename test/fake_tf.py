"""Stands in for tf2_ros, which is not on PyPI: knows the poses that a test gives it, and from when to when."""

from __future__ import annotations

import sys
import types
from typing import Any

import pytest

from msg_adapters.header import encode_time
from msg_adapters.stamp import NS_PER_S

CACHE_NS = 10 * NS_PER_S
"""As long as tf2's buffer keeps a transform by default."""


class FakeBuffer:
    """Answers as tf2 does: a static pose at any time, others only between the first and the last that came.

    As in tf2 (cache.cpp) a pose is ignored that is older than the newest of its frame by more than the cache time, and
    `clear` drops all but the static poses (StaticCache::clearList does nothing).
    """

    def __init__(self) -> None:
        self._static: dict[tuple[str, str], Any] = {}
        self._moving: dict[tuple[str, str], dict[int, Any]] = {}
        self._listening: Any = self
        self.sent: list[Any] = []
        """What nodes broadcast."""
        self.cleared = 0

    def listen(self, buffer: Any, _node: Any = None) -> None:
        """Hand what comes from now on to what a node gave its TransformListener."""
        self._listening = buffer

    def add(self, target: str, source: str, pose: str, stamp_ns: int = 0) -> None:
        """Publish "x y z qx qy qz qw", which holds from `stamp_ns` on until the next; 0 is static."""
        x, y, z, qx, qy, qz, qw = (float(word) for word in pose.split())
        message = types.SimpleNamespace(
            header=types.SimpleNamespace(stamp=encode_time(stamp_ns), frame_id=target),
            child_frame_id=source,
            transform=types.SimpleNamespace(
                translation=types.SimpleNamespace(x=x, y=y, z=z),
                rotation=types.SimpleNamespace(x=qx, y=qy, z=qz, w=qw),
            ),
        )
        take = self._listening.set_transform if stamp_ns else self._listening.set_transform_static
        take(message, "default_authority")

    def set_transform(self, message: Any, _authority: str) -> None:
        """Take a pose that moves, unless it is too old."""
        poses = self._moving.setdefault((message.header.frame_id, message.child_frame_id), {})
        stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
        oldest = max(poses, default=0) - CACHE_NS
        for gone in [t for t in poses if t < oldest]:
            del poses[gone]
        if stamp_ns >= oldest:
            poses[stamp_ns] = message

    def set_transform_static(self, message: Any, _authority: str) -> None:
        """Take a pose that holds at all times."""
        self._static[message.header.frame_id, message.child_frame_id] = message

    def clear(self) -> None:
        """Forget all poses that move."""
        self.cleared += 1
        for poses in self._moving.values():
            poses.clear()

    def lookup_transform(self, target: str, source: str, time: Any) -> Any:
        """Return the transform at a time, the newest at time 0."""
        if (target, source) in self._static:
            return self._static[target, source]
        poses, asked = self._moving[target, source], time.nanoseconds
        if not poses or (asked and not min(poses) <= asked <= max(poses)):
            raise RuntimeError(f"extrapolation: {asked} is not within those of {sorted(poses)}")
        return poses[max(t for t in poses if t <= asked) if asked else max(poses)]


def install(monkeypatch: pytest.MonkeyPatch) -> FakeBuffer:
    """Let nodes find a tf2_ros; return the buffer of all of them."""
    buffer, module = FakeBuffer(), types.ModuleType("tf2_ros")
    broadcaster = types.SimpleNamespace(sendTransform=buffer.sent.append)
    module.__dict__.update(
        Buffer=lambda: buffer,
        TransformListener=buffer.listen,
        TransformBroadcaster=lambda node: broadcaster,
    )
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return buffer
