"""Work spread over processes or machines, results in the order of the input.

One interface for the command line and for learning: here, in local processes (loky), or on a Dask cluster.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from room_layout_ros.extras import install_hint

T = TypeVar("T")
R = TypeVar("R")

IN_FLIGHT_PER_WORKER = 3
"""Items handed out per worker: enough to keep it busy, few enough to bound memory."""

CONNECT_TIMEOUT_S = 10

_LAST_ITEMS_S = 10.0
"""At the end, what is still in flight may take so long."""

MAX_LOSSES = 3
"""An item whose worker died this often while nothing else ran is given up."""


class WorkerLostError(RuntimeError):
    """A worker process died each time it was given one certain item."""


class _Pool(Protocol):
    """Where items go; `losses` are the exceptions that mean a worker died, not that the function failed."""

    @property
    def workers(self) -> int:
        """How many items are worked on at a time."""

    @property
    def losses(self) -> tuple[type[BaseException], ...]:
        """Exceptions that mean a lost worker."""

    def submit(self, function: Callable[[Any], Any], item: Any) -> Any:
        """Return a future."""

    def abandon(self, future: Any) -> None:
        """Take note that nobody wants its result."""

    def restart(self) -> None:
        """Make the pool usable again after a loss."""

    def close(self) -> None:
        """Give everything back; what still runs is cancelled."""


def map_ordered(
    function: Callable[[T], R],
    items: Iterable[T],
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[int], object] | None = None,
    lost: Callable[[T], R] | None = None,
) -> Iterator[R]:
    """Yield `function(item)` for every item, in the order of the items, each exactly once.

    Parameters
    ----------
    function : callable
        Must be picklable for several processes (defined at module level, `functools.partial` of such).
    items : iterable
        Read as needed: never more than a few items per worker are held.
    jobs : int
        Local processes; 1 runs here. Ignored with a scheduler.
    scheduler : str or None
        Address of a Dask scheduler ("tcp://host:8786"); needs the extra `train`.
    progress : callable or None
        Called with the number of results so far.
    lost : callable or None
        Gives the result of an item that kills its worker again and again.

    Raises
    ------
    ValueError
        When `jobs` is below 1.
    WorkerLostError
        When a worker dies again and again at the same item and `lost` is None. Single losses are repeated silently.
    Exception
        Whatever `function` raises.
    """
    pool = _open_pool(jobs, scheduler)
    results = map(function, items) if pool is None else _map_pool(function, items, pool, lost)
    for count, result in enumerate(results, 1):
        if progress:
            progress(count)
        yield result


class Spread(Protocol):
    """`map_ordered` on workers that stay."""

    def __call__(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield `function(item)` for every item, in order."""


@contextmanager
def open_workers(jobs: int = 1, scheduler: str | None = None) -> Iterator[Spread]:
    """Keep the processes, and what they have cached, for several maps (the rounds of a learning).

    Raises
    ------
    ValueError
        When `jobs` is below 1.
    """
    pool = _open_pool(jobs, scheduler)

    def spread(function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        return map(function, items) if pool is None else _map_pool(function, items, pool, None, keep=True)

    try:
        yield spread
    finally:
        if pool is not None:
            pool.close()


def _open_pool(jobs: int, scheduler: str | None) -> _Pool | None:
    """Return where the work goes; None is here."""
    if jobs < 1:
        raise ValueError(f"jobs is {jobs}; it must be 1 or more")
    if scheduler is not None:
        return _DaskPool(scheduler)
    return None if jobs == 1 else _LokyPool(jobs)


@dataclass(slots=True)
class _Task(Generic[T]):
    item: T
    future: Any
    losses: int = 0


def _map_pool(
    function: Callable[[T], R], items: Iterable[T], pool: _Pool, lost: Callable[[T], R] | None, keep: bool = False
) -> Iterator[R]:
    source = iter(items)
    pending: deque[_Task[T]] = deque()
    try:
        while True:
            while len(pending) < pool.workers * IN_FLIGHT_PER_WORKER:
                try:
                    item = next(source)
                except StopIteration:
                    break
                pending.append(_submit(function, item, pool))
            if not pending:
                return
            try:
                result = pending[0].future.result()
            except pool.losses:
                pool.restart()
                yield from _one_by_one(function, pending, pool, lost)
                continue
            pending.popleft()
            yield result
    finally:
        for task in pending:
            pool.abandon(task.future)
        if not keep:
            pool.close()


def _submit(function: Callable[[T], R], item: T, pool: _Pool) -> _Task[T]:
    try:
        return _Task(item, pool.submit(function, item))
    except pool.losses as error:  # the pool broke before this item could be handed out
        broken: Future[R] = Future()
        broken.set_exception(error)
        return _Task(item, broken)


def _one_by_one(
    function: Callable[[T], R], pending: deque[_Task[T]], pool: _Pool, lost: Callable[[T], R] | None
) -> Iterator[R]:
    """Work off what was in flight when a worker died, alone, so that a deadly item is told from its neighbours."""
    while pending:
        task = pending[0]
        done = task.future.done() and not task.future.cancelled() and task.future.exception() is None
        try:
            result = task.future.result() if done else pool.submit(function, task.item).result()
        except pool.losses:
            pool.restart()
            task.losses += 1
            if task.losses < MAX_LOSSES:
                continue
            if lost is None:
                raise WorkerLostError(f"a worker died {MAX_LOSSES} times at the same item; out of memory?") from None
            result = lost(task.item)
        pending.popleft()
        yield result


class _LokyPool:
    """Local processes; loky starts them clean (no fork of a threaded process) and notices when one dies."""

    def __init__(self, jobs: int) -> None:
        try:
            from joblib.externals.loky import ProcessPoolExecutor
            from joblib.externals.loky.process_executor import BrokenProcessPool
        except ImportError:
            raise ModuleNotFoundError(f"--jobs above 1 needs joblib: {install_hint('train')}", name="joblib") from None

        self.workers = jobs
        self.losses = (BrokenProcessPool,)
        self._start: Callable[[], Any] = lambda: ProcessPoolExecutor(max_workers=jobs)
        self._executor = self._start()
        self._abandoned: list[Any] = []

    def submit(self, function: Callable[[Any], Any], item: Any) -> Any:
        return self._executor.submit(function, item)

    def abandon(self, future: Any) -> None:
        """Let it end: few are in flight, and loky's own thread fails when it is shut down beside one, or cancelled."""
        self._abandoned.append(future)

    def restart(self) -> None:
        self._executor.shutdown(wait=True, kill_workers=True)
        self._executor = self._start()

    def close(self) -> None:
        wait(self._abandoned, _LAST_ITEMS_S)
        self._executor.shutdown(wait=True, kill_workers=True)


class _DaskPool:
    """Workers of a Dask cluster; the scheduler itself hands the items of a dead worker to another."""

    def __init__(self, scheduler: str) -> None:
        try:
            from distributed import Client
            from distributed.scheduler import KilledWorker
        except ImportError:
            raise ModuleNotFoundError(f"--scheduler needs Dask: {install_hint('train')}", name="distributed") from None
        try:
            self._client = Client(scheduler, timeout=CONNECT_TIMEOUT_S)
        except (OSError, ValueError) as error:
            raise ConnectionError(f"no Dask scheduler answers at {scheduler}: {error}") from None
        self.losses = (KilledWorker,)

    @property
    def workers(self) -> int:
        return max(1, sum(self._client.nthreads().values()))

    def submit(self, function: Callable[[Any], Any], item: Any) -> Any:
        return self._client.submit(function, item, pure=False)

    def abandon(self, future: Any) -> None:
        future.cancel()

    def restart(self) -> None:
        """Nothing to do: the cluster replaces its workers itself."""

    def close(self) -> None:
        with suppress(Exception):
            self._client.close()
