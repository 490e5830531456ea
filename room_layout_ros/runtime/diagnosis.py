"""From counters to plain words: what is wrong with the streams, where, and what cures it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from math import isnan
from typing import NamedTuple

from .health import NO_LEVEL_FLOOR, Health, StreamHealth
from .pairing import COLOR, DEPTH
from .session import CAMERA, CAMERAS, DEPTH_CAMERA, IMU

NAMES = {IMU: "imu", COLOR: "colour", DEPTH: "depth", CAMERA: "camera_info", DEPTH_CAMERA: "camera_info of depth"}


_ALONE = {
    COLOR: (DEPTH, "use_color: false works on depth alone"),
    DEPTH: (COLOR, "use_depth: false works on colour alone"),
}
"""The stream that may do without another, and how."""


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class InputFacts:
    """What the graph says about one input."""

    topic: str
    """Resolved name."""
    wanted: bool = True
    """False where the settings do without this stream."""
    publishers: int = 0
    qos_clash: str = ""
    """Name of the policy that keeps a publisher from us, or ""."""
    extrinsics: str = ""
    """Where the pose of the camera that this image is registered to comes from, or "" where it is not registered."""
    bent: str = ""
    """What is odd about a camera by itself, which the log has said: not rectified, of another size; "" if nothing."""
    foreign: str = ""
    """Why a camera may not be that of the images; "" where it is."""
    elsewhere: str = ""
    """Topic of another transport that is published in the place of this one, and what takes it; "" where none is."""
    lost_on_way: bool = False
    """True where the middleware told of messages that it lost; those that nobody took in time it does not count."""


@dataclass(frozen=True, slots=True)
class NodeFacts:
    """What the node knows beside the counters."""

    inputs: Mapping[str, InputFacts]
    """By stream."""
    state: str = "running"
    """running, warming up, waiting for /clock, or idle (no listener)."""
    listening_s: float = 0.0
    """Time since the inputs were subscribed."""
    no_data_timeout_s: float = 5.0
    max_stamp_gap_s: float = 0.02
    profile: str = "config/fastdds.xml"
    """Path of the DDS profile that cures lost images."""
    pose_source: str = "auto"
    floor: str = ""
    """Where the floor of the last frame was expected from."""
    floor_missing: str = ""
    """Why `pose_source` could not say where the floor is; "" where it could."""
    no_height: str = ""
    """Why `pose_source` says where down is, but not how high the camera is; "" where it says both or neither."""
    tf_publishers: int = 0
    """Of TF, but our own, where the floor may come from it."""
    transforms: str = ""
    """Which transforms were not known at the time of a frame; "" where none."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of /diagnostics."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str] = field(default_factory=dict)
    logged: bool = False
    """True where the log has said it already, when it happened."""
    kind: str = ""
    """What is wrong, without the numbers that change while it lasts; "" where nothing is."""


class _Said(NamedTuple):
    """The part of a finding that is decided first; the fields are those of `Finding`."""

    level: Level
    message: str
    kind: str = ""
    logged: bool = False


def diagnose(health: Health, before: Health, facts: NodeFacts) -> list[Finding]:
    """Return the state of every input, the estimates and the floor; `before` is the snapshot of the last call."""
    findings = [_input(s, health.streams[s], before.streams[s], facts) for s in facts.inputs]
    return [*findings, _estimates(health, before, facts), _floor(health, before, facts)]


def _input(stream: str, now: StreamHealth, before: StreamHealth, facts: NodeFacts) -> Finding:
    said = (_imu_state if stream == IMU else _input_state)(stream, now, before, facts)
    values = {
        "topic": facts.inputs[stream].topic,
        "publishers": str(facts.inputs[stream].publishers),
        "rate_hz": f"{now.rate_hz:.1f}",
        "silence_s": f"{now.silence_s:.1f}",
        "received": str(now.received),
        "paired": str(now.paired),
        "superseded": str(now.superseded),
        "waiting": str(now.waiting),
        "lost": str(now.lost),
        **{f"refused: {reason}": str(n) for reason, n in sorted(now.refused.items())},
    }
    if facts.inputs[stream].extrinsics:
        values["extrinsics"] = facts.inputs[stream].extrinsics
    return Finding(f"input {NAMES[stream]}", said.level, said.message, values, said.logged, said.kind)


def _input_state(stream: str, now: StreamHealth, before: StreamHealth, facts: NodeFacts) -> _Said:
    name, graph = NAMES[stream], facts.inputs[stream]
    if not graph.wanted:
        doubt = _camera_doubt(graph) if facts.state == "running" else None
        return doubt or _Said(Level.OK, f"{name} is not used (parameter)")
    if facts.state != "running":
        return _Said(Level.OK, facts.state)
    if graph.qos_clash:
        words = f"no {name}: a publisher of {graph.topic} has another QoS policy {graph.qos_clash}"
        return _Said(Level.ERROR, words, f"QoS {graph.qos_clash}")
    refused = sum(now.refused.values()) - sum(before.refused.values())
    if refused and now.last_refusal and now.refused_s > facts.no_data_timeout_s:
        words = f"every {name} message is refused for {now.refused_s:.0f} s now: {now.last_refusal}"
        return _Said(Level.ERROR, words, "every message refused")
    if refused and now.last_refusal:
        words = f"{refused} of {now.received - before.received} messages refused: {now.last_refusal}"
        return _Said(Level.ERROR, words, "messages refused", logged=True)
    silence = min(now.silence_s, facts.listening_s)
    if silence > facts.no_data_timeout_s and not (stream in CAMERAS and now.paired):
        seen = _publishers_seen(stream, facts)
        return _Said(Level.ERROR, f"no {name} for {silence:.0f} s on {graph.topic}; {seen}", f"silence, {seen}")
    doubt = _camera_doubt(graph)
    if doubt:
        return doubt
    if now.lost > before.lost:
        return _loss(now.lost - before.lost, name, graph, facts)
    if graph.publishers > 1:
        words = f"{graph.publishers} publishers on {graph.topic}; there should be one"
        return _Said(Level.WARN, words, "publishers")
    return _Said(Level.OK, f"{name} at {now.rate_hz:.1f} Hz")


def _loss(number: int, name: str, graph: InputFacts, facts: NodeFacts) -> _Said:
    if not graph.lost_on_way:
        words = f"{number} {name} messages came while this process got no time to take them; this machine is too busy"
        return _Said(Level.WARN, words, "messages not taken")
    words = f"{number} {name} messages lost on the way; {_profile_cure(facts)}"
    return _Said(Level.WARN, words, "messages lost")


def _profile_cure(facts: NodeFacts) -> str:
    return (
        f"start the publisher with FASTRTPS_DEFAULT_PROFILES_FILE={facts.profile} (larger shared memory; "
        "room-layout play has it), or this machine is too busy"
    )


def _publishers_seen(stream: str, facts: NodeFacts) -> str:
    graph = facts.inputs[stream]
    if graph.publishers:
        lost = f", but all is lost on the way; {_profile_cure(facts)}" if graph.lost_on_way else ""
        return f"{graph.publishers} publisher(s) seen{lost}"
    if graph.elsewhere:
        return f"nobody publishes it, but {graph.elsewhere}"
    other, cure = _ALONE.get(stream, ("", ""))
    there = other in facts.inputs and facts.inputs[other].publishers
    return f"nobody publishes it; {cure}" if there else "nobody publishes it"


def _camera_doubt(graph: InputFacts) -> _Said | None:
    """Return what is odd about a camera whose images are used all the same."""
    words = "; ".join(text for text in (graph.foreign, graph.bent) if text)
    return _Said(Level.WARN, words, words, logged=not graph.foreign) if words else None


def _imu_state(stream: str, now: StreamHealth, before: StreamHealth, facts: NodeFacts) -> _Said:
    """Return the state of an input that the node can do without; a reading refused now and then is no fault."""
    said = _input_state(stream, replace(now, last_refusal=""), before, facts)
    came, used = now.received - before.received, now.paired - before.paired
    if facts.state == "running" and came and not used:
        return _Said(Level.WARN, f"no imu reading can be used: {now.last_refusal}", "no imu reading can be used")
    return said._replace(level=min(said.level, Level.WARN))


def _estimates(health: Health, before: Health, facts: NodeFacts) -> Finding:
    said = _estimates_state(health, before, facts)
    values = {
        "rate_hz": f"{health.rate_hz:.1f}",
        "pairs": str(health.made),
        "published": str(health.published),
        **({"published, cut at the deadline": str(health.cut)} if health.cut else {}),
        "in_flight": str(health.in_flight),
        **{f"no estimate: {status}": str(n) for status, n in sorted(health.no_estimate.items())},
        **{f"dropped: {reason}": str(n) for reason, n in sorted(health.dropped.items())},
        "resets": str(health.resets),
        "metric": _METRIC[health.metric],
        "latency_p50_ms": f"{health.latency_p50_ms:.1f}",
        "latency_p99_ms": f"{health.latency_p99_ms:.1f}",
        **_ages(health),
        **{f"stage_ms: {stage}": f"{ms:.2f}" for stage, ms in health.stages_ms.items()},
    }
    return Finding("estimates", said.level, said.message, values, said.logged, said.kind)


def _ages(health: Health) -> dict[str, str]:
    if health.foreign_stamps:
        return {"age": "not known, the stamps are not of the node's clock"}
    return {"age_p50_ms": f"{health.age_p50_ms:.1f}", "age_p99_ms": f"{health.age_p99_ms:.1f}"}


_METRIC = {None: "", True: "yes", False: "no (front wall is 1)"}
_RESET = "reset"
_HARMLESS = ("newer frame", _RESET, "shutdown")


def _estimates_state(health: Health, before: Health, facts: NodeFacts) -> _Said:
    if facts.state != "running":
        return _Said(Level.OK, facts.state)
    bad = {r: n - before.dropped.get(r, 0) for r, n in health.dropped.items() if r not in _HARMLESS}
    if any(bad.values()):
        words = f"{sum(bad.values())} frames dropped: {health.last_drop}"
        return _Said(Level.ERROR, words, "frames dropped", logged=True)
    jumped = _time_jumps(health, before)
    if jumped:
        return _Said(Level.WARN, jumped, "time jumps")
    question = _unit_question(health, facts) if health.scales > before.scales else ""
    if question:
        return _Said(Level.WARN, question, "depth unit")
    published = health.published - before.published
    empty = {s: n - before.no_estimate.get(s, 0) for s, n in health.no_estimate.items()}
    if any(empty.values()):
        status = max(empty, key=lambda s: empty[s])
        words = f"{sum(empty.values())} frames without an estimate ({status}), {published} with"
        return _Said(Level.WARN, words, f"no estimate: {status}")
    if published and health.frame_id == "":
        words = "images have an empty frame_id; TF and RViz cannot place the results: let the driver set it"
        return _Said(Level.WARN, words, "empty frame_id")
    if published:
        return _Said(Level.OK, f"{health.rate_hz:.1f} estimates per second, {health.latency_p50_ms:.0f} ms each")
    if _is_apart(health, facts):
        words = (
            f"colour and depth arrive but do not pair; their stamps must differ by at most max_stamp_gap = "
            f"{facts.max_stamp_gap_s * 1e3:.0f} ms, and queue_size must hold the messages that wait for a late stream"
        )
        return _Said(Level.ERROR, words, "no pairs")
    return _Said(Level.OK, "waiting for frames")


_LEAST_JUMPS = 2
"""A bag that loops, or a simulation that is reset, jumps once."""


def _time_jumps(health: Health, before: Health) -> str:
    """Say that time jumps so often that more frames are lost by it than published; "" where it does not."""
    lost = health.dropped.get(_RESET, 0) - before.dropped.get(_RESET, 0)
    published, jumps = health.published - before.published, health.resets - before.resets
    if jumps < _LEAST_JUMPS or lost <= published:
        return ""
    return (
        f"time jumped {jumps} times since the last report, which lost {lost} frames, and {published} were published; "
        "do two publish /clock, or one of the images?"
    )


_HIGHEST_M, _LOWEST_M, _FARTHEST_M = 3.5, 0.15, 12.0
"""A camera higher or lower over the floor, or a median depth above this, is rare in a room, and usual of depth in
another unit than that of its encoding."""


def _unit_question(health: Health, facts: NodeFacts) -> str:
    """Return the question whether depth has the right unit, and what answers it; "" where it looks right."""
    given = facts.floor in _GIVES_HEIGHT and not facts.no_height
    question = depth_unit_question(health.median_depth_m, health.camera_height_m, given)
    cure = "; if it is, give the camera's height by TF or pose_source: parameters"
    return f"{question}{cure}" if question and not given and _is_strange(health.camera_height_m) else question


def depth_unit_question(median_depth_m: float, camera_height_m: float, height_given: bool = False) -> str:
    """Ask whether the depth has the right unit where the room looks too large or too small by it; "" where it does not.

    A height (NaN where it is not known) that was given, not measured, tells nothing.
    """
    strange = not height_given and _is_strange(camera_height_m)
    if not (strange or median_depth_m > _FARTHEST_M):
        return ""
    camera = "" if isnan(camera_height_m) else f"a camera {camera_height_m:.2f} m above the floor and "
    return (
        f"is the depth unit right for {camera}a median depth of {median_depth_m:.2f} m? "
        "16 bit must be millimetres, float metres"
    )


def _is_strange(camera_height_m: float) -> bool:
    return camera_height_m > _HIGHEST_M or camera_height_m < _LOWEST_M


_GIVES_HEIGHT = ("tf", "imu", "parameters")
_TURNS_APART = 6
"""So often have the streams to alternate without a pair: a few pairs are late where stamps are not equal."""


def _is_apart(health: Health, facts: NodeFacts) -> bool:
    """Return whether both streams bring images that could be used, and none of them meet."""
    limit = facts.no_data_timeout_s
    arriving = all(health.streams[s].usable_silence_s < limit for s in (COLOR, DEPTH) if s in health.streams)
    return arriving and health.turns_apart >= _TURNS_APART and min(health.pair_silence_s, facts.listening_s) > limit


def _floor(health: Health, before: Health, facts: NodeFacts) -> Finding:
    said = _floor_state(health, before, facts)
    values = {
        "expected": facts.floor,
        "height": _height(facts),
        "source": health.last_floor.source if health.last_floor else "",
        "frame": health.last_floor.frame if health.last_floor else "",
        "frames": str(health.floors),
        **{f"no floor: {reason}": str(n) for reason, n in sorted(health.no_floor.items())},
        "not confirmed": str(health.floors_not_confirmed),
        "transforms": facts.transforms,
    }
    return Finding("floor", said.level, said.message, values, said.logged, said.kind)


def _height(facts: NodeFacts) -> str:
    """Say where the height of the camera over the floor comes from."""
    if facts.floor in _GIVES_HEIGHT and not facts.no_height:
        return f"from {facts.floor}"
    return f"taken from the depth: {facts.no_height}" if facts.no_height else "taken from the depth"


def _floor_state(health: Health, before: Health, facts: NodeFacts) -> _Said:
    if facts.state != "running":
        return _Said(Level.OK, facts.state)
    wrong, kind = _floor_fault(health, before, facts)
    if facts.floor_missing and facts.pose_source != "auto":
        source = f"pose_source is {facts.pose_source}, but {facts.floor_missing}; the floor that is seen decides"
        wrong, kind = (f"{wrong}; {source}" if wrong else source), f"{kind}; {facts.floor_missing}"
    if wrong:
        return _Said(Level.WARN, wrong, kind)
    if facts.floor_missing and facts.tf_publishers:
        return _Said(
            Level.OK,
            f"TF is there, but {facts.floor_missing}; the floor is taken from the picture alone: "
            "set robot_frame to the frame of the robot that lies on the floor, z up",
        )
    if health.last_floor is not None and health.floors > before.floors:
        taken = f"; its height is {_height(facts)}" if facts.no_height else ""
        return _Said(Level.OK, f"floor from {health.last_floor.source}{taken}")
    if health.published > before.published:
        return _Said(Level.OK, "nobody listens to an output that needs a floor")
    return _Said(Level.OK, "waiting for frames")


def _floor_fault(health: Health, before: Health, facts: NodeFacts) -> tuple[str, str]:
    """Return what is wrong with the floors since the last call, in a sentence and by its kind; "" where nothing is."""
    asked, doubtful = health.floors - before.floors, health.floors_not_confirmed - before.floors_not_confirmed
    missing = {reason: n - before.no_floor.get(reason, 0) for reason, n in health.no_floor.items()}
    last = health.last_floor
    if asked == 0 and last is not None and _floor_lasts(health, before, facts):
        asked, doubtful, missing = 1, int(not last.confirmed), {last.missing: int(bool(last.missing))}
    if any(missing.values()):
        reason = max(missing, key=lambda r: missing[r])
        cure = f"; {_level_cure(facts)}" if reason == NO_LEVEL_FLOOR else ""
        return (
            f"no floor ({reason}) for {sum(missing.values())} of {asked} frames; "
            f"outputs that need one send nothing{cure}"
        ), f"no floor: {reason}"
    if doubtful:
        return (
            f"depth does not confirm the floor where {facts.floor} expects it for {doubtful} of {asked} frames; "
            f"check height and tilt of the camera{_POSE_PARAMETERS.get(facts.floor, '')}"
        ), "floor not confirmed"
    if health.floors_hidden >= _HIDDEN_FRAMES and (asked or _floor_lasts(health, before, facts)):
        return (
            f"no floor has been seen yet where {facts.floor} expects it, in {health.floors_hidden} frames with depth "
            f"there; check height and tilt of the camera{_POSE_PARAMETERS.get(facts.floor, '')}, "
            "unless something hides the floor"
        ), "floor not seen yet"
    return "", ""


_HIDDEN_FRAMES = 30
"""A robot that starts in front of a wall should have turned by then."""


_POSE_PARAMETERS = {
    "parameters": " (camera_height, camera_pitch_deg, camera_roll_deg)",
    "imu": " (camera_height, imu_to_camera)",
    "tf": " (robot_frame in TF)",
}
"""What a user would set, by where the floor is expected from."""


def _level_cure(facts: NodeFacts) -> str:
    """Return what may be wrong where a source gives the tilt alone and nothing lies level below the camera."""
    where = _POSE_PARAMETERS.get(facts.floor, "").replace("camera_height, ", "")
    return f"is the tilt that {facts.floor} gives right{where}? If no floor is in view, give the camera's height too"


def _floor_lasts(health: Health, before: Health, facts: NodeFacts) -> bool:
    """Return whether the last floor still counts: no frame has come since, as between those of a slow camera."""
    return health.published == before.published and health.floor_silence_s <= facts.no_data_timeout_s
