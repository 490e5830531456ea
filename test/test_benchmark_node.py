"""The benchmark of the node runs, and finds counts that do not add up."""

from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
pytest.importorskip("rosbags", reason="rosbags is not installed (pip: extra playback)")

from benchmarks.node import Run, measure, show

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def run() -> Run:
    return measure(2.0, None)


def test_every_frame_of_two_seconds_is_accounted_for(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run.sent == 60
    assert run.faults() == []
    assert show(run, 2.0, "rendered") == 0
    said = capsys.readouterr().out
    assert "results/s" in said
    assert "counts add up" in said


def test_ages_are_from_the_stamp_to_the_arrival_of_the_last_output(run: Run) -> None:
    labels, every = run.ages_ms("labels"), run.ages_ms(*run.arrivals_ns)
    assert labels.size == int(run.pairs["published"]) > 0
    assert (labels > 0).all()
    assert every.size == labels.size
    assert (every >= labels).all()


def test_a_frame_that_vanishes_is_found(run: Run) -> None:
    assert replace(run, sent=run.sent + 10).faults()
    assert replace(run, arrivals_ns={**run.arrivals_ns, "labels": run.arrivals_ns["labels"][1:]}).faults()
    lossy = {**run.facts, "estimates": {**run.pairs, "pairs": str(int(run.pairs["pairs"]) + 1)}}
    assert replace(run, facts=lossy).faults()
