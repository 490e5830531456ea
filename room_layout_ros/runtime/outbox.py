"""A second thread that sends what the first has worked out, in order, while that goes on with the next frame."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Outbox(Generic[Item]):
    """Runs `send(item)` for each item in order; `send` must not raise.

    One item may wait; a third has to wait for that (so results do not pile up behind slow outputs).
    """

    def __init__(self, send: Callable[[Item], None]) -> None:
        self._send = send
        self._items: queue.Queue[Item | None] = queue.Queue(maxsize=1)
        self._thread = threading.Thread(target=self._run, name="estimator-outputs", daemon=True)
        self._thread.start()

    def put(self, item: Item) -> None:
        """Hand over an item; waits while another one waits."""
        self._items.put(item)

    def close(self, timeout_s: float) -> bool:
        """End the thread after all items are sent; return False if it is still at it after `timeout_s`."""
        try:
            self._items.put(None, timeout=timeout_s)
        except queue.Full:
            return False
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (item := self._items.get()) is not None:
            self._send(item)
