"""Stages beside others: in a thread where one is free, else with the one who asks."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from room_layout_ros.core.stage_clock import CORES, StageClock

WAIT_S = 20.0


@pytest.fixture
def busy() -> Iterator[threading.Event]:
    """No thread for stages is free until the event is set."""
    done = threading.Event()

    def block(begun: threading.Event) -> None:
        begun.set()
        done.wait(WAIT_S)

    with ExitStack() as stack:
        started = [threading.Event() for _ in range(max(CORES - 1, 1))]
        for one in started:
            stack.enter_context(StageClock().beside("block", block, one))
        stack.callback(done.set)
        assert all(one.wait(WAIT_S) for one in started)
        yield done


def test_a_stage_runs_in_another_thread_and_is_timed() -> None:
    clock = StageClock()
    begun = threading.Event()

    def where() -> int:
        begun.set()
        return threading.get_ident()

    with clock.beside("where", where) as found:
        assert begun.wait(WAIT_S)
        assert found() != threading.get_ident()
        assert found() == found()
    assert clock.timings_ms["where"] > 0


def test_who_asks_runs_the_stage_where_no_thread_is_free(busy: threading.Event) -> None:
    clock = StageClock()
    calls: list[int] = []
    with clock.beside("where", lambda: calls.append(threading.get_ident())) as found:
        found()
        found()
    assert calls == [threading.get_ident()]
    assert clock.timings_ms["where"] > 0


def test_what_nobody_asked_for_and_never_began_is_left_out(busy: threading.Event) -> None:
    calls: list[int] = []
    with StageClock().beside("extra", lambda: calls.append(1)):
        pass
    busy.set()
    for _ in range(2 * CORES):  # after these every stage that was queued before has been begun
        begun = threading.Event()
        with StageClock().beside("next", begun.set):
            assert begun.wait(WAIT_S)
    assert not calls


@pytest.mark.parametrize("free", [True, False])
def test_an_error_reaches_who_asks(free: bool, request: pytest.FixtureRequest) -> None:
    if not free:
        request.getfixturevalue("busy")
    with StageClock().beside("bad", lambda: 1 // 0) as found, pytest.raises(ZeroDivisionError):
        found()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_has_threads_of_its_own() -> None:
    with StageClock().beside("first", max, 1, 2) as found:
        assert found() == 2
    child = os.fork()
    if child == 0:
        begun = threading.Event()
        with StageClock().beside("second", begun.set):
            os._exit(0 if begun.wait(WAIT_S) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_the_block_ends_after_a_stage_that_runs() -> None:
    """What a stage works on may be gone after the block."""
    begun, go, ended = threading.Event(), threading.Event(), threading.Event()

    def work() -> None:
        begun.set()
        go.wait(WAIT_S)
        ended.set()

    with StageClock().beside("long", work):
        assert begun.wait(WAIT_S)
        go.set()
    assert ended.is_set()
