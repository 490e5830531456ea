"""The node's deadline reaches the estimator (F32)."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="the node needs rclpy")

from room_layout_ros.node_config import NodeConfig
from room_layout_ros.stages import NodeStages


def asked(deadline_ms: float) -> list[Any]:
    """What the estimator is called with."""
    calls: list[Any] = []
    estimator = SimpleNamespace(estimate=lambda *arguments: calls.append(arguments))
    settings = SimpleNamespace(estimator=estimator, node=NodeConfig(deadline_ms=deadline_ms))
    NodeStages.estimate(None, "frame", None, settings)  # type: ignore[arg-type]
    return calls


def test_without_a_deadline_the_estimator_is_not_hurried() -> None:
    assert asked(0.0) == [("frame", None)]


def test_a_deadline_expires_after_its_time_and_not_before() -> None:
    (_, _, expired), *_ = asked(80.0)
    assert not expired()
    time.sleep(0.1)
    assert expired()
