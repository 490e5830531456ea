"""At most one line per second and cause in the log; and what has to last before it is said."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

_MAX_CAUSES = 256


class Throttle:
    """Says whether a cause may be logged now, and how often it was held back since it last was."""

    def __init__(self, period_s: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        self._period_s, self._clock = period_s, clock
        self._last: dict[str, tuple[float, int]] = {}
        self._lock = threading.Lock()

    def due(self, cause: str) -> int | None:
        """Return the number of times held back if `cause` is due, else None."""
        now = self._clock()
        with self._lock:
            last, held = self._last.get(cause, (float("-inf"), 0))
            if now - last < self._period_s:
                self._last[cause] = (last, held + 1)
                return None
            if len(self._last) >= _MAX_CAUSES and cause not in self._last:
                self._last.clear()
            self._last[cause] = (now, 0)
            return held


class Lasting:
    """What is found anew with each frame, and since when each of it has been. One thread writes, others may read."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since: dict[str, tuple[str, float]] = {}

    def note(self, found: Mapping[str, str]) -> None:
        """Take what was found with a frame: sentences by their cause."""
        now, before = self._clock(), self._since
        new = {cause: (sentence, now) for cause, sentence in found.items()}
        self._since = {c: before[c] if c in before and before[c][0] == new[c][0] else new[c] for c in new}

    def after(self, seconds: float) -> dict[str, str]:
        """Return the sentences that have been true for so long."""
        now = self._clock()
        return {cause: sentence for cause, (sentence, since) in self._since.items() if now - since >= seconds}
