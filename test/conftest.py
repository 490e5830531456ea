"""What every test may rely on: one thread, one random state, real data or a reason why not, a ROS domain of its own."""

from __future__ import annotations

import gc
import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

# Before numba, OpenCV or rclpy is imported, here and in the processes that tests start.
os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # kernels are one-threaded; a pool would only steal the second core
os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # runs side by side stay apart; 101 is the last
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_LOG_DIR", str(Path(tempfile.gettempdir()) / f"room_layout_ros_log.{os.getuid()}"))

import cv2
import numpy as np
import pytest

from room_layout_ros.evaluation import measures

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder with nyuv2/ and corridor/: ROOM_LAYOUT_DATA, else ../shared/data beside the repository."""
    root = Path(os.environ.get("ROOM_LAYOUT_DATA", REPOSITORY.parent / "shared" / "data"))
    if not (root / "nyuv2").is_dir():
        pytest.skip(f"no real data: {root} has no folder nyuv2 (set ROOM_LAYOUT_DATA)")
    return root.resolve()


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers, the same in every run."""
    return np.random.default_rng(20131)


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Intervals of 50 draws instead of 1000, for tests of what else an evaluation tells: half of its time."""
    monkeypatch.setattr(measures, "bootstrap_interval", partial(measures.bootstrap_interval, draws=50))


@pytest.fixture(autouse=True, scope="session")
def _one_opencv_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def pytest_collection_finish() -> None:
    """Leave the modules and tests that are loaded out of every further search for garbage: 2 % of the CPU time."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark users of `data_root` as data; skip dds where no rclpy is; leave fuzz and soak to those who ask for them."""
    no_ros = pytest.mark.skip(reason="rclpy is not installed (pip: extra ros, x86-64 Linux; else apt)")
    has_ros = importlib.util.find_spec("rclpy") is not None
    unasked = {mark for mark in ("fuzz", "soak") if mark not in config.option.markexpr}
    for item in items:
        if "data_root" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.data)
        if not has_ros and item.get_closest_marker("dds"):
            item.add_marker(no_ros)
    left_out = [item for item in items if any(item.get_closest_marker(mark) for mark in unasked)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
