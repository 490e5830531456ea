"""Diagnostics: on the topic once a second, in the log when something turns up, lasts, or is over."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msg_adapters.encode_diagnostics import encode_diagnostics

from .runtime.diagnosis import Finding, Level, NodeFacts, diagnose
from .runtime.health import Health

_REPEAT_S = 10.0


class Reporter:
    """Compares each snapshot of the counters with the one before and says what is wrong.

    Parameters
    ----------
    publish : callable
        Sends a diagnostic_msgs/DiagnosticArray.
    logger : rclpy logger
    name : str
        Of the node, as it stands in the diagnostics.
    health : Health
        Counters at the start.
    """

    def __init__(self, publish: Callable[[Any], None], logger: Any, name: str, health: Health) -> None:
        self._publish, self._logger, self._name = publish, logger, name
        self._before = health
        self._told: dict[str, tuple[str, float]] = {}

    def report(self, health: Health, facts: NodeFacts, stamp_ns: int) -> None:
        """Publish the findings and log what is new."""
        findings = diagnose(health, self._before, facts)
        self._before = health
        self._publish(encode_diagnostics(findings, self._name, stamp_ns))
        for finding in findings:
            self._tell(finding)

    def _tell(self, finding: Finding) -> None:
        """Log a finding when it turns up, every ten seconds while it lasts, and when it is over."""
        kind = finding.kind if finding.level >= Level.WARN else ""
        before, at = self._told.get(finding.name, ("", 0.0))
        now = time.monotonic()
        if kind and not finding.logged and (kind != before or now - at >= _REPEAT_S):
            self._logger.warning(finding.message)
            self._told[finding.name] = (kind, now)
        elif not kind and before:
            over = f"{finding.name}: {finding.message}"
            self._logger.info(over)
            self._told.pop(finding.name)


def dds_profile() -> Path:
    """Return the shipped Fast DDS profile, in the source tree or where pip or colcon put it."""
    here = Path(__file__).resolve()
    installed = [p / "share" / "room_layout_ros" for p in here.parents]
    for folder in (here.parent.parent, *installed):
        if (folder / "config" / "fastdds.xml").is_file():
            return folder / "config" / "fastdds.xml"
    return Path("config/fastdds.xml")
