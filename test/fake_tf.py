"""Stands in for tf2_ros, which is not on PyPI: knows the poses that a test gives it, and from when to when."""

from __future__ import annotations

import sys
import types
from typing import Any

import pytest

from msg_adapters.header import encode_time


class FakeBuffer:
    """Answers as tf2 does: a static pose at any time, others only between the first and the last that came."""

    def __init__(self) -> None:
        self._poses: dict[tuple[str, str], dict[int, str]] = {}
        self.sent: list[Any] = []
        """What nodes broadcast."""

    def add(self, target: str, source: str, pose: str, stamp_ns: int = 0) -> None:
        """Take "x y z qx qy qz qw", which holds from `stamp_ns` on until the next; 0 is static."""
        self._poses.setdefault((target, source), {})[stamp_ns] = pose

    def lookup_transform(self, target: str, source: str, time: Any) -> Any:
        """Return the transform at a time, the newest at time 0."""
        poses, asked = self._poses[target, source], time.nanoseconds
        newest = max(poses)
        if asked and newest and not min(poses) <= asked <= newest:
            raise RuntimeError(f"extrapolation: {asked} is not within {min(poses)} and {newest}")
        stamp = max(t for t in poses if t <= asked) if asked else newest
        x, y, z, qx, qy, qz, qw = (float(word) for word in poses[stamp].split())
        return types.SimpleNamespace(
            header=types.SimpleNamespace(stamp=encode_time(stamp)),
            transform=types.SimpleNamespace(
                translation=types.SimpleNamespace(x=x, y=y, z=z),
                rotation=types.SimpleNamespace(x=qx, y=qy, z=qz, w=qw),
            ),
        )


def install(monkeypatch: pytest.MonkeyPatch) -> FakeBuffer:
    """Let nodes find a tf2_ros; return the buffer of all of them."""
    buffer, module = FakeBuffer(), types.ModuleType("tf2_ros")
    broadcaster = types.SimpleNamespace(sendTransform=buffer.sent.append)
    module.__dict__.update(
        Buffer=lambda: buffer,
        TransformListener=lambda buffer, node: (buffer, node),
        TransformBroadcaster=lambda node: broadcaster,
    )
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return buffer
