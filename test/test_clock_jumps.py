"""A bag that loops jumps back every few seconds for hours: that is worth a line in the log, not a log full of them."""

from __future__ import annotations

from functools import partial

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from node_bench import Bench, running
from room_frames import stamp_ns
from rosgraph_msgs.msg import Clock

from msg_adapters import messages

pytestmark = pytest.mark.dds

LOOPS = 2


def lines_with(words: str, capfd: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capfd.readouterr().err.splitlines() if words in line]


def exceeds(heard: list[object], number: int) -> bool:
    return len(heard) > number


def counted(bench: Bench, key: str) -> str:
    statuses = bench.heard["/diagnostics"][-1].status
    return next(v.value for s in statuses if s.name.endswith(": estimates") for v in s.values if v.key == key)


def test_loops_of_a_short_bag_are_one_warning_and_a_count(capfd: pytest.CaptureFixture[str]) -> None:
    with running() as bench:
        bench.connect()
        heard = bench.heard["estimator/labels"]
        for _ in range(LOOPS + 1):
            for i in (1, 31):
                before = len(heard)
                bench.send(i)
                bench.until(partial(exceeds, heard, before))
            bench.spin(1.1)  # more than the second after which a complaint is due again
        bench.until(lambda: counted(bench, "resets") == str(LOOPS))
    said = lines_with("stamps jumped", capfd)
    assert len(said) == 1, said
    assert "[WARN]" in said[0]
    assert "resets" in said[0], "it names where the rest are counted"


def test_a_clock_that_starts_over_with_each_loop_is_one_warning_too(capfd: pytest.CaptureFixture[str]) -> None:
    with running(use_sim_time=True) as bench:
        bench.listen("estimator/labels", messages.Image)
        clock = bench.other.create_publisher(Clock, "/clock", 10)

        def tick(i: int) -> None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp_ns(i), 10**9)
            clock.publish(message)
            bench.spin(0.05)

        for i in range(31, 131):
            tick(i)
            if all(c.get_subscription_count() for c in bench.cameras.values()):
                break
        for _ in range(2):
            tick(1)
            bench.spin(1.1)
            tick(31)
        bench.until(lambda: counted(bench, "resets") == "2")
    said = lines_with("/clock jumped back", capfd)
    assert len(said) == 1, said
    assert "[WARN]" in said[0]
