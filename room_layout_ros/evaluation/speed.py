"""How long an estimate takes: milliseconds per stage, frames per second. Of this machine, under its load."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.tracking import TemporalPrior, next_prior

IN_FLIGHT = 2
WHOLE, PROCESSOR = "whole frame", "whole frame, CPU time"
_WARM_UP = 2


@dataclass(frozen=True, slots=True)
class Speed:
    """What was measured on a list of frames.

    Attributes
    ----------
    stages_ms : milliseconds of each frame by stage, in their order, then of the whole frame and its CPU time.
    frames_per_second : by the way of working: alone, several in flight, with warm starts.
    """

    stages_ms: Mapping[str, Sequence[float]]
    frames_per_second: Mapping[str, float]


def measure_speed(frames: Sequence[RgbdFrame], estimator: LayoutEstimator) -> Speed:
    """Estimate the frames four times: once to time each stage, and once for each way of working.

    Parameters
    ----------
    frames : RgbdFrame
        At least one; each stands alone, but for the warm starts.
    estimator : LayoutEstimator
    """
    for frame in frames[:_WARM_UP]:  # kernels are compiled or loaded at their first call
        estimator.estimate(frame)
    stages: dict[str, list[float]] = {}
    whole: list[float] = []
    processor: list[float] = []
    for frame in frames:
        start, start_cpu = time.perf_counter(), time.process_time()
        timings = estimator.estimate(frame).timings_ms
        whole.append(1e3 * (time.perf_counter() - start))
        processor.append(1e3 * (time.process_time() - start_cpu))
        for stage, milliseconds in timings.items():
            stages.setdefault(stage, []).append(milliseconds)
    with ThreadPoolExecutor(IN_FLIGHT) as pool:
        ways: dict[str, Callable[[], object]] = {
            "alone": lambda: [estimator.estimate(frame) for frame in frames],
            f"{IN_FLIGHT} in flight": lambda: list(pool.map(estimator.estimate, frames)),
            "with warm starts": lambda: _in_sequence(estimator, frames),
        }
        rates = {name: len(frames) / _seconds(work) for name, work in ways.items()}
    return Speed({**stages, WHOLE: whole, PROCESSOR: processor}, rates)


def describe_machine() -> str:
    """Return a line on what the figures are of; the load, because figures under load are of the load."""
    cores, load = os.cpu_count(), os.getloadavg()[0]
    return f"{platform.machine()}, {cores} cores, load {load:.1f}, Python {platform.python_version()}"


def describe_speed(speed: Speed) -> str:
    """Return the figures as a table."""
    lines = [f"{'stage, ms':<22}{'min':>8}{'p50':>8}{'p95':>8}{'max':>8}"]
    for stage, taken in speed.stages_ms.items():
        lines.append(f"{stage:<22}" + "".join(f"{value:>8.2f}" for value in np.percentile(taken, [0, 50, 95, 100])))
    rates = ", ".join(f"{rate:.1f} {way}" for way, rate in speed.frames_per_second.items())
    return "\n".join([*lines, f"frames/s: {rates}"])


def _in_sequence(estimator: LayoutEstimator, frames: Sequence[RgbdFrame]) -> None:
    prior = TemporalPrior()
    for frame in frames:
        prior = next_prior(estimator.estimate(frame, prior))


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
