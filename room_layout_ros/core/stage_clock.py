"""Wall time of named stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
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

    @contextmanager
    def beside(
        self, stage: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
    ) -> Iterator[Callable[[], T]]:
        """Run a stage in a second thread while the block runs; yields what waits for its value.

        Kernels and OpenCV give the lock free, so an independent stage costs no time where a second core is idle.
        """
        self.timings_ms[stage] = 0.0  # keeps the stages in order of their start
        with ThreadPoolExecutor(1, thread_name_prefix=stage) as pool:
            yield pool.submit(lambda: self(stage, function, *args, **kwargs)).result
