"""The lifecycle node: legal states only, whatever the order; nothing leaks (F38)."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator

import psutil
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from node_bench import Bench, running
from rclpy.lifecycle import TransitionCallbackReturn

from msg_adapters import messages
from room_layout_ros.node import EstimatorLifecycleNode

pytestmark = pytest.mark.dds

LEGAL = {
    "unconfigured": {"configure": "inactive"},
    "inactive": {"activate": "active", "cleanup": "unconfigured"},
    "active": {"deactivate": "inactive"},
}


@pytest.fixture
def bench() -> Iterator[Bench]:
    with running(EstimatorLifecycleNode) as bench:
        yield bench


def trigger(bench: Bench, name: str) -> None:
    assert getattr(bench.node, f"trigger_{name}")() is TransitionCallbackReturn.SUCCESS


def workers() -> int:
    return sum(t.name == "estimator-worker" for t in threading.enumerate())


def test_unconfigured_it_has_no_topics_and_no_worker(bench: Bench) -> None:
    bench.spin(0.2)
    assert workers() == 0
    assert bench.other.count_publishers(f"{bench.namespace}/estimator/labels") == 0


def test_it_estimates_only_while_active(bench: Bench) -> None:
    ear = bench.listen("estimator/labels", messages.Image)
    trigger(bench, "configure")
    bench.until(ear.get_publisher_count)
    bench.until(lambda: bench.diagnosis().get("estimates") == (0, "inactive"))
    assert not any(c.get_subscription_count() for c in bench.cameras.values())
    for i in (0, 10):
        trigger(bench, "activate")
        bench.until_subscribed()
        bench.expect(i)
        trigger(bench, "deactivate")
        bench.until(lambda: not any(c.get_subscription_count() for c in bench.cameras.values()))
    trigger(bench, "cleanup")
    assert workers() == 0
    bench.until(lambda: not ear.get_publisher_count())


def test_f38_random_transitions_keep_to_legal_states_and_leak_no_thread(bench: Bench) -> None:
    wander(bench, 60)


@pytest.mark.soak
def test_f38_five_hundred_cycles_leak_nothing(bench: Bench) -> None:
    def cycle() -> None:
        for name in ("configure", "activate", "deactivate", "cleanup"):
            trigger(bench, name)
            bench.executor.spin_once(timeout_sec=0.0)
        for estimator in bench.estimators:
            estimator.frames.clear()

    process = psutil.Process()
    for _ in range(20):
        cycle()
    bench.spin(0.5)  # the kernel needs a moment to bury a thread that has been joined
    before = process.num_threads(), process.num_fds(), process.memory_info().rss
    for _ in range(480):
        cycle()
    bench.spin(0.5)
    assert process.num_threads() <= before[0]
    assert process.num_fds() <= before[1]
    assert process.memory_info().rss - before[2] < 16 * 1024 * 1024


def wander(bench: Bench, steps: int) -> None:
    chance, state = random.Random(2), "unconfigured"
    for _ in range(steps):
        name = chance.choice(sorted(LEGAL[state]))
        trigger(bench, name)
        state = LEGAL[state][name]
        assert bench.node._state_machine.current_state[1] == state
        assert workers() == (state != "unconfigured")
        bench.executor.spin_once(timeout_sec=0.0)


def test_f38_an_illegal_transition_is_refused_and_changes_nothing(bench: Bench) -> None:
    with pytest.raises(Exception, match=r"[Tt]ransition"):
        bench.node.trigger_activate()
    assert bench.node._state_machine.current_state[1] == "unconfigured"
    trigger(bench, "configure")
    trigger(bench, "activate")


def test_f38_a_failing_configure_is_logged_and_can_be_repeated(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    import room_layout_ros.shell as node_module

    def broken(*_: object) -> None:
        raise RuntimeError("no session today")

    with monkeypatch.context() as patch:
        patch.setattr(node_module, "EstimatorSession", broken)
        assert bench.node.trigger_configure() is not TransitionCallbackReturn.SUCCESS
    assert "no session today" in capfd.readouterr().err
    assert bench.node._state_machine.current_state[1] == "unconfigured"
    assert workers() == 0
    trigger(bench, "configure")
    trigger(bench, "activate")
    bench.connect()
    bench.expect(0)


def test_shutdown_from_active_ends_the_worker(bench: Bench) -> None:
    trigger(bench, "configure")
    trigger(bench, "activate")
    trigger(bench, "shutdown")
    assert workers() == 0
    assert bench.node._state_machine.current_state[1] == "finalized"
