"""Learning spread over processes: the same weights, bit for bit, whoever dies on the way."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from local_separator import LocalSeparator
from numpy.typing import NDArray

from room_layout_ros.learning.oracle import Separation, SpreadSeparator
from room_layout_ros.learning.structured_svm import SvmConfig, SvmResult, learn_one_slack
from room_layout_ros.parallel import open_workers

N, CLASSES, FEATURES = 60, 3, 4
CONFIG = SvmConfig(10.0, 1e-3)


def example(index: int) -> tuple[NDArray[np.float64], int]:
    """Points of three classes, made where they are needed: nothing but indices and weights travels."""
    rng = np.random.default_rng(index)
    y = index % CLASSES
    return rng.normal(np.eye(CLASSES, FEATURES)[y] * 2.0, 1.0), y


def oracle(weights: NDArray[np.float64], point: tuple[NDArray[np.float64], int]) -> Separation:
    x, y = point
    loss = (np.arange(CLASSES) != y).astype(float)
    worst = int(np.argmax(loss + weights.reshape(CLASSES, FEATURES) @ x))
    difference = np.zeros((CLASSES, FEATURES))
    difference[worst] -= x
    difference[y] += x
    return Separation(difference.ravel(), float(loss[worst]))


def answer(folder: Path, weights: NDArray[np.float64], indices: Sequence[int]) -> list[Separation]:
    """Answer a chunk; the worker that gets example 30 in a later round kills itself, once."""
    (folder / f"worker_{os.getpid()}").touch()
    if 30 in indices and np.any(weights) and not (folder / "died").exists():
        (folder / "died").write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.02)  # long enough that every worker gets its share
    return [oracle(weights, example(i)) for i in indices]


@pytest.fixture(scope="module")
def alone() -> SvmResult:
    return learn_one_slack(LocalSeparator(oracle, [example(i) for i in range(N)]), np.zeros(12), CONFIG)


def learn(folder: Path, jobs: int, scheduler: str | None) -> SvmResult:
    with open_workers(jobs, scheduler) as spread:
        separator = SpreadSeparator(partial(answer, folder), range(N), spread, "points of three classes", chunk=5)
        return learn_one_slack(separator, np.zeros(12), CONFIG)


def assert_survived(folder: Path, result: SvmResult, alone: SvmResult) -> None:
    dead = int((folder / "died").read_text())
    workers = {int(p.name.split("_")[1]) for p in folder.glob("worker_*")}
    assert dead in workers, "the worker that died had taken part"
    assert len(workers) >= 3, "the others went on, and the dead one was replaced or not needed"
    assert os.getpid() not in workers
    assert len(result.history) == len(alone.history)
    np.testing.assert_array_equal(result.weights, alone.weights)


def test_local_processes_learn_the_same_though_one_dies(tmp_path: Path, alone: SvmResult) -> None:
    pytest.importorskip("joblib", reason="joblib is in the extra train")
    assert_survived(tmp_path, learn(tmp_path, 2, None), alone)


@pytest.fixture
def scheduler() -> Iterator[str]:
    """Address of a cluster of three worker processes with nannies, as on three machines."""
    distributed = pytest.importorskip("distributed", reason="Dask is in the extra train")
    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_cluster_learns_the_same_though_a_worker_dies(tmp_path: Path, scheduler: str, alone: SvmResult) -> None:
    assert_survived(tmp_path, learn(tmp_path, 1, scheduler), alone)
