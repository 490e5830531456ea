"""Colour and depth of one moment, out of two streams that are late, lossy, reordered, looped or wrong.

Knows neither ROS nor a clock: stamps and times of arrival come in with the messages. Bounded; every message ends as
exactly one of paired, superseded or refused(reason), so that received = paired + superseded + refused + waiting at any
time. (message_filters stalls for good after an exception in a callback or one stamp far in the future, and evicts the
smallest stamp instead of the oldest message; hence this.)
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")

COLOR, DEPTH = "color", "depth"

BAD_STAMP, DUPLICATE, LATE = "bad stamp", "duplicate", "late"
AHEAD, BEHIND = "stamp far ahead of the other stream", "stamp far behind the other stream"
STAMP_FAULTS = {
    BAD_STAMP: "is not valid",
    DUPLICATE: "came twice",
    LATE: "is older than that of the last pair",
    AHEAD: "is far ahead of the other stream; do both drivers stamp with one clock?",
    BEHIND: "is far behind the other stream; do both drivers stamp with one clock?",
}
"""What is wrong with the stamp of a message that is refused for it, by the reason it is counted under."""

FORWARD_JUMPS = 10
"""A gap of this many `reset_gap`s between the stamps of pairs is a jump of the clock: start afresh. Where as much time
has passed, it is a camera that was silent."""
_RUN_TO_TRUST = 3
"""After as many pairs without an exact one the streams are not stamped alike: stop waiting for equal stamps."""
_RUN_TO_RESTART = 5
"""As many old messages in a row, in order among themselves and none newer between them, are no late ones: time starts
anew, as in a recording that loops and is shorter than `reset_gap`."""


@dataclass(frozen=True, slots=True)
class PairingRules:
    """Bounds of the pairing, in nanoseconds.

    Attributes
    ----------
    max_gap_ns : largest difference of the stamps of a pair.
    reset_gap_ns : a pair older than the last one by more than this is a jump of the clock, not a late one.
    queue_size : messages of a stream that may wait for a partner.
    use_color, use_depth : a stream that is not used is not waited for.
    """

    max_gap_ns: int = 20_000_000
    reset_gap_ns: int = 500_000_000
    queue_size: int = 10
    use_color: bool = True
    use_depth: bool = True


@dataclass(frozen=True, slots=True)
class Pair(Generic[Item]):
    """Messages of one moment. `stamp_ns` is the depth image's (the colour image's where there is no depth)."""

    stamp_ns: int
    color: Item | None
    depth: Item | None
    reset: bool
    """True after a jump of the clock: nothing that was known before holds any longer."""


@dataclass(slots=True)
class StreamCount:
    """What became of the messages of one stream."""

    received: int = 0
    paired: int = 0
    superseded: int = 0
    refused: Counter[str] = field(default_factory=Counter)

    @property
    def waiting(self) -> int:
        """Messages whose end is not known yet."""
        return self.received - self.paired - self.superseded - self.refused.total()


class _OldRun:
    """Messages of a stream in a row that are not newer than its last pair."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self._loop_start = 0

    def ends_with(self, stamp_ns: int) -> bool:
        """Take the next; True where it shows that time has started anew.

        A loop that is shorter than the run is in order up to the message that it begins with again. Where a run has
        shown a loop, its first stamp does so at once from then on.
        """
        if stamp_ns == self._loop_start:
            return True
        if self.stamps and stamp_ns == self.stamps[-1]:
            return False
        if self.stamps and stamp_ns < self.stamps[-1] and stamp_ns not in self.stamps:
            self.stamps.clear()
        self.stamps.append(stamp_ns)
        if len(self.stamps) < _RUN_TO_RESTART:
            return False
        self._loop_start = self.stamps[0]
        return True


class StreamPairing(Generic[Item]):
    """Pairs two streams by stamp: equal stamps first, then the nearest within `max_gap_ns`.

    Stamps of the pairs rise; a pair that steps back by more than `reset_gap_ns` (a bag that loops), by less after a run
    of old messages in order (a shorter bag), or further forward than time
    has passed is marked `reset`. Not thread-safe: a lock is the caller's.
    """

    def __init__(self, rules: PairingRules) -> None:
        self._rules = rules
        self._queues: dict[str, dict[int, Item]] = {COLOR: {}, DEPTH: {}}
        self._newest = {COLOR: 0, DEPTH: 0}
        self._emitted: dict[str, int | None] = {COLOR: None, DEPTH: None}
        self._emitted_at = 0
        self._passed: dict[str, int | None] = {COLOR: None, DEPTH: None}  # as _emitted; None after a restart
        self._old = {COLOR: _OldRun(), DEPTH: _OldRun()}
        self._run_without_exact = 0
        self._in_a_row = (COLOR, 0)
        self.turns_apart = 0
        """How often usable messages of one stream followed the other's since the last pair or refusal."""
        self.last_fault = {COLOR: ("", 0), DEPTH: ("", 0)}
        """Reason and stamp of the last message that was refused for its stamp."""
        self.counts = {COLOR: StreamCount(), DEPTH: StreamCount()}

    def configure(self, rules: PairingRules) -> None:
        """Change the bounds; what waits is dropped if the streams in use change."""
        if (rules.use_color, rules.use_depth) != (self._rules.use_color, self._rules.use_depth):
            self.reset()
        self._rules = rules
        for stream in self._queues:
            self._evict(stream)

    def reset(self) -> None:
        """Forget everything but the counts; what waits is superseded."""
        for stream, queue in self._queues.items():
            self.counts[stream].superseded += len(queue)
            queue.clear()
        self._newest = {COLOR: 0, DEPTH: 0}
        self._emitted = {COLOR: None, DEPTH: None}
        self._passed = {COLOR: None, DEPTH: None}
        self._old = {COLOR: _OldRun(), DEPTH: _OldRun()}
        self._run_without_exact = 0
        self.turns_apart = 0

    def refuse(self, stream: str, reason: str) -> None:
        """Count a message that cannot be used; its partner has to stay alone."""
        self.turns_apart = 0
        self.counts[stream].received += 1
        self.counts[stream].refused[reason] += 1

    def add(self, stream: str, stamp_ns: int, item: Item, now_ns: int = 0) -> Pair[Item] | None:
        """Take one message, which came at `now_ns` (of any clock that is steady); return the pair that it completes."""
        fault = self._stamp_fault(stream, stamp_ns)
        if fault in (DUPLICATE, LATE) and self._starts_anew(stream, stamp_ns):
            fault = ""
        self.counts[stream].received += 1
        if fault:
            self._refuse_stamp(stream, fault, stamp_ns)
            return None
        self._old[stream].stamps.clear()
        self._take_turn(stream)
        self._queues[stream][stamp_ns] = item
        self._newest[stream] = stamp_ns
        pair = self._complete(stream, stamp_ns, now_ns)
        if pair is not None:
            self.turns_apart = 0
        self._evict(stream)
        return pair

    def _refuse_stamp(self, stream: str, reason: str, stamp_ns: int) -> None:
        self.counts[stream].refused[reason] += 1
        self.last_fault[stream] = reason, stamp_ns

    def _take_turn(self, stream: str) -> None:
        last, number = self._in_a_row
        self._in_a_row = (stream, number + 1 if stream == last else 1)
        self.turns_apart += stream != last

    def _stamp_fault(self, stream: str, stamp_ns: int) -> str:
        last = self._passed[stream]
        if stamp_ns <= 0:
            return BAD_STAMP
        if stamp_ns in self._queues[stream] or stamp_ns == last:
            return DUPLICATE
        if last is not None and last - self._rules.reset_gap_ns < stamp_ns < last:
            return LATE
        return ""

    def _starts_anew(self, stream: str, stamp_ns: int) -> bool:
        """Note a message that is not newer than the last pair; True where time has started anew with it."""
        if not self._old[stream].ends_with(stamp_ns):
            return False
        self.counts[stream].superseded += len(self._queues[stream])
        self._queues[stream].clear()
        self._passed[stream] = None
        return True

    def _complete(self, stream: str, stamp_ns: int, now_ns: int) -> Pair[Item] | None:
        if not (self._rules.use_color and self._rules.use_depth):
            return self._emit_single(stream, stamp_ns, now_ns)
        if stamp_ns in self._queues[_other(stream)]:
            self._run_without_exact = 0
            return self._emit(stamp_ns, stamp_ns, now_ns)
        candidates = self._near_pairs()
        if not candidates:
            return None
        self._run_without_exact += 1
        return self._emit(*candidates[-1], now_ns)

    def _near_pairs(self) -> list[tuple[int, int]]:
        """Return (colour, depth) stamps within the gap, each nearest to the other, in order of time.

        As long as equal stamps may still come, only pairs that both streams have passed count.
        """
        trusted = self._run_without_exact >= _RUN_TO_TRUST
        passed = min(self._newest.values())
        pairs = []
        for color in self._queues[COLOR]:
            depth = _nearest(self._queues[DEPTH], color)
            if depth is None or abs(color - depth) > self._rules.max_gap_ns:
                continue
            if _nearest(self._queues[COLOR], depth) != color:
                continue
            if trusted or max(color, depth) <= passed:
                pairs.append((color, depth))
        return sorted(pairs)

    def _emit(self, color: int, depth: int, now_ns: int) -> Pair[Item]:
        back, forward = self._jump(self._emitted[DEPTH], depth, now_ns)
        pair = Pair(depth, self._queues[COLOR].pop(color), self._queues[DEPTH].pop(depth), back or forward)
        for stream, stamp in ((COLOR, color), (DEPTH, depth)):
            self._emitted[stream] = self._passed[stream] = stamp
            self.counts[stream].paired += 1
            self._forget(stream, stamp, back)
        return pair

    def _jump(self, last: int | None, stamp_ns: int, now_ns: int) -> tuple[bool, bool]:
        """Return whether stamps jumped (back, forward) since the last pair; note when this one came."""
        passed, self._emitted_at = now_ns - self._emitted_at, now_ns
        if last is None:
            return False, False
        return stamp_ns <= last, stamp_ns - last > passed + FORWARD_JUMPS * self._rules.reset_gap_ns

    def _emit_single(self, stream: str, stamp_ns: int, now_ns: int) -> Pair[Item] | None:
        item = self._queues[stream].pop(stamp_ns)
        if stream != (COLOR if self._rules.use_color else DEPTH):
            self.counts[stream].superseded += 1
            return None
        back, forward = self._jump(self._emitted[stream], stamp_ns, now_ns)
        self._emitted[stream] = self._passed[stream] = stamp_ns
        self.counts[stream].paired += 1
        color, depth = (item, None) if stream == COLOR else (None, item)
        return Pair(stamp_ns, color, depth, back or forward)

    def _forget(self, stream: str, stamp_ns: int, back: bool) -> None:
        """Drop what can no longer be paired: older than the pair, or of the time before a jump back."""
        queue = self._queues[stream]
        gone = [t for t in queue if t < stamp_ns or (back and t > stamp_ns + self._rules.reset_gap_ns)]
        for t in gone:
            del queue[t]
        self.counts[stream].superseded += len(gone)

    def _evict(self, stream: str) -> None:
        """Keep the queue within its bound: the message that waited longest goes first, whatever its stamp.

        Stamps are to blame only while the other stream goes on: one that stops, or is refused, soon lies far behind.
        """
        queue, count = self._queues[stream], self.counts[stream]
        alone = self._in_a_row[0] == stream and self._in_a_row[1] > self._rules.queue_size
        other = 0 if alone else self._newest[_other(stream)]
        while len(queue) > self._rules.queue_size:
            stamp_ns = next(iter(queue))
            del queue[stamp_ns]
            if other and stamp_ns > other + FORWARD_JUMPS * self._rules.reset_gap_ns:
                self._refuse_stamp(stream, AHEAD, stamp_ns)
            elif other and stamp_ns < other - FORWARD_JUMPS * self._rules.reset_gap_ns:
                self._refuse_stamp(stream, BEHIND, stamp_ns)
            else:
                count.superseded += 1


def _other(stream: str) -> str:
    return DEPTH if stream == COLOR else COLOR


def _nearest(stamps: dict[int, Item], stamp_ns: int) -> int | None:
    return min(stamps, key=lambda t: abs(t - stamp_ns), default=None)
