"""Colour and depth find each other; every message ends exactly once (faults F01-F14 as far as stamps go)."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import replace

import pytest

from room_layout_ros.runtime.pairing import COLOR, DEPTH, Pair, PairingRules, StreamPairing

MS = 1_000_000
T0 = 1_000_000 * MS
RULES = PairingRules(max_gap_ns=20 * MS, reset_gap_ns=500 * MS, queue_size=10)


def frame(i: int) -> int:
    return T0 + i * 33 * MS


def feed(pairing: StreamPairing[str], script: Iterable[tuple[str, int]]) -> list[Pair[str]]:
    """Send (stream, stamp) messages; return the pairs. The item of each is its own name."""
    pairs = []
    for stream, stamp in script:
        pair = pairing.add(stream, stamp, f"{stream}@{stamp}")
        if pair is not None:
            pairs.append(pair)
        check_sums(pairing)
    return pairs


def check_sums(pairing: StreamPairing[str]) -> None:
    for stream, count in pairing.counts.items():
        assert count.waiting == len(pairing._queues[stream]) <= pairing._rules.queue_size
        assert min(count.received, count.paired, count.superseded, count.waiting) >= 0


def both(stamps: Iterable[int], offset: int = 0) -> list[tuple[str, int]]:
    return [message for t in stamps for message in ((COLOR, t + offset), (DEPTH, t))]


@pytest.fixture
def pairing() -> StreamPairing[str]:
    return StreamPairing(RULES)


def test_equal_stamps_pair_at_once_in_either_order(pairing: StreamPairing[str]) -> None:
    pairs = feed(pairing, [(COLOR, T0), (DEPTH, T0), (DEPTH, frame(1)), (COLOR, frame(1))])
    assert [(p.stamp_ns, p.color, p.depth) for p in pairs] == [
        (t, f"color@{t}", f"depth@{t}") for t in (T0, frame(1))
    ]  # fmt: skip


def test_equal_stamps_go_before_near_ones(pairing: StreamPairing[str]) -> None:
    pairs = feed(pairing, [(COLOR, T0), (DEPTH, T0 + 5 * MS), (COLOR, T0 + 5 * MS)])
    assert [p.color for p in pairs] == [f"color@{T0 + 5 * MS}"]
    assert pairing.counts[COLOR].superseded == 1


@pytest.mark.parametrize("offset_ms", (1, 5, 10, 19))
def test_f05_streams_with_a_steady_offset_pair_within_the_gap(pairing: StreamPairing[str], offset_ms: int) -> None:
    script = sorted(both((frame(i) for i in range(100)), offset_ms * MS), key=lambda m: m[1])
    pairs = feed(pairing, script)
    assert len(pairs) >= 97  # the first few wait for equal stamps that might still come
    gaps = {abs(int((p.color or "").split("@")[1]) - p.stamp_ns) for p in pairs}
    assert max(gaps) <= 20 * MS


def test_f05_an_offset_over_the_gap_never_pairs(pairing: StreamPairing[str]) -> None:
    rules = PairingRules(max_gap_ns=5 * MS)
    assert feed(StreamPairing(rules), both((frame(i) for i in range(100)), 16 * MS)) == []


@pytest.mark.parametrize("late", (1, 3, 8))
def test_f05_a_stream_that_arrives_late_pairs_with_its_own_frame(pairing: StreamPairing[str], late: int) -> None:
    script: list[tuple[str, int]] = []
    for i in range(60):
        script.append((COLOR, frame(i)))
        if i >= late:
            script.append((DEPTH, frame(i - late)))
    pairs = feed(pairing, script)
    assert [p.stamp_ns for p in pairs] == [frame(i) for i in range(60 - late)]
    assert all(p.color == f"color@{p.stamp_ns}" for p in pairs)


@pytest.mark.parametrize("silent", (COLOR, DEPTH))
def test_f01_f02_a_stream_stops_and_resumes(pairing: StreamPairing[str], silent: str) -> None:
    before = both(frame(i) for i in range(10))
    gap = [m for m in both(frame(i) for i in range(10, 50)) if m[0] != silent]
    pairs = feed(pairing, [*before, *gap, *both(frame(i) for i in range(50, 60))])
    assert [p.stamp_ns for p in pairs] == [frame(i) for i in [*range(10), *range(50, 60)]]
    alone = DEPTH if silent == COLOR else COLOR
    assert (pairing.counts[alone].superseded, pairing.counts[alone].paired) == (40, 20)


def test_f04_random_drops_leave_only_whole_pairs_and_exact_counts(pairing: StreamPairing[str]) -> None:
    chance = random.Random(3)
    script = [m for m in both(frame(i) for i in range(3000)) if chance.random() > 0.3]
    pairs = feed(pairing, script)
    sent = {s: {t for stream, t in script if stream == s} for s in (COLOR, DEPTH)}
    assert [p.stamp_ns for p in pairs] == sorted(sent[COLOR] & sent[DEPTH])
    for stream, count in pairing.counts.items():
        assert (count.received, count.paired) == (len(sent[stream]), len(pairs))
        assert count.refused.total() == 0


def test_f06_duplicates_are_refused(pairing: StreamPairing[str]) -> None:
    pairs = feed(pairing, [m for t in (frame(0), frame(1)) for m in ((COLOR, t), (COLOR, t), (DEPTH, t), (DEPTH, t))])
    assert len(pairs) == 2
    assert {s: dict(c.refused) for s, c in pairing.counts.items()} == {
        COLOR: {"duplicate": 2}, DEPTH: {"duplicate": 2},
    }  # fmt: skip


def test_f07_reordered_messages_never_make_the_output_go_back(pairing: StreamPairing[str]) -> None:
    chance, script = random.Random(5), both(frame(i) for i in range(500))
    for i in range(0, len(script) - 8, 4):
        part = script[i : i + 8]
        chance.shuffle(part)
        script[i : i + 8] = part
    stamps = [p.stamp_ns for p in feed(pairing, script)]
    assert len(stamps) > 200
    assert stamps == sorted(set(stamps))


def test_f08_a_bag_that_loops_starts_afresh_and_loses_no_pair(pairing: StreamPairing[str]) -> None:
    loop = both(frame(i) for i in range(60))
    pairs = feed(pairing, loop * 3)
    assert len(pairs) == 180
    assert [i for i, p in enumerate(pairs) if p.reset] == [60, 120]


@pytest.mark.parametrize("frames", (2, 3, 5, 14))
@pytest.mark.parametrize("offset_ms", (0, 5))
def test_f08_a_bag_that_loops_within_the_reset_gap_goes_on(
    pairing: StreamPairing[str], frames: int, offset_ms: int
) -> None:
    loop = sorted(both((frame(i) for i in range(frames)), offset_ms * MS), key=lambda m: m[1])
    feed(pairing, loop * 5)  # it takes five messages to know it from late ones
    for _ in range(10):
        pairs = feed(pairing, loop)
        assert len(pairs) >= frames - (1 if offset_ms else 0), "every loop that begins as one before"
        assert [p.reset for p in pairs].count(True) == 1


@pytest.mark.parametrize("alone", (COLOR, DEPTH))
def test_f08_a_short_loop_of_one_stream_goes_on(alone: str) -> None:
    pairing: StreamPairing[str] = StreamPairing(PairingRules(use_color=alone == COLOR, use_depth=alone == DEPTH))
    loop = [(alone, frame(i)) for i in range(3)]
    feed(pairing, loop * 4)
    assert [p.reset for p in feed(pairing, loop * 3)] == [True, False, False] * 3


def test_f08_old_messages_out_of_order_or_with_newer_ones_between_are_refused(pairing: StreamPairing[str]) -> None:
    feed(pairing, both(frame(i) for i in range(10)))
    falling = [(COLOR, frame(i)) for i in range(8, 0, -1)]
    between = [m for i in range(10) for m in ((COLOR, frame(i)), *both([frame(10 + i)]))]
    pairs = feed(pairing, [*falling, *between])
    assert [p.stamp_ns for p in pairs] == [frame(10 + i) for i in range(10)]
    assert not any(p.reset for p in pairs)
    assert pairing.counts[COLOR].refused == {"late": 18}


def test_f08_a_stamp_that_stands_still_is_no_loop(pairing: StreamPairing[str]) -> None:
    assert len(feed(pairing, both([T0] * 50))) == 1


def test_f09_a_jump_of_an_hour_forward_starts_afresh(pairing: StreamPairing[str]) -> None:
    hour = 3_600_000 * MS
    pairs = feed(pairing, both([frame(i) for i in range(5)] + [hour + frame(i) for i in range(5, 10)]))
    assert [p.reset for p in pairs] == [False] * 5 + [True] + [False] * 4


@pytest.mark.parametrize("alone", ("", COLOR, DEPTH))
@pytest.mark.parametrize(("passed_s", "reset"), ((0, True), (1, True), (54, True), (56, False), (60, False)))
def test_f09_a_camera_that_was_silent_is_no_jump_of_the_clock(alone: str, passed_s: int, reset: bool) -> None:
    """Stamps go on by a minute; what tells a pause from a jump is whether the minute has passed."""
    pairing: StreamPairing[str] = StreamPairing(replace(RULES, use_color=alone != DEPTH, use_depth=alone != COLOR))
    streams = (alone,) if alone else (COLOR, DEPTH)
    pairs = []
    for i, stamp in enumerate((frame(0), frame(1), frame(1) + 60_000 * MS, frame(2) + 60_000 * MS)):
        now = 7 * MS + i * 33 * MS + (passed_s * 1000 * MS if i > 1 else 0)
        pairs += [pair for s in streams if (pair := pairing.add(s, stamp, s, now)) is not None]
    assert [p.reset for p in pairs] == [False, False, reset, False]


@pytest.mark.parametrize("stream", (COLOR, DEPTH))
def test_f10_far_future_stamps_on_one_topic_are_refused_and_disturb_nothing(
    pairing: StreamPairing[str], stream: str
) -> None:
    script = []
    for i in range(100):
        script += both([frame(i)])
        if i % 3 == 0:
            script.append((stream, frame(i) + 10**9 * MS))
    pairs = feed(pairing, script)
    assert [p.stamp_ns for p in pairs] == [frame(i) for i in range(100)]
    assert not any(p.reset for p in pairs)
    count = pairing.counts[stream]
    assert count.refused["stamp far ahead of the other stream"] + count.waiting == 34


@pytest.mark.parametrize("how", ("refused", "silent"))
def test_f10_a_healthy_stream_is_not_blamed_when_the_other_is_refused_or_stops(
    pairing: StreamPairing[str], how: str
) -> None:
    feed(pairing, both(frame(i) for i in range(10)))
    for i in range(10, 400):
        feed(pairing, [(COLOR, frame(i))])
        if how == "refused":
            pairing.refuse(DEPTH, "bad image")
    count = pairing.counts[COLOR]
    assert (count.paired, count.superseded, count.waiting, count.refused.total()) == (10, 380, 10, 0)
    pairs = feed(pairing, both(frame(i) for i in range(400, 410)))
    assert len(pairs) == 10, "it goes on at once"


def test_f10_two_clocks_are_blamed_with_reason_and_stamp(pairing: StreamPairing[str]) -> None:
    minute = 60_000 * MS
    feed(pairing, both((frame(i) for i in range(100)), minute))
    assert pairing.counts[COLOR].refused == {"stamp far ahead of the other stream": 90}
    assert pairing.counts[DEPTH].refused == {"stamp far behind the other stream": 90}
    assert pairing.last_fault[COLOR] == ("stamp far ahead of the other stream", frame(89) + minute)


def test_turns_apart_count_only_usable_messages_that_do_not_meet(pairing: StreamPairing[str]) -> None:
    feed(pairing, both(frame(i) for i in range(10)))
    assert pairing.turns_apart == 0, "they pair"
    for i in range(10, 40):
        feed(pairing, [(COLOR, frame(i))])
        pairing.refuse(DEPTH, "bad image")
    assert pairing.turns_apart <= 1, "the partners are refused"
    feed(pairing, [(COLOR, frame(i)) for i in range(40, 50)] + [(DEPTH, frame(i)) for i in range(60, 70)])
    assert pairing.turns_apart <= 1, "one stream, then the other"
    assert feed(pairing, both((frame(100 + 10 * i) for i in range(10)), 150 * MS)) == []
    assert pairing.turns_apart >= 18, "they alternate and are half a period apart"
    assert len(feed(pairing, both((frame(300 + 10 * i) for i in range(10)), 10 * MS))) >= 5
    assert pairing.turns_apart <= 2, "they pair again"


def test_f11_stamps_that_are_not_above_zero_are_refused(pairing: StreamPairing[str]) -> None:
    assert feed(pairing, [(COLOR, 0), (DEPTH, -5)]) == []
    assert pairing.counts[COLOR].refused["bad stamp"] == 1


def test_f13_a_burst_keeps_the_queue_bounded(pairing: StreamPairing[str]) -> None:
    feed(pairing, [(COLOR, frame(i)) for i in range(1000)])
    assert (pairing.counts[COLOR].waiting, pairing.counts[COLOR].superseded) == (10, 990)


@pytest.mark.parametrize(("use_color", "alone"), ((True, COLOR), (False, DEPTH)))
def test_a_stream_that_is_not_used_is_not_waited_for(use_color: bool, alone: str) -> None:
    rules = PairingRules(use_color=use_color, use_depth=not use_color)
    pairing: StreamPairing[str] = StreamPairing(rules)
    pairs = feed(pairing, [(alone, frame(i)) for i in range(20)])
    assert [p.stamp_ns for p in pairs] == [frame(i) for i in range(20)]
    assert all((p.color is None) == (alone == DEPTH) and (p.depth is None) == (alone == COLOR) for p in pairs)


def test_a_change_of_the_streams_in_use_forgets_what_waits(pairing: StreamPairing[str]) -> None:
    feed(pairing, [(COLOR, T0)])
    pairing.configure(PairingRules(use_color=False))
    check_sums(pairing)
    assert pairing.counts[COLOR].superseded == 1
    assert len(feed(pairing, [(DEPTH, frame(1))])) == 1
