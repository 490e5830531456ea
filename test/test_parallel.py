"""Work spread over processes: same results, same order, each once, whatever dies on the way."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from room_layout_ros.parallel import WorkerLostError, map_ordered


def square(x: int) -> int:
    return x * x


def die_once(folder: Path, x: int) -> int:
    """Kill the own process the first time that x is 5."""
    mark = folder / "died"
    if x == 5 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def die_at_five(x: int) -> int:
    if x == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def fail_at_five(x: int) -> int:
    if x == 5:
        raise KeyError("five")
    return x * x


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_order_and_progress_counts(jobs: int) -> None:
    counts: list[int] = []
    assert list(map_ordered(square, range(40), jobs, progress=counts.append)) == [x * x for x in range(40)]
    assert counts == list(range(1, 41))


def test_items_are_read_as_needed() -> None:
    read: list[int] = []

    def items() -> Iterator[int]:
        for i in range(1000):
            read.append(i)
            yield i

    results = map_ordered(square, items(), jobs=2)
    assert next(results) == 0
    assert len(read) < 20
    results.close()  # type: ignore[attr-defined]


def test_a_killed_worker_costs_no_result(tmp_path: Path) -> None:
    assert list(map_ordered(partial(die_once, tmp_path), range(20), jobs=2)) == [x * x for x in range(20)]
    assert (tmp_path / "died").exists()


def test_an_item_that_kills_every_worker_is_named_or_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("room_layout_ros.parallel.MAX_LOSSES", 1)
    with pytest.raises(WorkerLostError):
        list(map_ordered(die_at_five, range(8), jobs=2))
    expected = [-5 if x == 5 else x * x for x in range(8)]
    assert list(map_ordered(die_at_five, range(8), jobs=2, lost=lambda x: -x)) == expected


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_of_the_function_come_through(jobs: int) -> None:
    with pytest.raises(KeyError, match="five"):
        list(map_ordered(fail_at_five, range(8), jobs))


def test_no_workers_and_no_scheduler_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("room_layout_ros.parallel.CONNECT_TIMEOUT_S", 0.2)
    with pytest.raises(ValueError, match="jobs is 0"):
        list(map_ordered(square, [1], jobs=0))
    pytest.importorskip("distributed", reason="Dask is not installed (extra train)")
    with pytest.raises(ConnectionError, match="no Dask scheduler answers"):
        list(map_ordered(square, [1], scheduler="tcp://127.0.0.1:9"))


@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_gives_the_same_and_survives_a_worker(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra train)")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=60
    ) as cluster:
        address = cluster.scheduler_address
        got = list(map_ordered(partial(die_once, tmp_path), range(20), scheduler=address))
    assert got == [x * x for x in range(20)]
    assert (tmp_path / "died").exists()
