"""Any script of stamps whatever keeps the promises of the pairing (a state machine that hypothesis drives)."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from room_layout_ros.runtime.pairing import COLOR, DEPTH, Pair, PairingRules, StreamPairing

MS = 1_000_000
START = 10_000_000 * MS
streams = st.sampled_from((COLOR, DEPTH))


class PairingMachine(RuleBasedStateMachine):
    """Two streams that run, lose, repeat, reorder, jump, drift, and send nonsense; now and then someone resets."""

    @initialize(gap=st.integers(0, 40), queue=st.integers(1, 12), color=st.booleans())
    def start(self, gap: int, queue: int, color: bool) -> None:
        self.bounds = PairingRules(max_gap_ns=gap * MS, queue_size=queue, use_color=color)
        self.pairing: StreamPairing[tuple[str, int, int]] = StreamPairing(self.bounds)
        self.now = START
        self.serial = 0
        self.sent = {COLOR: 0, DEPTH: 0}
        self.used: set[int] = set()
        self.last: Pair[tuple[str, int, int]] | None = None

    def send(self, stream: str, stamp_ns: int) -> None:
        self.serial += 1
        self.sent[stream] += 1
        pair = self.pairing.add(stream, stamp_ns, (stream, stamp_ns, self.serial))
        if pair is not None:
            self.check(pair)
            self.last = pair

    def check(self, pair: Pair[tuple[str, int, int]]) -> None:
        parts = [part for part in (pair.color, pair.depth) if part is not None]
        for stream, stamp_ns, serial in parts:
            assert serial not in self.used, "a message is used once"
            self.used.add(serial)
            assert abs(stamp_ns - pair.stamp_ns) <= self.bounds.max_gap_ns
            assert stream == (COLOR if (stream, stamp_ns, serial) == pair.color else DEPTH)
        assert pair.depth is not None
        assert pair.stamp_ns == pair.depth[1], "the stamp is the depth image's"
        assert (pair.color is not None) == self.bounds.use_color
        if self.last is not None and not pair.reset:
            assert pair.stamp_ns > self.last.stamp_ns, "without a reset, stamps rise"
        if self.last is not None and pair.stamp_ns < self.last.stamp_ns:
            assert pair.reset
            jump = pair.stamp_ns <= self.last.stamp_ns - self.bounds.reset_gap_ns
            assert jump or self.sent[DEPTH] > 5, "late is not a jump, unless by a run of old messages"

    @rule(lost=st.sets(streams), swap=st.booleans(), offset=st.integers(-30, 30))
    def next_frame(self, lost: set[str], swap: bool, offset: int) -> None:
        self.now += 33 * MS
        order = (DEPTH, COLOR) if swap else (COLOR, DEPTH)
        for stream in order:
            if stream not in lost:
                self.send(stream, self.now + (offset * MS if stream == COLOR else 0))

    @rule(stream=streams, back=st.integers(0, 20))
    def late_or_repeated(self, stream: str, back: int) -> None:
        self.send(stream, self.now - back * 33 * MS)

    @rule(by=st.sampled_from((-3_600_000, -5_000, -501, 700, 6_000, 3_600_000)))
    def jump_of_the_clock(self, by: int) -> None:
        self.now = max(self.now + by * MS, MS)

    @rule(stream=streams, stamp_ns=st.one_of(st.integers(-(2**40), 2**63), st.sampled_from((0, 1, 2**62))))
    def nonsense(self, stream: str, stamp_ns: int) -> None:
        self.send(stream, stamp_ns)

    @rule(stream=streams)
    def refused_before(self, stream: str) -> None:
        self.sent[stream] += 1
        self.pairing.refuse(stream, "bad image")

    @rule()
    def reset(self) -> None:
        self.pairing.reset()
        self.last = None

    @rule(gap=st.integers(0, 40), queue=st.integers(1, 12))
    def configure(self, gap: int, queue: int) -> None:
        self.bounds = PairingRules(max_gap_ns=gap * MS, queue_size=queue, use_color=self.bounds.use_color)
        self.pairing.configure(self.bounds)

    @invariant()
    def every_message_ends_once_and_queues_are_bounded(self) -> None:
        if not hasattr(self, "pairing"):
            return
        for stream, count in self.pairing.counts.items():
            ends = count.paired + count.superseded + count.refused.total()
            assert count.received == self.sent[stream]
            assert ends + len(self.pairing._queues[stream]) == count.received
            assert len(self.pairing._queues[stream]) <= self.bounds.queue_size

    def teardown(self) -> None:
        """After whatever happened, an orderly stream is paired again at once."""
        if not hasattr(self, "pairing"):
            return
        for _ in range(3):
            before = self.last
            self.now = max(self.now, self.last.stamp_ns if self.last else 0) + 40 * MS
            for stream in (COLOR, DEPTH):
                self.send(stream, self.now)
            assert self.last is not before


TestPairing = PairingMachine.TestCase
TestPairing.settings = settings(max_examples=100, stateful_step_count=40, deadline=None)


@pytest.mark.fuzz
class TestPairingLong(PairingMachine.TestCase):  # type: ignore[misc, valid-type]
    """2000 scripts, in `make fuzz`."""

    settings = settings(max_examples=2000, stateful_step_count=60, deadline=None)
