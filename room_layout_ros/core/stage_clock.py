"""Wall time of named stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_THREADS = ThreadPoolExecutor(8, thread_name_prefix="room-layout-stage")
"""For the stages beside others, of all frames in flight; a stage never waits for another one in it. Kept, because every
tenth new thread starts milliseconds late: its maker holds the interpreter's lock."""


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
        running = _THREADS.submit(lambda: self(stage, function, *args, **kwargs))
        try:
            yield running.result
        finally:
            wait([running])
