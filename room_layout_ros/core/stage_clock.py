"""Wall time of named stages."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class StageClock:
    """Runs stages by name and keeps their wall time in ms."""

    def __init__(self) -> None:
        self.timings_ms: dict[str, float] = {}

    def __call__(self, stage: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Return `function(*args, **kwargs)`; its time is booked under `stage`."""
        start = time.perf_counter_ns()
        value = function(*args, **kwargs)
        self.timings_ms[stage] = (time.perf_counter_ns() - start) * 1e-6
        return value
