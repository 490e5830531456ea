"""What is measured of the speed: every stage of every frame, and all frames in each way of working."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path

import pytest
from frames_on_disk import write_folder
from scenes import SMALL, seen_from_inside

from room_layout_ros.cli import main
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.datasets import Sample
from room_layout_ros.evaluation.speed import PROCESSOR, WHOLE, describe_speed, measure_speed


def test_every_stage_of_every_frame_is_in_the_table() -> None:
    frames = [seen_from_inside(SMALL)[0]] * 5
    speed = measure_speed(frames, LayoutEstimator())
    timed = LayoutEstimator().estimate(frames[0]).timings_ms
    assert list(speed.stages_ms) == [*timed, WHOLE, PROCESSOR]
    assert {len(values) for values in speed.stages_ms.values()} == {5}
    assert all(rate > 0 for rate in speed.frames_per_second.values())
    text = describe_speed(speed)
    assert all(stage in text for stage in timed)


def test_a_slower_estimator_is_measured_as_slower(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, estimator = [seen_from_inside(SMALL)[0]] * 3, LayoutEstimator()
    estimate = LayoutEstimator.estimate

    def slowed(self: LayoutEstimator, *arguments: object) -> RoomEstimate:
        time.sleep(0.3)
        return estimate(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(LayoutEstimator, "estimate", slowed)
    speed = measure_speed(frames, estimator)
    assert min(speed.stages_ms[WHOLE]) >= 300
    assert speed.frames_per_second["alone"] < 1 / 0.3
    assert speed.frames_per_second["2 in flight"] > 1.1 * speed.frames_per_second["alone"], "sleeps beside each other"


@pytest.mark.parametrize("words", ([], ["--rgb-only"]))
def test_bench_measures_the_frames_it_is_given(
    tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    frame, _ = seen_from_inside(SMALL)
    samples = [Sample(replace(frame, name=f"{i}", stamp_ns=i)) for i in range(1, 5)]
    folder = write_folder(tmp_path / "frames", samples)
    assert main(["bench", str(folder), "--frames", "3", *words]) == 0
    told = capsys.readouterr().out
    assert "3 frames of 160x120" in told
    rows = {line.split("  ")[0] for line in told.splitlines() if re.search(r"( +\d+\.\d\d){4}$", line)}
    assert {"superpixels", "joint", "refinement", WHOLE, PROCESSOR} <= rows
    assert "frames/s:" in told


def test_bench_without_frames_measures_rendered_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--frames", "2"]) == 0
    assert "2 frames of 640x480" in capsys.readouterr().out


@pytest.mark.parametrize("words", (["--frames", "0"], ["MISSING"], ["--set", "nonsense"]))
def test_bad_arguments_are_one_sentence_and_exit_code_2(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
