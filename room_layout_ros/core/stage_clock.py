"""Wall time of named stages, and stages beside others where a core is free for them."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""That this process may run on, when it starts."""


def _make_threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(CORES - 1, 1), thread_name_prefix="room-layout-stage")


_threads = _make_threads()
"""For the stages beside others, of all frames in flight: one fewer than cores, for the makers of stages work too. More
threads than cores would wait for each other, milliseconds at a time, and the ones that others wait for as well. Kept,
because every tenth new thread starts milliseconds late: its maker holds the interpreter's lock."""


def _begin_anew() -> None:
    """Make threads in a forked process: it has none."""
    global _threads
    _threads = _make_threads()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


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

        Kernels and OpenCV give the lock free, so an independent stage costs no time where a core is idle. Where none is
        before the value is asked for, the one who asks runs the stage: no stage waits for one that has not begun. What
        never began and nobody asked for is left out at the end of the block; asked for later, it is run then.
        """
        self.timings_ms[stage] = 0.0  # keeps the stages in order of their start
        running = _threads.submit(lambda: self(stage, function, *args, **kwargs))
        own: list[T] = []

        def value() -> T:
            if not own and running.cancel():
                own.append(self(stage, function, *args, **kwargs))
            return own[0] if own else running.result()

        try:
            yield value
        finally:
            if not running.cancel():
                wait([running])
