"""Findings -> diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Iterable

from room_layout_ros.runtime.diagnosis import Finding

from .header import encode_header
from .messages import DiagnosticArray, DiagnosticStatus, KeyValue


def encode_diagnostics(findings: Iterable[Finding], node_name: str, stamp_ns: int) -> DiagnosticArray:
    """Return one status per finding, named "<node>: <finding>"."""
    status = [
        DiagnosticStatus(
            level=bytes([finding.level]),
            name=f"{node_name}: {finding.name}",
            message=finding.message,
            hardware_id="",
            values=[KeyValue(key=key, value=value) for key, value in finding.values.items()],
        )
        for finding in findings
    ]
    return DiagnosticArray(header=encode_header(stamp_ns, ""), status=status)
