"""Reading on behind the damaged parts of a bag, whatever its storage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

RawMessage = tuple[Any, int, bytes]
"""Connection, log time in ns, CDR."""

_FINEST_NS = 1_000_000
"""The end of a damaged part is found to a millisecond."""


def messages_around_damage(
    read: Callable[[int | None], Iterator[RawMessage]], end_ns: int, damage: list[Exception]
) -> Iterator[RawMessage]:
    """Yield every message that can be read, in the order of time.

    A storage is asked by time only, so the same search passes over a damaged chunk and a damaged database page.

    Parameters
    ----------
    read : callable
        Gives the messages from a log time on (None: all).
    end_ns : int
        No message is at or after it.
    damage : list
        Gets what was wrong with each damaged part.
    """
    start: int | None = None
    reached = 0
    while True:
        try:
            for message in read(start):
                yield message
                reached = message[1]
        except GeneratorExit:
            raise
        except Exception as error:  # noqa: BLE001 - a damaged file makes sqlite3, struct, zstd and assertion errors too
            damage.append(error)
            start = _next_readable(read, reached + 1, end_ns)
        else:
            return


def _next_readable(read: Callable[[int | None], Iterator[RawMessage]], low_ns: int, end_ns: int) -> int:
    """Return the first log time from which the next message can be read; at `end_ns` there is none."""

    def readable(start: int) -> bool:
        try:
            next(iter(read(start)), None)
        except Exception:  # noqa: BLE001 - as above
            return False
        return True

    bad, good, step = low_ns - 1, low_ns, _FINEST_NS
    while good < end_ns and not readable(good):
        bad, good, step = good, min(good + step, end_ns), 2 * step
    while good - bad > _FINEST_NS:
        middle = (bad + good) // 2
        bad, good = (bad, middle) if readable(middle) else (middle, good)
    return good
