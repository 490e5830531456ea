"""A running estimator: streams in, estimates out, every message and every pair accounted for. Knows no ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.floor.floor_plane import FloorPlane
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.tracking import TemporalPrior, next_prior

from .camera_history import CameraHistory
from .depth_scale import DepthScale, measure_scale
from .health import FloorOutcome, Health, PairCount, StreamTimes, stream_snapshot
from .live_loop import LiveLoop
from .pairing import COLOR, DEPTH, FORWARD_JUMPS, STAMP_FAULTS, Pair, PairingRules, StreamCount, StreamPairing

CAMERA, DEPTH_CAMERA = "camera_info", "depth_camera_info"
CAMERAS = (CAMERA, DEPTH_CAMERA)
IMU = "imu"
STREAMS = (COLOR, DEPTH, *CAMERAS, IMU)

JUMP = "jump of the clock"
"""The cause under which stamps that jump are complained of."""


class RefusedError(ValueError):
    """A message or pair that cannot be used: `reason` is what it is counted under, the text says what is wrong."""

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason


class Stages(Protocol):
    """What the session calls, in this order, from its threads. One call of each per frame."""

    def assemble(self, pair: Pair[Any], cameras: Mapping[str, Any], settings: Any) -> RgbdFrame:
        """Decode a pair with the cameras of its time (None where none has come).

        Raises RefusedError or ValueError when it is no frame.
        """
        ...

    def warm_up(self, settings: Any) -> None:
        """Compile and load everything; called once, before the first frame."""

    def expect_floor(self, frame: RgbdFrame, settings: Any) -> FloorPlane | None:
        """Return where the floor is expected in the camera frame, and with it which way is down; None if not known."""
        ...

    def estimate(self, frame: RgbdFrame, prior: TemporalPrior | None, settings: Any) -> RoomEstimate:
        """Estimate the room."""
        ...

    def publish(
        self, frame: RgbdFrame, estimate: RoomEstimate, floor: FloorPlane | None, settings: Any
    ) -> FloorOutcome | None:
        """Send the results; say what became of the floor, None where nobody wanted it.

        `floor` is what `expect_floor` said of the frame.
        """
        ...

    def complain(self, cause: str, sentence: str) -> None:
        """Log (at most one line per second and cause)."""

    def now_ns(self) -> int:
        """Time on the clock of the stamps."""
        ...


@dataclass(frozen=True, slots=True)
class SessionRules:
    """Settings of the session.

    Attributes
    ----------
    settings : handed to each stage; a frame gets those that held when work on it began, at every stage.
    """

    pairing: PairingRules = field(default_factory=PairingRules)
    warm_start: bool = True
    settings: Any = None


@dataclass(frozen=True, slots=True)
class _Job:
    pair: Pair[Any]
    arrival_ns: int
    epoch: int


@dataclass(frozen=True, slots=True)
class _Result:
    job: _Job
    frame: RgbdFrame
    estimate: RoomEstimate
    floor: FloorPlane | None
    settings: Any
    decode_ms: float
    scale: DepthScale | None


class EstimatorSession:
    """Takes messages from any thread; estimates and publishes in a thread of its own, one frame after the other.

    Publishing in a third thread, beside the next estimate, made no more results per second on two cores (19 and 19),
    and each a third older (98 ms and 73): the estimate uses both cores itself.

    Parameters
    ----------
    stages : Stages
    rules : SessionRules
    clock : callable
        Monotonic nanoseconds.
    """

    def __init__(
        self, stages: Stages, rules: SessionRules | None = None, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._stages, self._clock = stages, clock
        self._rules = rules or SessionRules()
        self._lock = threading.RLock()  # handing a pair over drops the one before, which is counted under the lock too
        self._pairing: StreamPairing[Any] = StreamPairing(self._rules.pairing)
        self._cameras: dict[str, CameraHistory[Any]] = {s: CameraHistory() for s in CAMERAS}
        self._counts = {s: StreamCount() for s in (*CAMERAS, IMU)}
        self._pairs = PairCount()
        self._times = {stream: StreamTimes() for stream in STREAMS}
        self._epoch = 0
        self._prior: TemporalPrior | None = None
        self._prior_epoch = self._prior_ns = 0
        self._origin: tuple[object, str] | None = None
        self._closed = False
        self._loop: LiveLoop[_Job] = LiveLoop(self._warm_up, self._work, self._dropped)

    @property
    def ready(self) -> bool:
        """True after the warm-up."""
        return self._loop.ready.is_set()

    def configure(self, rules: SessionRules) -> None:
        """Change the settings; they hold from the next message and frame on."""
        with self._lock:
            self._rules = rules
            self._pairing.configure(rules.pairing)
            self._pairs.forget_floor()

    def add_image(self, stream: str, stamp_ns: int, item: object) -> None:
        """Take a checked image of COLOR or DEPTH."""
        now = self._clock()
        with self._lock:
            self._times[stream].all.tick(now)
            self._times[stream].usable.tick(now)
            refused = self._pairing.counts[stream].refused.total()
            pair = self._pairing.add(stream, stamp_ns, item, now)
            if self._pairing.counts[stream].refused.total() > refused:
                reason, stamp = self._pairing.last_fault[stream]
                sentence = f"{stream} stamp {stamp * 1e-9:.3f} s {STAMP_FAULTS[reason]}"
                self._times[stream].note_refusal(sentence, now)
            else:
                self._times[stream].refused_since_ns = None
            if pair is None:
                return
            self._pairs.made += 1
            self._pairs.pairs.tick(now)
            if pair.reset:
                self._restart()
            # Under the lock: pairs of two threads reach the worker in the order in which they were made.
            self._loop.submit(_Job(pair, now, self._epoch))
        if pair.reset:
            self._stages.complain(JUMP, "stamps jumped; everything known from before is forgotten")

    def add_camera(self, stream: str, stamp_ns: int, camera: object) -> bool:
        """Take a checked camera of CAMERA or DEPTH_CAMERA (stamp 0: none); return True if it differs from the last."""
        with self._lock:
            self._take(stream)
            return self._cameras[stream].add(stamp_ns, camera)

    def newest_camera(self, stream: str) -> Any:
        """Return the camera of CAMERA or DEPTH_CAMERA that came last; None before the first."""
        with self._lock:
            return self._cameras[stream].newest

    def set_camera(self, stream: str, camera: object) -> None:
        """Take a camera that came by no message and holds at all times."""
        with self._lock:
            self._cameras[stream].add(0, camera)

    def count_used(self, stream: str) -> None:
        """Count a message that was used at once, outside of the pairs (IMU)."""
        with self._lock:
            self._take(stream)

    def _take(self, stream: str) -> None:
        self._times[stream].all.tick(self._clock())
        self._times[stream].usable.tick(self._clock())
        self._times[stream].refused_since_ns = None
        self._counts[stream].received += 1
        self._counts[stream].paired += 1

    def refuse(self, stream: str, reason: str, sentence: str) -> None:
        """Count a message that could not be used and say why."""
        self.count_refused(stream, reason, sentence)
        self._stages.complain(f"{stream}: {reason}", sentence)

    def count_refused(self, stream: str, reason: str, sentence: str) -> None:
        """Count a message that could not be used, without a word in the log."""
        with self._lock:
            now = self._clock()
            self._times[stream].all.tick(now)
            self._times[stream].note_refusal(sentence, now)
            if stream in self._counts:
                self._counts[stream].received += 1
                self._counts[stream].refused[reason] += 1
            else:
                self._pairing.refuse(stream, reason)

    def count_lost(self, stream: str, number: int) -> None:
        """Count messages that were sent and never came."""
        with self._lock:
            self._times[stream].lost += number

    def reset(self) -> None:
        """Forget all that came before; what waits is dropped. The newest camera stays."""
        with self._lock:
            self._pairing.reset()
            for times in self._times.values():
                times.refused_since_ns = None
            self._restart()
            self._loop.discard("reset")

    def health(self) -> Health:
        """Return all counters as one consistent value."""
        with self._lock:
            now = self._clock()
            counts = {**self._pairing.counts, **self._counts}
            streams = {s: stream_snapshot(counts[s], self._times[s], now) for s in STREAMS}
            return self._pairs.snapshot(streams, self._pairing.turns_apart, now)

    def close(self, timeout_s: float = 1.0) -> bool:
        """End the thread; False if it is still busy after `timeout_s`.

        It ends by itself after the frame in hand, which is then counted as dropped and not published.
        """
        ended = self._loop.close(timeout_s)
        self._closed = True
        return ended

    def _restart(self) -> None:
        self._epoch += 1
        self._pairs.resets += 1
        for cameras in self._cameras.values():
            cameras.reset()

    def _dropped(self, job: _Job, reason: str, sentence: str = "") -> None:
        with self._lock:
            self._pairs.dropped[reason] += 1
            if sentence:
                self._pairs.last_drop = sentence
        if sentence:
            self._tell(reason, sentence)

    def _tell(self, cause: str, sentence: str) -> None:
        """Complain from the worker thread, which a log that fails must not end."""
        with suppress(Exception):
            self._stages.complain(cause, sentence)

    def _warm_up(self) -> None:
        try:
            self._stages.warm_up(self._rules.settings)
        except Exception as error:  # noqa: BLE001
            self._tell("warm-up", f"warm-up failed ({type(error).__name__}: {error}); expect a slow start")

    def _work(self, job: _Job) -> None:
        """Estimate one pair, whatever happens: this is the guarded edge of the worker thread."""
        try:
            result = self._process(job)
        except RefusedError as refused:
            self._dropped(job, refused.reason, str(refused))
        except Exception as error:  # noqa: BLE001
            self._prior = None
            self._lose(job, error)
        else:
            if self._closed:
                self._dropped(job, "shutdown")
            elif job.epoch != self._epoch:
                self._dropped(job, "reset")
            else:
                self._send(result)

    def _process(self, job: _Job) -> _Result:
        start = self._clock()
        with self._lock:
            cameras = {s: history.at(job.pair.stamp_ns) for s, history in self._cameras.items()}
            rules = self._rules
        try:
            frame = self._stages.assemble(job.pair, cameras, rules.settings)
        except RefusedError:
            raise
        except ValueError as error:
            raise RefusedError("bad pair", str(error)) from error
        self._follow_origin(frame)
        decoded = self._clock()
        # After a pause the room may be another one: axes that a jump of the stamps would forget are not handed on.
        fresh = frame.stamp_ns - self._prior_ns <= FORWARD_JUMPS * rules.pairing.reset_gap_ns
        warm = self._prior if rules.warm_start and fresh and self._prior_epoch == job.epoch else None
        floor = self._stages.expect_floor(frame, rules.settings)
        prior = _with_gravity(warm, floor)
        estimate = self._stages.estimate(frame, prior, rules.settings)
        self._prior, self._prior_epoch, self._prior_ns = next_prior(estimate), job.epoch, frame.stamp_ns
        scale = measure_scale(frame, estimate)
        return _Result(job, frame, estimate, floor, rules.settings, (decoded - start) * 1e-6, scale)

    def _send(self, result: _Result) -> None:
        """Publish and count one result, whatever happens."""
        try:
            start, outcome = self._clock(), None
            if result.estimate.cuboid is not None:
                outcome = self._stages.publish(result.frame, result.estimate, result.floor, result.settings)
            own_ms = {"decode": result.decode_ms, "outputs": (self._clock() - start) * 1e-6}
            self._finish(result, {**result.estimate.timings_ms, **own_ms}, outcome)
        except Exception as error:  # noqa: BLE001
            self._lose(result.job, error)

    def _lose(self, job: _Job, error: Exception) -> None:
        self._dropped(job, "error", f"{type(error).__name__} in the estimator: {error}; this frame is lost")

    def _follow_origin(self, frame: RgbdFrame) -> None:
        """Another camera or frame id is another scene: what was known of the old one does not hold."""
        before, self._origin = self._origin, (frame.camera, frame.frame_id)
        if before is None or before == self._origin:
            return
        self._prior = None
        with self._lock:
            self._pairs.resets += 1
        if before[1] != frame.frame_id:
            names = f"from {before[1][:40]!r} to {frame.frame_id[:40]!r}"
            self._stages.complain("frame_id", f"frame_id changed {names}; starting afresh")

    def _finish(self, result: _Result, stages_ms: Mapping[str, float], floor: FloorOutcome | None) -> None:
        estimate = result.estimate
        age_ms = (self._stages.now_ns() - result.frame.stamp_ns) * 1e-6
        with self._lock:
            now, pairs = self._clock(), self._pairs
            if result.scale is not None:
                pairs.note_scale(result.scale)
            pairs.frame_id = result.frame.frame_id
            if floor is not None:
                pairs.count_floor(floor, now)
            pairs.latencies_ms.append((now - result.job.arrival_ns) * 1e-6)
            pairs.note_age(age_ms)
            pairs.stages_ms.append(stages_ms)
            # Last: whatever raises before is an error, and the pair is counted as that alone.
            if estimate.cuboid is not None:
                pairs.metric = estimate.metric
                pairs.rate.tick(now)
                pairs.published += 1
                pairs.cut += estimate.status is Status.DEADLINE
            else:
                pairs.no_estimate[estimate.status.value] += 1


def _with_gravity(prior: TemporalPrior | None, floor: FloorPlane | None) -> TemporalPrior | None:
    """Return the prior with what the expected floor says of gravity; None where nothing is known at all."""
    if floor is None:
        return prior
    return replace(prior or TemporalPrior(), gravity=floor.normal)
