"""The worker's loop: the newest job, and a newer one where that is due sooner than the last is old."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from room_layout_ros.runtime.live_loop import LiveLoop

PERIOD_S = 1.0 / 30.0
PATIENCE_S = 10.0
"""A thread that gets no answer for so long has failed."""


class Workshop:
    """A loop whose clock stands where it is put, and whose worker waits at a gate."""

    def __init__(self) -> None:
        self.now = 0.0
        self.done: list[int] = []
        self.dropped: list[tuple[int, str]] = []
        self.gate, self.inside, self.finished = threading.Event(), threading.Event(), threading.Semaphore(0)
        self.loop: LiveLoop[int] = LiveLoop(lambda: None, self.work, self.drop, lambda: self.now)

    def work(self, job: int) -> None:
        self.inside.set()
        assert self.gate.wait(PATIENCE_S)
        self.done.append(job)
        self.finished.release()

    def drop(self, job: int, reason: str) -> None:
        self.dropped.append((job, reason))

    def send(self, *jobs: int) -> None:
        for job in jobs:
            self.now = job * PERIOD_S
            self.loop.submit(job)

    def work_until(self, now: float, *jobs: int) -> None:
        """Work on job 0 while `jobs` come, and be done with it at `now` periods."""
        self.send(0)
        assert self.inside.wait(PATIENCE_S)
        self.send(*jobs)
        self.now = now * PERIOD_S
        self.gate.set()

    def until_finished(self, number: int) -> None:
        for _ in range(number):
            assert self.finished.acquire(timeout=PATIENCE_S)


@pytest.fixture
def workshop() -> Iterator[Workshop]:
    workshop = Workshop()
    yield workshop
    workshop.gate.set()
    assert workshop.loop.close(PATIENCE_S)


def test_an_old_job_gives_way_to_the_one_that_is_due(workshop: Workshop) -> None:
    workshop.work_until(9.8, *range(1, 10))
    workshop.until_finished(1)
    workshop.send(10)
    workshop.until_finished(1)
    assert workshop.done == [0, 10]
    assert workshop.dropped == [(job, "newer frame") for job in range(1, 10)]


@pytest.mark.parametrize("age", [0.2, 0.8, 5.0], ids=["new", "old, and none comes", "old, and none is due"])
def test_the_last_job_is_done_whatever_its_age(workshop: Workshop, age: float) -> None:
    workshop.work_until(9.0 + age, *range(1, 10))
    workshop.until_finished(2)
    assert workshop.done == [0, 9]


def test_a_job_is_not_old_before_the_rhythm_is_known(workshop: Workshop) -> None:
    workshop.work_until(2.9, 1, 2)
    workshop.until_finished(2)
    assert workshop.done == [0, 2]


def test_the_end_does_not_wait_for_a_newer_job(workshop: Workshop) -> None:
    workshop.work_until(9.8, *range(1, 10))
    workshop.until_finished(1)
    assert workshop.loop.close(PATIENCE_S)
    assert len(workshop.done) + len(workshop.dropped) == 10
    assert workshop.done[:1] == [0]
