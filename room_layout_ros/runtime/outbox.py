"""A second thread that sends what the first has worked out, in order, while that goes on with the next frame."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Outbox(Generic[Item]):
    """Runs `send(item)` for each item in order; neither function may raise.

    One item may wait; the next has to wait for that (so results do not pile up behind slow outputs).

    Parameters
    ----------
    send : callable
        Runs in the thread of the outbox.
    drop : callable
        Told each item that comes after the end, or that the end left over.
    """

    def __init__(self, send: Callable[[Item], None], drop: Callable[[Item], None]) -> None:
        self._send, self._drop = send, drop
        self._changed = threading.Condition()
        self._waiting: Item | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="estimator-outputs", daemon=True)
        self._thread.start()

    def put(self, item: Item) -> None:
        """Hand over an item; waits while another one waits."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._waiting is None)
            closed = self._closed
            if not closed:
                self._waiting = item
                self._changed.notify_all()
        if closed:
            self._drop(item)

    def close(self, timeout_s: float) -> bool:
        """Take no more, send what waits; what is not at the door after `timeout_s` is dropped.

        Returns False if `send` is still at it. The thread ends after that item in any case.
        """
        end = time.monotonic() + timeout_s
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._waiting is None, timeout_s)
            left, self._waiting = self._waiting, None
        if left is not None:
            self._drop(left)
        self._thread.join(max(0.0, end - time.monotonic()))
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._waiting is not None)
                item, self._waiting = self._waiting, None
                self._changed.notify_all()
            if item is None:
                return
            self._send(item)
