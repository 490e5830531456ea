"""Rates, quantiles, cameras, log lines: the small stateful parts, on a clock of our own."""

from __future__ import annotations

import math
from collections import deque

from room_layout_ros.runtime.camera_history import CameraHistory
from room_layout_ros.runtime.health import Rate, quantile
from room_layout_ros.runtime.throttle import Lasting, Throttle

S = 1_000_000_000


def test_rate_counts_the_last_five_seconds() -> None:
    rate = Rate()
    for i in range(60):
        rate.tick(i * S // 10)
    assert math.isclose(rate.hz(6 * S), 10.0)
    assert rate.hz(8 * S) < 8.0, "what has stopped goes down"
    assert rate.silence_s(8 * S) == 2.1
    assert rate.hz(100 * S) == 0.0


def test_no_event_is_silence_for_ever() -> None:
    assert Rate().hz(S) == 0.0
    assert Rate().silence_s(S) == math.inf


def test_quantiles_are_nearest_rank() -> None:
    values = deque(float(i) for i in range(100))
    assert (quantile(values, 0.5), quantile(values, 0.99)) == (50.0, 99.0)
    assert math.isnan(quantile(deque(), 0.5))


def test_a_frame_gets_the_camera_of_its_time() -> None:
    history: CameraHistory[str] = CameraHistory()
    assert history.at(5) is None
    assert history.add(10, "a")
    assert not history.add(20, "a")
    assert history.add(30, "b")
    assert [history.at(t) for t in (5, 10, 29, 30, 99)] == ["b", "a", "a", "b", "b"]


def test_a_reset_keeps_the_newest_camera_for_all_times() -> None:
    history: CameraHistory[str] = CameraHistory()
    history.add(10, "a")
    history.add(30, "b")
    history.reset()
    assert [history.at(t) for t in (1, 50)] == ["b", "b"]


def test_a_camera_without_a_stamp_held_always() -> None:
    history: CameraHistory[str] = CameraHistory()
    history.add(100, "a")
    history.add(0, "a")
    assert history.at(1) == "a"


def test_the_history_is_bounded() -> None:
    history: CameraHistory[int] = CameraHistory()
    for i in range(1000):
        history.add(i, i)
    assert len(history._cameras) == 8


def test_one_line_per_second_and_cause() -> None:
    now = [0.0]
    throttle = Throttle(1.0, lambda: now[0])
    assert throttle.due("a") == 0
    assert throttle.due("b") == 0
    assert [throttle.due("a") for _ in range(5)] == [None] * 5
    now[0] = 1.01
    assert throttle.due("a") == 5
    assert throttle.due("a") is None


def test_the_throttle_is_bounded() -> None:
    throttle = Throttle()
    for i in range(10_000):
        throttle.due(str(i))
    assert len(throttle._last) <= 256


def test_what_has_to_last_is_said_once_it_has_and_no_longer_than_it_does() -> None:
    now = [0.0]
    lasting = Lasting(lambda: now[0])
    lasting.note({"a": "one"})
    now[0] = 3.0
    lasting.note({"a": "one", "b": "two"})
    now[0] = 5.0
    assert lasting.after(4.0) == {"a": "one"}
    lasting.note({"a": "another", "b": "two"})
    assert lasting.after(2.0) == {"b": "two"}, "another sentence has to last anew"
    lasting.note({})
    assert lasting.after(0.0) == {}
