"""What became of every message and every pair, how fast, how old: counted live, read as one frozen value."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from .depth_scale import DepthScale
from .pairing import StreamCount

_WINDOW = 256
"""Frames over which latencies are summed up: 8 s at 30 Hz."""
_SCALE_WINDOW = 15
"""Frames over which height and depth are summed up: one with a wrong floor is no wrong unit."""
_LONGEST_AGE_MS = 3_600_000.0
_RATE_WINDOW_NS = 5_000_000_000


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """One input: received = paired + superseded + sum(refused) + waiting."""

    received: int = 0
    paired: int = 0
    superseded: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)
    waiting: int = 0
    lost: int = 0
    """Messages that were sent while we listened and never came here."""
    rate_hz: float = 0.0
    silence_s: float = float("inf")
    """Time since the last message; inf before the first."""
    usable_silence_s: float = float("inf")
    """Time since the last message whose content could be used."""
    last_refusal: str = ""
    refused_s: float = 0.0
    """For how long every message has been refused; 0 where the last was not."""


NO_DEPTH, NOT_USED, NO_FLOOR = "too little depth", "use_depth is false", "none in view for sure, none given"
"""Why a frame has no floor."""
NO_LEVEL_FLOOR = "nothing level below the camera"
"""The same where the tilt of the camera is given and its height is not."""


@dataclass(frozen=True, slots=True)
class FloorOutcome:
    """What became of the floor of a frame when somebody listened to an output that needs it.

    Attributes
    ----------
    source : of the plane, "+depth" behind it where depth refined it; "" without a floor.
    missing : why there was none; "" with a floor.
    seen : True where depth shows the floor where the source says, within what the source may be off.
    confirmed : False where depth shows that the floor does not lie there.
    hidden : True where much depth is measured in view of that floor and most of it is none.
    frame : name of the frame on the floor, of the outputs that lie there.
    """

    source: str
    missing: str = ""
    seen: bool = False
    confirmed: bool = True
    hidden: bool = False
    frame: str = ""


@dataclass(frozen=True, slots=True)
class Health:
    """Snapshot: made = published + sum(no_estimate) + sum(dropped) + in_flight."""

    streams: Mapping[str, StreamHealth]
    made: int = 0
    published: int = 0
    cut: int = 0
    """Of those published: ended at the deadline."""
    no_estimate: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    in_flight: int = 0
    resets: int = 0
    turns_apart: int = 0
    """How often usable messages of one stream followed the other's since the last pair or refusal."""
    rate_hz: float = 0.0
    pair_silence_s: float = float("inf")
    """Time since the last pair."""
    latency_p50_ms: float = float("nan")
    """From the arrival of the second image of the pair to the end of publishing."""
    latency_p99_ms: float = float("nan")
    age_p50_ms: float = float("nan")
    """From the stamp of the frame to the end of publishing, on the node's clock."""
    age_p99_ms: float = float("nan")
    foreign_stamps: bool = False
    """True where the stamp of the last frame is over an hour from the node's clock: that is no age."""
    scales: int = 0
    """Frames whose depth was looked at for its unit."""
    camera_height_m: float = float("nan")
    """Over the estimated floor, median of the last frames that have one; NaN where none has."""
    median_depth_m: float = float("nan")
    """Median over the last frames of the median of a frame; NaN without depth."""
    last_drop: str = ""
    frame_id: str | None = None
    """Of the last frame; None before the first."""
    metric: bool | None = None
    """Whether the last room was in metres; None before the first."""
    floors: int = 0
    """Frames of which somebody wanted the floor: with one + sum(no_floor)."""
    no_floor: Mapping[str, int] = field(default_factory=dict)
    floors_not_confirmed: int = 0
    floors_hidden: int = 0
    """Frames whose floor something hid, as long as it was never seen with these settings."""
    last_floor: FloorOutcome | None = None
    """Of the last frame of which somebody wanted the floor."""
    floor_silence_s: float = float("inf")
    """Time since that frame."""
    stages_ms: Mapping[str, float] = field(default_factory=dict)
    """Median time per stage of the estimator."""


class Rate:
    """Events per second over the last five seconds."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=_WINDOW)

    def tick(self, now_ns: int) -> None:
        """Note an event."""
        self._times.append(now_ns)

    def hz(self, now_ns: int) -> float:
        """Return the rate; 0 when nothing came for five seconds."""
        recent = [t for t in self._times if now_ns - t <= _RATE_WINDOW_NS]
        if len(recent) < 2 or recent[-1] == recent[0]:
            return 0.0
        period = (recent[-1] - recent[0]) / (len(recent) - 1)
        end = recent[-1] if now_ns - recent[-1] <= 2 * period else now_ns  # what has stopped goes down
        return (len(recent) - 1) * 1e9 / (end - recent[0])

    def silence_s(self, now_ns: int) -> float:
        """Return the time since the last event; inf before the first."""
        return (now_ns - self._times[-1]) * 1e-9 if self._times else float("inf")


@dataclass(slots=True)
class PairCount:
    """Live counters of the pairs. Not thread-safe: the caller holds a lock."""

    made: int = 0
    published: int = 0
    cut: int = 0
    no_estimate: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    resets: int = 0
    last_drop: str = ""
    frame_id: str | None = None
    metric: bool | None = None
    floors: int = 0
    no_floor: Counter[str] = field(default_factory=Counter)
    floors_not_confirmed: int = 0
    floors_hidden: int = 0
    floor_seen: bool = False
    last_floor: FloorOutcome | None = None
    floor_rate: Rate = field(default_factory=Rate)
    rate: Rate = field(default_factory=Rate)
    pairs: Rate = field(default_factory=Rate)
    latencies_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    ages_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    foreign_stamps: bool = False
    scales: int = 0
    heights_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SCALE_WINDOW))
    depths_m: deque[float] = field(default_factory=lambda: deque(maxlen=_SCALE_WINDOW))
    stages_ms: deque[Mapping[str, float]] = field(default_factory=lambda: deque(maxlen=_WINDOW))

    @property
    def in_flight(self) -> int:
        """Pairs whose end is not known yet."""
        return self.made - self.published - self.no_estimate.total() - self.dropped.total()

    def note_age(self, age_ms: float) -> None:
        """Take the age of a frame, unless its stamp is of another clock, as that of a recording."""
        self.foreign_stamps = abs(age_ms) > _LONGEST_AGE_MS
        if self.foreign_stamps:
            self.ages_ms.clear()
        else:
            self.ages_ms.append(age_ms)

    def note_scale(self, scale: DepthScale) -> None:
        """Take what tells whether depth has the right unit."""
        self.scales += 1
        self.depths_m.append(scale.median_depth_m)
        if scale.camera_height_m is not None:
            self.heights_m.append(scale.camera_height_m)

    def count_floor(self, outcome: FloorOutcome, now_ns: int) -> None:
        """Note what became of the floor of a frame."""
        self.floors += 1
        self.last_floor = outcome
        self.floor_rate.tick(now_ns)
        self.floors_not_confirmed += not outcome.confirmed
        self.floor_seen |= outcome.seen
        self.floors_hidden = 0 if self.floor_seen else self.floors_hidden + outcome.hidden
        if outcome.missing:
            self.no_floor[outcome.missing] += 1

    def forget_floor(self) -> None:
        """Forget whether floor was seen: the settings may say that it lies elsewhere now."""
        self.floors_hidden, self.floor_seen = 0, False

    def snapshot(self, streams: Mapping[str, StreamHealth], turns_apart: int, now_ns: int) -> Health:
        """Return the counters as a value."""
        return Health(
            streams=streams,
            made=self.made,
            published=self.published,
            cut=self.cut,
            no_estimate=dict(self.no_estimate),
            dropped=dict(self.dropped),
            in_flight=self.in_flight,
            resets=self.resets,
            turns_apart=turns_apart,
            rate_hz=self.rate.hz(now_ns),
            pair_silence_s=self.pairs.silence_s(now_ns),
            latency_p50_ms=quantile(self.latencies_ms, 0.5),
            latency_p99_ms=quantile(self.latencies_ms, 0.99),
            age_p50_ms=quantile(self.ages_ms, 0.5),
            age_p99_ms=quantile(self.ages_ms, 0.99),
            foreign_stamps=self.foreign_stamps,
            scales=self.scales,
            camera_height_m=quantile(self.heights_m, 0.5),
            median_depth_m=quantile(self.depths_m, 0.5),
            last_drop=self.last_drop,
            frame_id=self.frame_id,
            metric=self.metric,
            floors=self.floors,
            no_floor=dict(self.no_floor),
            floors_not_confirmed=self.floors_not_confirmed,
            floors_hidden=self.floors_hidden,
            last_floor=self.last_floor,
            floor_silence_s=self.floor_rate.silence_s(now_ns),
            stages_ms=_medians(self.stages_ms),
        )


@dataclass(slots=True)
class StreamTimes:
    """When the messages of a stream came, and what was wrong with the last that was refused."""

    all: Rate = field(default_factory=Rate)
    usable: Rate = field(default_factory=Rate)
    lost: int = 0
    last_refusal: str = ""
    refused_since_ns: int | None = None
    """When the first of the messages was refused since the last that was not."""

    def note_refusal(self, sentence: str, now_ns: int) -> None:
        """Take what was wrong with a message."""
        self.last_refusal = sentence
        if self.refused_since_ns is None:
            self.refused_since_ns = now_ns


def stream_snapshot(count: StreamCount, times: StreamTimes, now_ns: int) -> StreamHealth:
    """Return the counters of a stream as a value."""
    return StreamHealth(
        received=count.received,
        paired=count.paired,
        superseded=count.superseded,
        refused=dict(count.refused),
        waiting=count.waiting,
        lost=times.lost,
        rate_hz=times.all.hz(now_ns),
        silence_s=times.all.silence_s(now_ns),
        usable_silence_s=times.usable.silence_s(now_ns),
        last_refusal=times.last_refusal,
        refused_s=0.0 if times.refused_since_ns is None else (now_ns - times.refused_since_ns) * 1e-9,
    )


def quantile(values: deque[float], share: float) -> float:
    """Return the nearest-rank quantile; NaN of nothing."""
    ordered = sorted(values)
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)] if ordered else float("nan")


def _medians(frames: deque[Mapping[str, float]]) -> dict[str, float]:
    stages = {stage for frame in frames for stage in frame}
    return {s: quantile(deque(f[s] for f in frames if s in f), 0.5) for s in sorted(stages)}
