"""The live session: newest frame wins, everything is accounted for, no exception ends it (F03, F13, F32, F40)."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from room_frames import CAMERA, room_frame

from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.floor.floor_plane import FloorPlane
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.runtime.depth_scale import measure_scale
from room_layout_ros.runtime.diagnosis import NodeFacts, diagnose
from room_layout_ros.runtime.health import Health
from room_layout_ros.runtime.pairing import COLOR, DEPTH, Pair, PairingRules
from room_layout_ros.runtime.session import CAMERA as CAMERA_STREAM
from room_layout_ros.runtime.session import EstimatorSession, RefusedError, SessionRules

FRAME = room_frame(0)
MS = 1_000_000
T0 = 10**12


def room(frame: RgbdFrame, status: Status = Status.OK) -> RoomEstimate:
    """Return an estimate that says nothing but that there is one (or not)."""
    empty = np.zeros((2, 2), np.uint8)
    cuboid = RoomCuboid(np.eye(3), np.ones(5)) if status is Status.OK else None
    return RoomEstimate(
        status=status, layout=empty, labels=empty, furniture=empty, superpixels=empty.astype(np.int32),
        R_room_camera=np.eye(3), axes_confidence=1.0, confidence=1.0, face_confidence=np.ones(5), cuboid=cuboid,
        polygons=(), timings_ms={"axes": 2.0}, stamp_ns=frame.stamp_ns, frame_id=frame.frame_id,
    )  # fmt: skip


class Stages:
    """Stages that a test can slow down, break, and look at."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.priors: list[TemporalPrior | None] = []
        self.published: list[int] = []
        self.complaints: Counter[str] = Counter()
        self.broken: dict[str, Exception] = {}
        self.status = Status.OK
        self.frame_id = "camera"
        self.floor: FloorPlane | None = None
        self.floors: list[FloorPlane | None] = []
        self.settings: list[Any] = []
        self.gate = threading.Event()
        self.gate.set()
        self.door = threading.Event()
        self.door.set()

    def step(self, name: str) -> None:
        self.calls.append(name)
        if name in self.broken:
            raise self.broken.pop(name)

    def has_estimated(self, number: int) -> bool:
        return self.calls.count("estimate") >= number

    def warm_up(self, settings: Any) -> None:
        self.step("warm_up")

    def assemble(self, pair: Pair[Any], cameras: Mapping[str, Any], settings: Any) -> RgbdFrame:
        self.step("assemble")
        if cameras[CAMERA_STREAM] is None:
            raise RefusedError("no camera_info", "none has come")
        return RgbdFrame(CAMERA, FRAME.color, FRAME.depth_m, pair.stamp_ns, self.frame_id)

    def expect_floor(self, frame: RgbdFrame, settings: Any) -> FloorPlane | None:
        self.calls.append("expect_floor")
        return self.floor

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None, settings: Any) -> RoomEstimate:
        self.gate.wait(5.0)
        self.step("estimate")
        self.priors.append(prior)
        return room(frame, self.status)

    def publish(self, frame: RgbdFrame, estimate: RoomEstimate, floor: FloorPlane | None, settings: Any) -> None:
        self.floors.append(floor)
        self.settings.append(settings)
        self.door.wait(5.0)
        self.step("publish")
        self.published.append(frame.stamp_ns)

    def complain(self, cause: str, sentence: str) -> None:
        self.complaints[cause] += 1
        self.step("complain")

    def now_ns(self) -> int:
        self.step("now_ns")
        return T0 + 50 * MS


@pytest.fixture
def stages() -> Stages:
    return Stages()


@pytest.fixture
def session(stages: Stages) -> Iterator[EstimatorSession]:
    session = EstimatorSession(stages, SessionRules(PairingRules()))
    yield session
    stages.gate.set()
    assert session.close(5.0)


def send(session: EstimatorSession, i: int) -> None:
    for stream in (COLOR, DEPTH):
        session.add_image(stream, T0 + i * 33 * MS, f"{stream} {i}")


def settled(session: EstimatorSession) -> Health:
    """Wait until no pair is in flight and check that the sums hold."""
    wait_for(lambda: session.health().in_flight == 0)
    health = session.health()
    assert health.made == health.published + sum(health.no_estimate.values()) + sum(health.dropped.values())
    for stream in health.streams.values():
        ends = stream.paired + stream.superseded + sum(stream.refused.values()) + stream.waiting
        assert stream.received == ends
    assert health.streams[COLOR].paired == health.streams[DEPTH].paired == health.made
    return health


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_a_pair_is_published_with_its_latency(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    health = settled(session)
    assert (health.made, health.published, stages.published) == (1, 1, [T0])
    assert 0.0 <= health.latency_p50_ms < 5000.0
    assert health.age_p50_ms == 50.0
    assert health.stages_ms["axes"] == 2.0
    assert set(health.stages_ms) == {"axes", "decode", "outputs"}


def test_f03_without_a_camera_every_pair_is_dropped_for_that_reason(session: EstimatorSession, stages: Stages) -> None:
    for i in range(3):
        send(session, i)
        settled(session)
    assert settled(session).dropped == {"no camera_info": 3}
    assert stages.complaints["no camera_info"] == 3
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 3)
    assert settled(session).published == 1


def test_f13_the_newest_frame_wins_when_input_is_too_fast(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.gate.clear()
    send(session, 0)
    wait_for(lambda: "assemble" in stages.calls)
    for i in range(1, 1000):
        send(session, i)
    assert session.health().in_flight == 2
    stages.gate.set()
    health = settled(session)
    assert stages.published == [T0, T0 + 999 * 33 * MS]
    assert (health.made, health.published, health.dropped) == (1000, 2, {"newer frame": 998})


@pytest.mark.parametrize("stage", ("assemble", "estimate", "publish", "now_ns"))
@pytest.mark.parametrize(
    "error", (RuntimeError("boom"), MemoryError(), KeyError("x"), ValueError("bad"), ZeroDivisionError())
)
def test_f40_an_exception_loses_its_frame_only(
    session: EstimatorSession, stages: Stages, stage: str, error: Exception
) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    settled(session)
    stages.broken[stage] = error
    send(session, 1)
    reason = "bad pair" if stage == "assemble" and isinstance(error, ValueError) else "error"
    assert settled(session).dropped == {reason: 1}
    assert stages.complaints[reason] == 1
    send(session, 2)
    assert settled(session).published == 2
    assert stages.published[-1] == T0 + 66 * MS


@pytest.mark.parametrize("stage", ("assemble", "estimate", "publish", "now_ns"))
def test_f40_a_log_that_fails_too_does_not_end_the_worker(
    session: EstimatorSession, stages: Stages, stage: str
) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.broken = {stage: RuntimeError("boom"), "complain": OSError("no log")}
    send(session, 0)
    assert settled(session).dropped == {"error": 1}
    assert "complain" not in stages.broken
    send(session, 1)
    assert settled(session).published == 1


def test_f40_a_frame_that_fails_while_it_is_counted_is_counted_once(
    session: EstimatorSession, stages: Stages, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    with monkeypatch.context() as patch:
        patch.setattr(session._pairs, "stages_ms", None)
        send(session, 0)
        wait_for(lambda: session._pairs.in_flight == 0)
        assert (session._pairs.published, session._pairs.dropped) == (0, {"error": 1})
    send(session, 1)
    assert settled(session).published == 1


def test_f40_a_failed_warm_up_is_told_and_survived(stages: Stages) -> None:
    stages.broken["warm_up"] = OSError("read-only cache")
    session = EstimatorSession(stages)
    wait_for(lambda: session.ready)
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    assert settled(session).published == 1
    assert stages.complaints["warm-up"] == 1
    assert session.close(5.0)


@pytest.mark.parametrize("status", (Status.NO_DEPTH, Status.NO_ROOM, Status.DEADLINE))
def test_an_estimate_without_a_room_is_counted_and_not_published(
    session: EstimatorSession, stages: Stages, status: Status
) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.status = status
    send(session, 0)
    health = settled(session)
    assert (health.no_estimate, health.published, stages.published) == ({status.value: 1}, 0, [])


def test_a_room_of_a_search_that_was_cut_is_published_and_counted(
    session: EstimatorSession, stages: Stages, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stages, "estimate", lambda frame, *_: replace(room(frame), status=Status.DEADLINE))
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    health = settled(session)
    assert (health.published, health.cut, health.no_estimate) == (1, 1, {})
    (estimates,) = [one for one in diagnose(health, Health({}), NodeFacts({})) if one.name == "estimates"]
    assert estimates.values["published, cut at the deadline"] == "1"


def test_a_refused_pair_is_counted_under_its_reason(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.broken["assemble"] = RefusedError("not registered", "sizes differ")
    send(session, 0)
    health = settled(session)
    assert (health.dropped, health.last_drop) == ({"not registered": 1}, "sizes differ")


def test_refused_messages_are_counted_and_do_not_pair(session: EstimatorSession) -> None:
    session.refuse(COLOR, "bad image", "step 0")
    session.refuse(CAMERA_STREAM, "uncalibrated", "zeros")
    health = settled(session)
    assert health.streams[COLOR].refused == {"bad image": 1}
    assert health.streams[COLOR].last_refusal == "step 0"
    assert health.streams[CAMERA_STREAM].refused == {"uncalibrated": 1}


def refusal_of_colour(session: EstimatorSession, *stamps: int) -> str:
    for stamp in stamps:
        session.add_image(COLOR, stamp, "image")
    return settled(session).streams[COLOR].last_refusal


def test_f10_a_refusal_for_the_stamp_says_which_and_why(session: EstimatorSession) -> None:
    send(session, 0)
    assert refusal_of_colour(session, T0) == "color stamp 1000.000 s came twice"
    assert refusal_of_colour(session, T0 - 1) == "color stamp 1000.000 s is older than that of the last pair"
    assert refusal_of_colour(session, 0) == "color stamp 0.000 s is not valid"
    hour = T0 + 3_600_000 * MS
    for i in range(1, 12):
        send(session, i)
        refusal_of_colour(session, hour + i)
    assert refusal_of_colour(session).startswith("color stamp 4600.000 s is far ahead of the other stream")


def test_f10_a_refused_stream_leaves_the_healthy_one_without_a_word(session: EstimatorSession) -> None:
    send(session, 0)
    for i in range(1, 400):
        session.add_image(COLOR, T0 + i * 33 * MS, "image")
        session.refuse(DEPTH, "bad image", "encoding")
    health = settled(session)
    assert (health.streams[COLOR].refused, health.streams[COLOR].last_refusal) == ({}, "")
    assert health.streams[DEPTH].usable_silence_s >= health.streams[DEPTH].silence_s
    assert health.turns_apart <= 1


def test_the_prior_goes_from_frame_to_frame_and_a_jump_ends_it(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    for i in (0, 1, 2, -1000, -999):
        send(session, i)
        settled(session)
    assert [prior is not None for prior in stages.priors] == [False, True, True, False, True]
    assert session.health().resets == 1
    assert stages.complaints["jump of the clock"] == 1


def test_warm_start_off_means_no_prior_at_all(stages: Stages) -> None:
    session = EstimatorSession(stages, SessionRules(warm_start=False))
    session.add_camera(CAMERA_STREAM, 0, "camera")
    for i in range(3):
        send(session, i)
        settled(session)
    assert stages.priors == [None, None, None]
    assert session.close(5.0)


def test_gravity_and_the_floor_of_a_result_are_those_of_one_answer(stages: Stages) -> None:
    stages.floor = FloorPlane(np.array([0.0, 1.0, 0.0]), 1.2, "tf")
    for warm in (True, False):
        session = EstimatorSession(stages, SessionRules(warm_start=warm))
        session.add_camera(CAMERA_STREAM, 0, "camera")
        for i in range(2):
            send(session, i)
            settled(session)
        assert session.close(5.0)
        for prior, axes in zip(stages.priors[-2:], (False, warm), strict=True):
            assert prior is not None
            assert prior.gravity is stages.floor.normal
            assert (prior.R_room_camera is not None) == axes
    assert stages.calls.count("expect_floor") == 4, "once a frame"
    assert stages.floors == [stages.floor] * 4


@pytest.mark.parametrize("passed", (True, False), ids=("pause", "jump"))
def test_f09_a_pause_of_the_camera_is_no_jump_but_ends_the_warm_start(stages: Stages, passed: bool) -> None:
    clock = [10**9]
    session = EstimatorSession(stages, SessionRules(), lambda: clock[0])
    session.add_camera(CAMERA_STREAM, 0, "camera")
    for i in (0, 1, 201, 202):  # 6.6 s between the second and the third
        clock[0] = 10**9 + (i if passed else min(i, 2)) * 33 * MS
        send(session, i)
        settled(session)
    assert session.close(5.0)
    assert [prior is not None for prior in stages.priors] == [False, True, False, True]
    assert session.health().resets == (0 if passed else 1)
    assert stages.complaints["jump of the clock"] == (0 if passed else 1)


def test_f14_a_change_of_frame_id_ends_the_prior_and_is_told(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    settled(session)
    stages.frame_id = "other"
    send(session, 1)
    settled(session)
    assert stages.priors == [None, None]
    assert stages.complaints["frame_id"] == 1


def test_an_error_ends_the_prior(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    settled(session)
    stages.broken["estimate"] = RuntimeError("boom")
    for i in (1, 2, 3):
        send(session, i)
        settled(session)
    assert [prior is not None for prior in stages.priors] == [False, False, True]


def test_reset_drops_what_waits_and_keeps_the_camera(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.gate.clear()
    send(session, 0)
    wait_for(lambda: "assemble" in stages.calls)
    send(session, 1)
    session.add_image(COLOR, T0 + 99 * MS, "alone")
    session.reset()
    stages.gate.set()
    assert settled(session).dropped == {"reset": 2}, "the frame in hand too: a node that is deactivated sends nothing"
    send(session, 2)
    assert settled(session).published == 1


def test_f34_each_frame_uses_one_set_of_settings(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    session.configure(SessionRules(settings="old"))
    stages.gate.clear()
    send(session, 0)
    wait_for(lambda: "assemble" in stages.calls)
    session.configure(SessionRules(settings="new"))
    send(session, 1)
    stages.gate.set()
    settled(session)
    assert stages.settings == ["old", "new"]


def test_lost_messages_are_counted_by_stream(session: EstimatorSession) -> None:
    session.count_lost(DEPTH, 3)
    session.count_lost(DEPTH, 2)
    assert session.health().streams[DEPTH].lost == 5


def test_close_publishes_the_frame_in_hand_and_drops_the_next(stages: Stages) -> None:
    session = EstimatorSession(stages)
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.gate.clear()
    send(session, 0)
    wait_for(lambda: "assemble" in stages.calls)
    send(session, 1)
    threading.Timer(0.1, stages.gate.set).start()
    assert session.close(5.0)
    assert settled(session).dropped == {"shutdown": 1}
    assert stages.published == [T0]


def test_after_a_close_that_could_not_wait_nothing_is_published_and_no_thread_stays(stages: Stages) -> None:
    session = EstimatorSession(stages)
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.gate.clear()
    send(session, 0)
    wait_for(lambda: "assemble" in stages.calls)
    send(session, 1)
    assert not session.close(0.05)
    stages.gate.set()
    wait_for(lambda: not any(t.name.startswith("estimator-") for t in threading.enumerate()))
    assert session.close(5.0)
    send(session, 2)
    assert settled(session).dropped == {"shutdown": 3}
    assert stages.published == []


def test_a_frame_at_the_door_at_the_end_goes_out_and_what_waits_behind_is_counted(stages: Stages) -> None:
    session = EstimatorSession(stages)
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.door.clear()
    send(session, 0)
    wait_for(lambda: stages.settings != [])
    send(session, 1)
    assert not session.close(0.05)
    stages.door.set()
    wait_for(lambda: not any(t.name.startswith("estimator-") for t in threading.enumerate()))
    health = settled(session)
    assert (health.published, health.dropped) == (1, {"shutdown": 1})
    assert stages.published == [T0]


def test_f41_a_pair_overtaken_on_its_way_to_the_worker_does_not_replace_the_newer_one(
    session: EstimatorSession, stages: Stages, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that made pair 1 is held up before it hands it over; meanwhile another one makes pair 2."""
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.gate.clear()
    send(session, 0)
    wait_for(lambda: "assemble" in stages.calls)
    held, submit = threading.Event(), session._loop.submit

    def slow_the_first_time(job: Any) -> None:
        if not held.is_set():
            held.set()
            time.sleep(0.2)
        submit(job)

    monkeypatch.setattr(session._loop, "submit", slow_the_first_time)
    first = threading.Thread(target=send, args=(session, 1))
    first.start()
    assert held.wait(5.0)
    send(session, 2)
    first.join()
    stages.gate.set()
    health = settled(session)
    assert (health.published, health.dropped) == (2, {"newer frame": 1})
    assert stages.published == [T0, T0 + 2 * 33 * MS]


def test_behind_slow_outputs_the_newest_frame_wins(session: EstimatorSession, stages: Stages) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    stages.door.clear()
    send(session, 0)
    wait_for(partial(stages.has_estimated, 1))
    for i in range(1, 5):
        send(session, i)
    assert session.health().in_flight == 2  # one at the door, the newest behind it
    stages.door.set()
    health = settled(session)
    assert stages.published == sorted(stages.published)
    assert len(stages.published) == 2
    assert (health.published, health.dropped) == (2, {"newer frame": 3})


def test_f41_messages_from_many_threads_are_all_accounted_for(session: EstimatorSession) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")

    def send_each_fourth(first: int) -> None:
        for i in range(first, 400, 4):
            send(session, i)

    threads = [threading.Thread(target=send_each_fourth, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    health = settled(session)
    assert health.streams[COLOR].received == health.streams[DEPTH].received == 400


def test_how_long_every_message_has_been_refused_is_known(stages: Stages) -> None:
    clock = [0]
    session = EstimatorSession(stages, SessionRules(PairingRules()), lambda: clock[0])

    def refused_s(stream: str) -> float:
        return session.health().streams[stream].refused_s

    for second in range(4):
        clock[0] = second * 10**9
        session.add_image(COLOR, T0, "color")  # a stamp that stands still
        session.add_image(DEPTH, T0 + second, "depth")
    assert (refused_s(COLOR), refused_s(DEPTH)) == (2.0, 0.0)
    session.add_image(COLOR, T0 + 33 * MS, "color")
    assert refused_s(COLOR) == 0.0
    assert session.close(5.0)


def test_ages_of_stamps_of_another_clock_are_none(session: EstimatorSession) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    send(session, 0)
    assert not settled(session).foreign_stamps
    hour = 3_600_000 * MS
    for stream in (COLOR, DEPTH):
        session.add_image(stream, T0 + 2 * hour, "image")
    health = settled(session)
    assert health.foreign_stamps
    assert np.isnan(health.age_p50_ms)


def test_the_scale_of_the_depth_is_known(session: EstimatorSession) -> None:
    session.add_camera(CAMERA_STREAM, 0, "camera")
    for i in range(3):
        send(session, i)
        health = settled(session)
    assert FRAME.depth_m is not None
    assert health.scales == 3
    assert health.camera_height_m == 1.0, "the floor of `room`"
    assert health.median_depth_m == pytest.approx(float(np.nanmedian(FRAME.depth_m)), rel=0.02)


def test_the_scale_of_a_frame_without_depth_or_floor_is_none() -> None:
    far = RoomCuboid(np.eye(3), np.array([1.0, np.inf, 1.0, 1.0, 1.0]))
    assert measure_scale(replace(FRAME, depth_m=None), room(FRAME)) is None
    assert measure_scale(FRAME, replace(room(FRAME), metric=False)) is None
    for estimate in (replace(room(FRAME), cuboid=far), room(FRAME, Status.NO_DEPTH)):
        scale = measure_scale(FRAME, estimate)
        assert scale is not None
        assert scale.camera_height_m is None
