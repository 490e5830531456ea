"""The log has each fault when it turns up, every ten seconds while it lasts, and when it is over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from room_layout_ros.reporter import Reporter
from room_layout_ros.runtime.diagnosis import InputFacts, NodeFacts
from room_layout_ros.runtime.health import Health, StreamHealth
from room_layout_ros.runtime.pairing import COLOR

FACTS = NodeFacts(inputs={COLOR: InputFacts("/rgb", publishers=1, lost_on_way=True)}, listening_s=60.0)
FLOWING = Health(streams={COLOR: StreamHealth(received=300, paired=300, silence_s=0.0, usable_silence_s=0.0)})


class Log:
    """Stands in for the node's logger."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def warning(self, line: str) -> None:
        self.lines.append(line)

    info = warning


def with_lost(number: int) -> Health:
    return replace(FLOWING, streams={COLOR: replace(FLOWING.streams[COLOR], lost=number)})


def test_a_fault_that_lasts_is_one_line_in_ten_seconds_whatever_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    log, now = Log(), [100.0]
    monkeypatch.setattr("room_layout_ros.reporter.time.monotonic", lambda: now[0])
    reporter = Reporter(lambda _: None, log, "estimator", FLOWING)
    lost = 0
    for second in range(21):
        now[0] = 100.0 + second
        lost += 1 + second % 3
        reporter.report(with_lost(lost), FACTS, 0)
    assert [line.partition(";")[0] for line in log.lines] == [
        f"{n} colour messages lost on the way" for n in (1, 2, 3)
    ], "at 0, 10 and 20 s"
    reporter.report(with_lost(lost), FACTS, 0)
    assert log.lines[3:] == ["input colour: colour at 0.0 Hz"]


def test_a_fault_that_becomes_another_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    log = Log()
    monkeypatch.setattr("room_layout_ros.reporter.time.monotonic", lambda: 100.0)
    reporter = Reporter(lambda _: None, log, "estimator", FLOWING)
    silent = replace(FLOWING, streams={COLOR: replace(FLOWING.streams[COLOR], silence_s=7.0)})
    for health in (with_lost(3), silent, silent):
        reporter.report(health, FACTS, 0)
    assert [line[:10] for line in log.lines] == ["3 colour m", "no colour "]


def test_what_the_log_has_said_already_is_not_said_again() -> None:
    log: Any = Log()
    refused = replace(FLOWING.streams[COLOR], received=310, refused={"late": 10}, last_refusal="it is late")
    reporter = Reporter(lambda _: None, log, "estimator", FLOWING)
    reporter.report(replace(FLOWING, streams={COLOR: refused}), FACTS, 0)
    assert log.lines == []
