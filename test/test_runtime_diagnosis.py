"""From counters to words: each fault names its cause, its place and its cure; nothing wrong, nothing said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from room_layout_ros.runtime.diagnosis import Finding, InputFacts, Level, NodeFacts, diagnose
from room_layout_ros.runtime.health import NO_LEVEL_FLOOR, FloorOutcome, Health, PairCount, StreamHealth
from room_layout_ros.runtime.pairing import COLOR, DEPTH
from room_layout_ros.runtime.session import CAMERA, IMU

TOPICS = {COLOR: "/rgb", DEPTH: "/depth", CAMERA: "/info"}
FACTS = NodeFacts(inputs={s: InputFacts(t, publishers=1) for s, t in TOPICS.items()}, listening_s=60.0)
FLOWING = StreamHealth(received=300, paired=300, rate_hz=30.0, silence_s=0.02, usable_silence_s=0.02)
HEALTHY = Health(
    streams=dict.fromkeys(TOPICS, FLOWING), made=300, published=300, rate_hz=30.0, pair_silence_s=0.02,
    latency_p50_ms=20.0,
)  # fmt: skip
BEFORE = replace(HEALTHY, made=270, published=270)


def findings(health: Health = HEALTHY, before: Health = BEFORE, facts: NodeFacts = FACTS) -> dict[str, Finding]:
    return {finding.name: finding for finding in diagnose(health, before, facts)}


def with_stream(stream: str, **changes: Any) -> Health:
    return replace(HEALTHY, streams={**HEALTHY.streams, stream: replace(FLOWING, **changes)})


def with_input(stream: str, **changes: Any) -> NodeFacts:
    return replace(FACTS, inputs={**FACTS.inputs, stream: replace(FACTS.inputs[stream], **changes)})


def test_a_healthy_node_says_so() -> None:
    found = findings()
    assert list(found) == ["input colour", "input depth", "input camera_info", "estimates", "floor"]
    assert {f.level for f in found.values()} == {Level.OK}
    assert found["estimates"].message == "30.0 estimates per second, 20 ms each"


@pytest.mark.parametrize(
    ("stream", "name", "other", "cure"),
    (
        (COLOR, "colour", DEPTH, "use_color: false works on depth alone"),
        (DEPTH, "depth", COLOR, "use_depth: false works on colour alone"),
    ),
)
def test_silence_names_the_stream_its_topic_and_the_publishers(stream: str, name: str, other: str, cure: str) -> None:
    health = with_stream(stream, silence_s=7.2)
    found = findings(health)[f"input {name}"]
    assert (found.level, found.message) == (Level.ERROR, f"no {name} for 7 s on {TOPICS[stream]}; 1 publisher(s) seen")
    facts = with_input(stream, publishers=0)
    alone = findings(health, facts=facts)[f"input {name}"]
    assert alone.message.endswith(f"nobody publishes it; {cure}"), "the other comes"
    facts = replace(facts, inputs={**facts.inputs, other: replace(facts.inputs[other], publishers=0)})
    nobody = findings(health, facts=facts)[f"input {name}"]
    assert nobody.message.endswith("nobody publishes it"), "of both"


def test_a_stream_of_which_every_message_is_refused_is_told_to_the_log() -> None:
    fault = {"received": 330, "refused": {"late": 30}, "last_refusal": "color stamp 1.033 s is older"}
    some = findings(with_stream(COLOR, **fault, refused_s=2.0))["input colour"]
    assert (some.message, some.logged) == ("30 of 30 messages refused: color stamp 1.033 s is older", True)
    every = findings(with_stream(COLOR, **fault, refused_s=12.2))["input colour"]
    assert every.level == Level.ERROR
    assert every.message == "every colour message is refused for 12 s now: color stamp 1.033 s is older"
    assert not every.logged


SIZED = replace(HEALTHY, scales=30, camera_height_m=1.3, median_depth_m=2.4)


@pytest.mark.parametrize(
    ("height_m", "depth_m", "words"),
    (
        (6.5, 9.1, "is the depth unit right for a camera 6.50 m above the floor and a median depth of 9.10 m? 16 bit"),
        (0.12, 0.3, "for a camera 0.12 m above the floor and a median depth of 0.30 m?"),
        (float("nan"), 13.0, "is the depth unit right for a median depth of 13.00 m?"),
    ),
)
def test_a_room_of_another_size_is_a_question_about_the_unit(height_m: float, depth_m: float, words: str) -> None:
    strange = replace(SIZED, camera_height_m=height_m, median_depth_m=depth_m)
    found = findings(strange)["estimates"]
    assert (found.level, found.logged) == (Level.WARN, False)
    assert words in found.message
    empty = replace(strange, published=270, no_estimate={"no depth": 30})
    assert words in findings(empty)["estimates"].message, "too far to be worked"
    assert findings(strange, replace(strange, published=270))["estimates"].level == Level.OK, "no new frame"


def test_time_that_jumps_so_often_that_it_loses_most_frames_is_a_warning() -> None:
    before = replace(HEALTHY, made=0, published=0, dropped={}, resets=0)
    lossy = replace(HEALTHY, made=300, published=10, dropped={"reset": 252}, resets=553)
    found = findings(lossy, before)["estimates"]
    assert found.level == Level.WARN
    assert found.message.startswith("time jumped 553 times since the last report, which lost 252 frames, and 10 were")
    loops = replace(HEALTHY, made=300, published=290, dropped={"reset": 8}, resets=8)
    assert findings(loops, before)["estimates"].level == Level.OK, "a bag of 0.4 s that loops"
    once = replace(HEALTHY, made=1, published=0, dropped={"reset": 1}, resets=1)
    assert findings(once, before)["estimates"].level == Level.OK


@pytest.mark.parametrize(("height_m", "depth_m"), ((1.3, 2.4), (0.2, 0.6), (3.2, 11.0), (float("nan"), float("nan"))))
def test_a_room_of_a_usual_size_is_no_question(height_m: float, depth_m: float) -> None:
    usual = replace(SIZED, camera_height_m=height_m, median_depth_m=depth_m)
    assert findings(usual)["estimates"].level == Level.OK


def test_a_height_that_is_given_is_no_question_about_the_unit() -> None:
    high = replace(SIZED, camera_height_m=6.5)
    assert findings(high, facts=replace(FACTS, floor="tf"))["estimates"].level == Level.OK
    without = replace(FACTS, floor="parameters", no_height="camera_height is 0 (not known)")
    assert findings(high, facts=without)["estimates"].level == Level.WARN
    assert findings(high, facts=replace(FACTS, floor="estimate (no transform)"))["estimates"].level == Level.WARN


def test_ages_are_left_out_where_stamps_are_of_another_clock() -> None:
    assert "age_p50_ms" in findings()["estimates"].values
    values = findings(replace(HEALTHY, foreign_stamps=True))["estimates"].values
    assert not {"age_p50_ms", "age_p99_ms"} & set(values)
    assert values["age"] == "not known, the stamps are not of the node's clock"


def test_a_height_that_no_one_gave_is_said_to_be_of_the_depth() -> None:
    health = replace(HEALTHY, floors=30, last_floor=FloorOutcome("parameters+depth"))
    facts = replace(FACTS, pose_source="parameters", floor="parameters")
    assert findings(health, facts=facts)["floor"].message == "floor from parameters+depth"
    found = findings(health, facts=replace(facts, no_height="camera_height is 0 (not known)"))["floor"]
    assert found.level == Level.OK
    assert found.message == (
        "floor from parameters+depth; its height is taken from the depth: camera_height is 0 (not known)"
    )


def test_silence_counts_from_the_subscription() -> None:
    health = with_stream(COLOR, silence_s=float("inf"))
    assert findings(health, facts=replace(FACTS, listening_s=2.0))["input colour"].level == Level.OK
    assert findings(health, facts=replace(FACTS, listening_s=9.0))["input colour"].message.startswith(
        "no colour for 9 s"
    )


def test_a_latched_camera_info_may_be_silent() -> None:
    assert findings(with_stream(CAMERA, silence_s=900.0, paired=1))["input camera_info"].level == Level.OK
    assert findings(with_stream(CAMERA, silence_s=900.0, paired=0))["input camera_info"].level == Level.ERROR


def test_a_refusal_is_quoted_with_its_count() -> None:
    health = with_stream(DEPTH, received=310, refused={"bad image": 3}, last_refusal="step 0")
    found = findings(health)["input depth"]
    assert (found.level, found.message) == (Level.ERROR, "3 of 10 messages refused: step 0")
    assert found.values["refused: bad image"] == "3"
    assert findings(health, before=health)["input depth"].level == Level.OK, "over when no more come"


def test_messages_lost_on_the_way_name_the_cure() -> None:
    facts = replace(with_input(COLOR, lost_on_way=True), profile="/x/fastdds.xml")
    found = findings(with_stream(COLOR, lost=12), facts=facts)["input colour"]
    assert found.level == Level.WARN
    cure = "start the publisher with FASTRTPS_DEFAULT_PROFILES_FILE=/x/fastdds.xml (larger shared memory; room-layout"
    assert found.message.startswith(f"12 colour messages lost on the way; {cure}")
    assert found.message.endswith("or this machine is too busy")


def test_silence_of_a_publisher_whose_messages_are_lost_on_the_way_names_the_cure() -> None:
    facts = with_input(COLOR, lost_on_way=True)
    found = findings(with_stream(COLOR, silence_s=7.2), facts=facts)["input colour"]
    assert found.level == Level.ERROR
    seen = "1 publisher(s) seen, but all is lost on the way; start the publisher with FASTRTPS_DEFAULT_PROFILES_FILE"
    assert found.message.startswith(f"no colour for 7 s on /rgb; {seen}=")


def test_messages_that_came_and_were_not_taken_blame_no_publisher() -> None:
    found = findings(with_stream(COLOR, lost=12))["input colour"]
    words = "12 colour messages came while this process got no time to take them; this machine is too busy"
    assert (found.level, found.message) == (Level.WARN, words)


def test_a_clash_of_qos_names_topic_and_policy() -> None:
    found = findings(facts=with_input(DEPTH, qos_clash="RELIABILITY"))["input depth"]
    assert found.level == Level.ERROR
    assert "/depth" in found.message
    assert "RELIABILITY" in found.message


def test_two_publishers_are_a_warning() -> None:
    found = findings(facts=with_input(COLOR, publishers=2))["input colour"]
    assert (found.level, found.message) == (Level.WARN, "2 publishers on /rgb; there should be one")


APART = replace(HEALTHY, made=270, published=270, pair_silence_s=8.0, turns_apart=40)


def test_streams_that_do_not_meet_are_explained() -> None:
    found = findings(APART)["estimates"]
    assert found.level == Level.ERROR
    assert "max_stamp_gap = 20 ms" in found.message


@pytest.mark.parametrize(
    "other",
    (
        replace(APART, streams={**APART.streams, COLOR: replace(FLOWING, silence_s=8.0, usable_silence_s=8.0)}),
        replace(APART, streams={**APART.streams, DEPTH: replace(FLOWING, usable_silence_s=float("inf"))}),
        replace(APART, pair_silence_s=0.5),
        replace(APART, turns_apart=1),
    ),
    ids=("one is silent", "one is refused", "they pair and are dropped", "a pause after a refusal"),
)
def test_f09_streams_that_could_not_meet_are_not_said_to_miss_each_other(other: Health) -> None:
    assert (findings(other)["estimates"].level, findings(other)["estimates"].message) == (0, "waiting for frames")


def test_dropped_frames_are_an_error_but_being_slower_than_the_camera_is_none() -> None:
    slow = replace(HEALTHY, dropped={"newer frame": 500})
    assert findings(slow)["estimates"].level == Level.OK
    broken = replace(HEALTHY, dropped={"error": 2}, last_drop="RuntimeError in the estimator: boom")
    found = findings(broken)["estimates"]
    assert (found.level, found.message) == (Level.ERROR, "2 frames dropped: RuntimeError in the estimator: boom")


def test_images_without_a_frame_id_are_a_warning() -> None:
    found = findings(replace(HEALTHY, frame_id=""))["estimates"]
    assert (found.level, found.message.partition(";")[0]) == (Level.WARN, "images have an empty frame_id")
    assert findings(replace(HEALTHY, frame_id="camera"))["estimates"].level == Level.OK


def test_frames_without_an_estimate_name_the_status() -> None:
    found = findings(replace(HEALTHY, no_estimate={"no depth": 4}, published=271))["estimates"]
    assert (found.level, found.message) == (Level.WARN, "4 frames without an estimate (no depth), 1 with")


@pytest.mark.parametrize("state", ("warming up", "idle: nobody listens to an output", "waiting for /clock"))
def test_a_state_that_is_meant_is_no_fault(state: str) -> None:
    quiet = replace(HEALTHY, streams=dict.fromkeys(TOPICS, StreamHealth()))
    found = findings(quiet, facts=replace(FACTS, state=state))
    assert {(f.level, f.message) for f in found.values()} == {(Level.OK, state)}


def test_a_stream_that_is_not_used_is_not_missed() -> None:
    health = with_stream(COLOR, silence_s=float("inf"), received=0, paired=0)
    found = findings(health, facts=with_input(COLOR, wanted=False, publishers=0))
    assert found["input colour"].level == Level.OK
    assert found["estimates"].level == Level.OK


def floor_of(before: Health = BEFORE, facts: NodeFacts = FACTS, **changes: Any) -> tuple[Level, str]:
    found = findings(replace(HEALTHY, **changes), before, facts)["floor"]
    return found.level, found.message


GOOD, DOUBTFUL = FloorOutcome("tf+depth"), FloorOutcome("tf", confirmed=False)
NONE = {"none in view for sure, none given": 7, "too little depth": 1}


def test_f06_the_floor_says_where_it_is_from_and_nothing_where_nobody_wants_it() -> None:
    assert floor_of(floors=30, last_floor=GOOD) == (Level.OK, "floor from tf+depth")
    assert floor_of() == (Level.OK, "nobody listens to an output that needs a floor")
    assert floor_of(published=BEFORE.published) == (Level.OK, "waiting for frames")
    facts = replace(FACTS, floor="tf")
    values = findings(replace(HEALTHY, floors=30, last_floor=DOUBTFUL), facts=facts)["floor"].values
    assert (values["expected"], values["source"], values["frames"]) == ("tf", "tf", "30")


def test_f06_frames_without_a_floor_are_a_warning_while_it_lasts() -> None:
    words = "no floor (none in view for sure, none given) for 8 of 30 frames; outputs that need one send nothing"
    assert floor_of(floors=30, no_floor=NONE, last_floor=GOOD) == (Level.WARN, words)
    over = replace(BEFORE, floors=30, no_floor=NONE)
    assert floor_of(over, floors=60, no_floor=NONE, last_floor=GOOD)[0] == Level.OK
    values = findings(replace(HEALTHY, floors=30, no_floor=NONE))["floor"].values
    assert values["no floor: too little depth"] == "1"


@pytest.mark.parametrize(
    ("outcome", "words"),
    (
        (FloorOutcome("", "too little depth"), "no floor (too little depth) for 1 of 1 frames"),
        (DOUBTFUL, "depth does not confirm the floor where tf expects it for 1 of 1 frames"),
    ),
)
def test_f06_a_warning_lasts_between_the_frames_of_a_slow_camera(outcome: FloorOutcome, words: str) -> None:
    before = replace(BEFORE, floors=30, no_floor=NONE, floors_not_confirmed=3)
    facts = replace(FACTS, floor="tf")
    now: dict[str, Any] = {"floors": 30, "no_floor": NONE, "floors_not_confirmed": 3, "last_floor": outcome}
    level, message = floor_of(before, facts, **now, published=BEFORE.published, floor_silence_s=2.0)
    assert (level, message.partition(";")[0]) == (Level.WARN, words)
    assert floor_of(before, facts, **now, published=BEFORE.published, floor_silence_s=6.0)[0] == Level.OK
    assert floor_of(before, facts, **now, floor_silence_s=2.0)[0] == Level.OK, "nobody listens any more"
    good = {**now, "last_floor": GOOD}
    assert floor_of(before, facts, **good, published=BEFORE.published, floor_silence_s=2.0)[0] == Level.OK


def test_d03_a_floor_that_depth_does_not_confirm_names_its_source() -> None:
    level, words = floor_of(facts=replace(FACTS, floor="tf"), floors=30, floors_not_confirmed=3, last_floor=DOUBTFUL)
    assert level == Level.WARN
    assert words.startswith("depth does not confirm the floor where tf expects it for 3 of 30 frames; check height")
    over = replace(BEFORE, floors=30, floors_not_confirmed=3)
    assert floor_of(over, floors=60, floors_not_confirmed=3, last_floor=GOOD)[0] == Level.OK


@pytest.mark.parametrize(("source", "level"), (("auto", Level.OK), ("tf", Level.WARN), ("imu", Level.WARN)))
def test_f07_a_source_that_was_asked_for_and_gives_nothing_is_a_warning(source: str, level: Level) -> None:
    facts = replace(FACTS, pose_source=source, floor="estimate (x)", floor_missing="x")
    found = findings(facts=facts)["floor"]
    assert found.level == level
    if level:
        assert found.message == f"pose_source is {source}, but x; the floor that is seen decides"


def test_the_floor_says_the_name_of_its_frame() -> None:
    last = replace(GOOD, frame="left_floor")
    assert findings(replace(HEALTHY, floors=30, last_floor=last))["floor"].values["frame"] == "left_floor"
    assert findings()["floor"].values["frame"] == ""


def test_what_lasts_has_one_kind_whatever_its_numbers() -> None:
    """The log tells a fault anew only when its kind changes; messages of a fault change with every second."""

    def kinds(name: str, *healths: Health) -> set[str]:
        return {findings(health)[name].kind for health in healths}

    assert {f.kind for f in findings().values()} == {""}
    lost = [with_stream(COLOR, lost=n) for n in (12, 13)]
    silent = [with_stream(COLOR, silence_s=s) for s in (7.0, 8.0)]
    assert len(kinds("input colour", *lost)) == len(kinds("input colour", *silent)) == 1
    assert len(kinds("input colour", HEALTHY, *lost, *silent)) == 3
    empty = [replace(HEALTHY, no_estimate={status: n}) for n in (3, 4) for status in ("no depth", "no room in view")]
    assert len(kinds("estimates", *empty)) == 2
    assert len(kinds("estimates", *(replace(SIZED, camera_height_m=h) for h in (6.5, 6.6)))) == 1
    floors = [replace(HEALTHY, floors=30, no_floor={reason: n}) for n in (7, 8) for reason in ("a", "b")]
    assert len(kinds("floor", *floors)) == 2
    assert len(kinds("floor", *(replace(HEALTHY, floors=30, floors_not_confirmed=n) for n in (7, 8)))) == 1


def test_what_the_log_has_said_is_told_by_the_finding_not_by_its_words() -> None:
    late = with_stream(COLOR, received=310, refused={"late": 3}, last_refusal="x")
    assert findings(late)["input colour"].logged
    quoted = with_stream(COLOR, lost=3)
    assert not findings(quoted, facts=replace(FACTS, profile="/messages refused/frames dropped"))["input colour"].logged
    assert findings(replace(HEALTHY, dropped={"error": 2}, last_drop="boom"))["estimates"].logged


@pytest.mark.parametrize("wanted", (True, False), ids=("topic", "file"))
def test_images_that_may_be_bent_are_a_warning_that_the_log_has(wanted: bool) -> None:
    found = findings(facts=with_input(CAMERA, wanted=wanted, bent="it is bent"))["input camera_info"]
    assert (found.level, found.message, found.logged) == (Level.WARN, "it is bent", True)
    other = findings(facts=with_input(CAMERA, wanted=wanted, bent="it is bent", foreign="of another"))
    assert other["input camera_info"].message == "of another; it is bent"
    assert not other["input camera_info"].logged
    idle = replace(with_input(CAMERA, wanted=wanted, bent="it is bent"), state="idle")
    assert findings(facts=idle)["input camera_info"].level == Level.OK


@pytest.mark.parametrize(
    ("source", "cure"),
    (
        ("parameters", "is the tilt that parameters gives right (camera_pitch_deg, camera_roll_deg)? If no floor"),
        ("imu", "is the tilt that imu gives right (imu_to_camera)? If no floor is in view, give the camera's height"),
        ("tf", "is the tilt that tf gives right (robot_frame in TF)? If no floor is in view, give the camera's height"),
    ),
)
def test_d03_a_tilt_along_which_no_floor_lies_is_asked_for_in_a_sentence(source: str, cure: str) -> None:
    last, none = FloorOutcome("", NO_LEVEL_FLOOR), {NO_LEVEL_FLOOR: 30}
    facts = replace(FACTS, pose_source=source, floor=source, no_height="camera_height is 0 (not known)")
    level, words = floor_of(facts=facts, floors=30, no_floor=none, last_floor=last)
    assert level == Level.WARN
    assert words.startswith("no floor (nothing level below the camera) for 30 of 30 frames; outputs that need one")
    assert cure in words
    assert findings(facts=facts)["floor"].values["height"] == "taken from the depth: camera_height is 0 (not known)"
    given = findings(facts=replace(facts, no_height=""))["floor"]
    assert given.values["height"] == f"from {source}"


def test_d03_a_floor_that_was_never_seen_though_depth_is_there_is_a_warning_after_a_while() -> None:
    facts, last = replace(FACTS, floor="parameters"), FloorOutcome("parameters", hidden=True)
    assert floor_of(facts=facts, floors=29, floors_hidden=29, last_floor=last) == (Level.OK, "floor from parameters")
    level, words = floor_of(facts=facts, floors=30, floors_hidden=30, last_floor=last)
    assert level == Level.WARN
    assert words == (
        "no floor has been seen yet where parameters expects it, in 30 frames with depth there; check height and tilt "
        "of the camera (camera_height, camera_pitch_deg, camera_roll_deg), unless something hides the floor"
    )
    over = replace(BEFORE, floors=30)
    assert floor_of(over, facts, floors=30, floors_hidden=30, last_floor=last)[0] == Level.OK, "nobody listens"


def test_d03_a_floor_that_was_seen_once_may_be_hidden_until_the_settings_change() -> None:
    count, hidden = PairCount(), FloorOutcome("tf", hidden=True)
    for _ in range(3):
        count.count_floor(hidden, 0)
    assert count.snapshot({}, 0, 0).floors_hidden == 3
    count.count_floor(FloorOutcome("tf+depth", seen=True), 0)
    for _ in range(3):
        count.count_floor(hidden, 0)
    assert count.snapshot({}, 0, 0).floors_hidden == 0
    count.forget_floor()
    count.count_floor(hidden, 0)
    assert count.snapshot({}, 0, 0).floors_hidden == 1


def test_d03_a_floor_that_depth_denies_names_the_parameters_to_check() -> None:
    facts = replace(FACTS, floor="parameters")
    words = floor_of(facts=facts, floors=30, floors_not_confirmed=3, last_floor=DOUBTFUL)[1]
    assert words.endswith("check height and tilt of the camera (camera_height, camera_pitch_deg, camera_roll_deg)")


def with_tf(publishers: int) -> NodeFacts:
    missing = "no transform between 'base_footprint' and 'camera' is known"
    return replace(FACTS, tf_publishers=publishers, floor=f"estimate ({missing})", floor_missing=missing)


def test_auto_says_in_a_sentence_that_tf_is_there_without_the_robot() -> None:
    level, words = floor_of(facts=with_tf(2), floors=30, last_floor=GOOD)
    assert level == Level.OK
    assert words == (
        "TF is there, but no transform between 'base_footprint' and 'camera' is known; the floor is taken from the "
        "picture alone: set robot_frame to the frame of the robot that lies on the floor, z up"
    )
    assert floor_of(facts=with_tf(0), floors=30, last_floor=GOOD)[1] == "floor from tf+depth", "no TF: nothing to say"
    known = replace(with_tf(2), floor="tf", floor_missing="")
    assert floor_of(facts=known, floors=30, last_floor=GOOD)[1] == "floor from tf+depth"
    worse = floor_of(facts=with_tf(2), floors=30, floors_not_confirmed=3, last_floor=DOUBTFUL)
    assert worse[1].startswith("depth does not confirm the floor")
    assert "input tf" not in findings(facts=with_tf(2))


def test_depth_that_is_registered_here_says_where_its_pose_comes_from() -> None:
    assert findings(facts=with_input(DEPTH, extrinsics="TF"))["input depth"].values["extrinsics"] == "TF"
    assert "extrinsics" not in findings()["input depth"].values


@pytest.mark.parametrize(("metric", "words"), ((None, ""), (True, "yes"), (False, "no (front wall is 1)")))
def test_a_room_without_a_scale_is_said_to_have_none(metric: bool | None, words: str) -> None:
    assert findings(replace(HEALTHY, metric=metric))["estimates"].values["metric"] == words


WITH_IMU = replace(FACTS, inputs={**FACTS.inputs, IMU: InputFacts("/imu", publishers=1)}, pose_source="imu")


def imu_of(now: StreamHealth, facts: NodeFacts = WITH_IMU) -> tuple[Level, str]:
    before = replace(BEFORE, streams={**BEFORE.streams, IMU: StreamHealth(received=100, paired=90)})
    found = findings(replace(HEALTHY, streams={**HEALTHY.streams, IMU: now}), before, facts)["input imu"]
    return found.level, found.message


def test_f07_an_imu_that_is_silent_or_of_no_use_is_a_warning_with_topic_and_reason() -> None:
    assert imu_of(replace(FLOWING, rate_hz=200.0)) == (Level.OK, "imu at 200.0 Hz")
    nobody = replace(WITH_IMU, inputs={**FACTS.inputs, IMU: InputFacts("/imu", publishers=0)})
    silent = StreamHealth(received=100, paired=90)
    assert imu_of(silent, nobody) == (Level.WARN, "no imu for 60 s on /imu; nobody publishes it")
    useless = replace(FLOWING, received=140, paired=90, refused={"not gravity": 50}, last_refusal="1.0 m/s^2")
    assert imu_of(useless) == (Level.WARN, "no imu reading can be used: 1.0 m/s^2")
    assert imu_of(useless, replace(WITH_IMU, state="inactive")) == (Level.OK, "inactive")


def test_f07_a_robot_that_brakes_is_no_fault_of_its_imu() -> None:
    braking = replace(FLOWING, received=140, paired=120, refused={"not gravity": 20}, last_refusal="13.0 m/s^2")
    assert imu_of(braking) == (Level.OK, "imu at 30.0 Hz")
