"""Ctrl-C between two pieces of work, never inside one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupts_between_items() -> Iterator[Callable[[], None]]:
    """Hold the first SIGINT back while the block runs; yields what raises it as KeyboardInterrupt between items.

    Inside a compiled kernel the exception would become a SystemError of that item, and the interrupt would be lost. A
    second SIGINT is raised at once. Where SIGINT is ignored, or outside the main thread, nothing changes.
    """
    asked = False

    def remember(_signal: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    def check() -> None:
        if asked:
            raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
        yield check
        return
    signal.signal(signal.SIGINT, remember)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
