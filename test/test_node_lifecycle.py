"""The lifecycle node: legal states only, whatever the order; nothing leaks (F38)."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator

import psutil
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from node_bench import Bench, GatedEstimator, running
from rclpy.lifecycle import TransitionCallbackReturn

from msg_adapters import messages
from room_layout_ros.estimator_node import EstimatorLifecycleNode

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


def threads(name: str) -> int:
    return sum(t.name == name for t in threading.enumerate())


def workers() -> int:
    return threads("estimator-worker")


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


@pytest.fixture
def gated() -> Iterator[Bench]:
    with running(EstimatorLifecycleNode, GatedEstimator) as bench:
        yield bench
        bench.estimators[0].gate.set()


def test_f38_cleanup_of_a_busy_node_leaves_no_publisher_and_no_thread_for_long(gated: Bench) -> None:
    ear, (estimator,) = gated.listen("estimator/labels", messages.Image), gated.estimators
    estimator.gate.clear()
    for cycle in range(3):
        trigger(gated, "configure")
        assert estimator.busy.wait(5.0), "in the warm-up"
        gated.until(lambda: ear.get_publisher_count() == 1)
        trigger(gated, "cleanup")
        gated.until(lambda: ear.get_publisher_count() == 0)
        assert workers() == cycle + 1, "the one inside the frame cannot be stopped"
        estimator.busy.clear()
    trigger(gated, "configure")
    gated.spin(0.3)
    assert ear.get_publisher_count() == 1
    estimator.gate.set()
    gated.until(lambda: workers() == 1)
    trigger(gated, "activate")
    gated.until_subscribed()
    gated.expect(0)
    assert len(gated.labels_of(0)) == 1


def test_f38_a_frame_of_before_cleanup_is_not_published_by_the_next_session(gated: Bench) -> None:
    gated.listen("estimator/labels", messages.Image)
    (estimator,) = gated.estimators
    for name in ("configure", "activate"):
        trigger(gated, name)
    gated.until_subscribed()
    estimator.gate.clear()
    estimator.busy.clear()
    gated.send(0)
    gated.until(estimator.busy.is_set)
    old = gated.node.shell._session
    for name in ("deactivate", "cleanup", "configure", "activate"):
        trigger(gated, name)
    estimator.gate.set()
    gated.until(lambda: workers() == 1)
    gated.until_subscribed()
    gated.expect(1)
    gated.spin(0.3)
    assert not gated.labels_of(0)
    assert (old.health().published, old.health().dropped) == (0, {"shutdown": 1})


def test_f38_an_illegal_transition_is_refused_and_changes_nothing(bench: Bench) -> None:
    with pytest.raises(Exception, match=r"[Tt]ransition"):
        bench.node.trigger_activate()
    assert bench.node._state_machine.current_state[1] == "unconfigured"
    trigger(bench, "configure")
    trigger(bench, "activate")


def test_f38_an_illegal_transition_by_the_service_is_answered_with_no(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    client = bench.other.create_client(ChangeState, "estimator/change_state")
    bench.until(client.service_is_ready)

    def asked(number: int, label: str = "") -> bool:
        answer = client.call_async(ChangeState.Request(transition=Transition(id=number, label=label)))
        bench.until(answer.done)
        return bool(answer.result().success)

    assert not asked(Transition.TRANSITION_ACTIVATE)
    assert not asked(99)
    assert not asked(0, "fly")
    assert "transition 3 is not possible from unconfigured" in capfd.readouterr().err
    assert asked(Transition.TRANSITION_CONFIGURE)
    assert not asked(Transition.TRANSITION_CONFIGURE)
    assert bench.node._state_machine.current_state[1] == "inactive"
    assert asked(0, "activate")


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
