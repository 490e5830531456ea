"""One worker thread that always works on the newest job; what it could not get to is handed back as dropped.

Callbacks stay cheap that way. A callback that itself worked 60 ms made its input 150-290 ms old; the same work in
this thread 19 ms (measured at 30 Hz).

Where the work takes longer than the time between two jobs, the newest one may be old by nearly that time when the
worker comes to it. One that is older than half of it gives way to the next, which is due sooner than it is old.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Job = TypeVar("Job")

_PERIODS = 8
"""The time between jobs is the mean of so many."""

_OLD, _OVERDUE = 0.5, 1.25
"""Of the time between jobs: from the first on a job is old; after the second the next one is not waited for."""

_LONGEST_WAIT_S = 0.1


class LiveLoop(Generic[Job]):
    """Runs `work(job)` for the newest job; none of the functions may raise.

    Parameters
    ----------
    prepare : callable
        Runs in the worker thread before anything else; then the event `ready` is set.
    work : callable
        Runs in the worker thread.
    drop : callable
        Told each job that a newer one replaced ("newer frame") or that the end left over ("shutdown").
    clock : callable
        Monotonic seconds.
    """

    def __init__(
        self,
        prepare: Callable[[], None],
        work: Callable[[Job], None],
        drop: Callable[[Job, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._prepare, self._work, self._drop, self._clock = prepare, work, drop, clock
        self._arrivals: deque[float] = deque(maxlen=_PERIODS + 1)
        self.ready = threading.Event()
        self._wake = threading.Condition()
        self._next: Job | None = None
        self._closed = False
        # A daemon, because a kernel that compiles cannot be interrupted and must not hold up the end of the process.
        self._thread = threading.Thread(target=self._run, name="estimator-worker", daemon=True)
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Make `job` the next one; returns at once."""
        with self._wake:
            closed, left = self._closed, self._next
            if not closed:
                self._next = job
                self._arrivals.append(self._clock())
                self._wake.notify()
        if closed:
            self._drop(job, "shutdown")
        elif left is not None:
            self._drop(left, "newer frame")

    def discard(self, reason: str) -> None:
        """Drop the job that waits, if any."""
        with self._wake:
            left, self._next = self._next, None
        if left is not None:
            self._drop(left, reason)

    def close(self, timeout_s: float) -> bool:
        """End the thread after the job in hand; return False if it is still at it after `timeout_s`."""
        with self._wake:
            self._closed = True
            left, self._next = self._next, None
            self._wake.notify()
        if left is not None:
            self._drop(left, "shutdown")
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        self._prepare()
        self.ready.set()
        while True:
            job = self._take()
            if job is None:
                return
            self._work(job)

    def _take(self) -> Job | None:
        """Wait for a job; None at the end."""
        with self._wake:
            while not self._closed:
                job = self._next
                if job is None:
                    self._wake.wait()
                elif not self._newer_comes(job):
                    self._next = None
                    return job
            return None

    def _newer_comes(self, job: Job) -> bool:
        """Wait for a newer job than an old one, where one is due; True also at the end."""
        patience_s = self._patience_s()
        return patience_s > 0.0 and self._wake.wait_for(lambda: self._closed or self._next is not job, patience_s)

    def _patience_s(self) -> float:
        """Return how long to wait for a newer job than the last; 0 where that is new enough or the next not due."""
        if len(self._arrivals) <= _PERIODS:
            return 0.0
        period = (self._arrivals[-1] - self._arrivals[0]) / _PERIODS
        age = self._clock() - self._arrivals[-1]
        return min(_OVERDUE * period - age, _LONGEST_WAIT_S) if age > _OLD * period else 0.0
