"""Frames onto ROS 2 topics: the CDR of a bag goes straight to the publishers, nothing is decoded.

Like `node` a shell around rclpy, which is imported when something is played.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from room_layout_ros.datasets import BadFrame, DataError, FrameSource
from room_layout_ros.datasets import bag_messages as messages
from room_layout_ros.datasets import bag_topics as topics
from room_layout_ros.datasets.bag import open_reader, raw_messages
from room_layout_ros.datasets.calibration import CameraCalibration
from room_layout_ros.datasets.convert import calibration_of
from room_layout_ros.datasets.images import depth_to_millimetres
from room_layout_ros.datasets.writers import fits_millimetres
from room_layout_ros.extras import install_hint

FRAME_TOPICS = (topics.COLOR_TOPIC, topics.COLOR_INFO_TOPIC, topics.DEPTH_TOPIC)
"""Where frames go that are not of a bag."""

CLOCK_TOPIC = "/clock"

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_QUEUE_DEPTH = 10
_LATCHED_DEPTH = 100
"""So many messages are kept for readers that come late: /tf_static of many nodes is one of each."""
_CLOCK_STEP_S = 0.01
_SETTLE_S = 0.2
"""Our count of subscribers says that we have found them; they may take this long to find us."""

_NAMED = 20
"""So many topics a refusal names."""

_LAST_WORDS_S = 0.3
"""After the last message the readers get this long to fetch it."""


class RawMessage(NamedTuple):
    """A message as it goes over the wire; `latched` is for readers that come later too."""

    topic: str
    kind: str
    time_ns: int
    raw: bytes
    latched: bool = False


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """How to play.

    Attributes
    ----------
    rate : times real time. loops : 0 is for ever. clock : publish /clock from the stamps.
    wait_for_subscribers : on every image topic before the first message.
    wait_timeout_s : give up waiting then.
    remappings : topic to topic.
    """

    rate: float = 1.0
    loops: int = 1
    clock: bool = False
    wait_for_subscribers: int = 0
    wait_timeout_s: float = 60.0
    remappings: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if not 0.01 <= self.rate <= 100.0:
            raise DataError(f"rate is {self.rate}; allowed is 0.01 to 100")
        if self.loops < 0 or self.wait_for_subscribers < 0:
            raise DataError("loops and subscribers to wait for must be 0 or more")


@dataclass(frozen=True, slots=True)
class PlayResult:
    """What was played: messages by topic, and whether it was cut short by a signal."""

    counts: dict[str, int]
    interrupted: bool


def bag_stream(path: Path, only: set[str] | None = None) -> Callable[[], Iterator[RawMessage]]:
    """Return a function that reads the bag from its start; only topics in `only` if given."""
    with open_reader(path) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections if only is None or c.topic in only}

    def read() -> Iterator[RawMessage]:
        with open_reader(path) as reader:
            for connection, time_ns, raw in raw_messages(reader, set(kinds), path):
                yield RawMessage(connection.topic, connection.msgtype, time_ns, raw, _is_latched(connection))

    return read


def _is_latched(connection: Any) -> bool:
    """Whether all its publishers offered their messages to readers that come later."""
    profiles = connection.ext.offered_qos_profiles
    return bool(profiles) and all(profile.durability.name == "TRANSIENT_LOCAL" for profile in profiles)


def frame_stream(source: FrameSource) -> Callable[[], Iterator[RawMessage]]:
    """Return a function that encodes any source of frames under the topic names of the node."""
    calibration = calibration_of(source)

    def read() -> Iterator[RawMessage]:
        for item in source:
            if isinstance(item, BadFrame):
                print(f"left out {item.name}: {item.error}", file=sys.stderr)
            else:
                frame = item.frame
                info = calibration or CameraCalibration.from_intrinsics(frame.camera)
                yield from _frame_messages(frame, info)

    return read


def _frame_messages(frame: Any, calibration: CameraCalibration) -> Iterator[RawMessage]:
    stamp_ns, frame_id = frame.stamp_ns, frame.frame_id or "camera"
    raw = messages.encode_camera_info(calibration, stamp_ns, frame_id)
    yield RawMessage(topics.COLOR_INFO_TOPIC, messages.CAMERA_INFO, stamp_ns, raw)
    if frame.color is not None:
        raw = messages.encode_image_message(frame.color, "rgb8", stamp_ns, frame_id)
        yield RawMessage(topics.COLOR_TOPIC, messages.IMAGE, stamp_ns, raw)
    if frame.depth_m is not None:
        exact = fits_millimetres(frame.depth_m)
        pixels = depth_to_millimetres(frame.depth_m) if exact else frame.depth_m
        raw = messages.encode_image_message(pixels, "16UC1" if exact else "32FC1", stamp_ns, frame_id)
        yield RawMessage(topics.DEPTH_TOPIC, messages.IMAGE, stamp_ns, raw)


def set_transport_profile() -> Path | None:
    """Point Fast DDS to the shipped profile unless the user has one; call it before rclpy is imported.

    The default shared-memory segment holds half an image: readers would lose most of them.
    """
    if os.environ.get(PROFILE_VARIABLE):
        return Path(os.environ[PROFILE_VARIABLE])
    inside = Path("config") / "fastdds.xml"
    roots = [Path(__file__).resolve().parent.parent, Path(sys.prefix) / "share" / "room_layout_ros"]
    roots += [Path(p) / "share" / "room_layout_ros" for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    profile = next((root / inside for root in roots if (root / inside).exists()), None)
    if profile:
        os.environ[PROFILE_VARIABLE] = str(profile)
    return profile


def play(
    read: Callable[[], Iterable[RawMessage]],
    options: PlayOptions,
    progress: Callable[[int], object] | None = None,
) -> PlayResult:
    """Publish a stream of messages at its own pace.

    Parameters
    ----------
    read : callable
        Gives the stream from its start; called once for each loop.
    progress : callable or None
        Called with the number of messages so far.

    Raises
    ------
    DataError
        When the stream is damaged or empty, nobody subscribes in time, or ROS refuses a topic or the domain.
    ModuleNotFoundError
        When there is no rclpy.
    """
    set_transport_profile()
    try:
        import rclpy
        from rclpy.signals import SignalHandlerOptions

        from .ros_process import join, leave
    except ImportError:
        raise ModuleNotFoundError(f"playing needs ROS 2: {install_hint('ros')}, or /opt/ros", name="rclpy") from None
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    player = None
    try:
        with _refusals():
            join([], signal_handler_options=SignalHandlerOptions.NO)
        with _signals_interrupt():
            with _refusals():
                node = rclpy.create_node("room_layout_player")
            player = _Player(node, options, progress)
            try:
                player.announce(read())
                for loop in _loops(options.loops):
                    player.play_once(read(), first=loop == 0)
                time.sleep(_LAST_WORDS_S)
            except KeyboardInterrupt:
                return PlayResult(player.counts, interrupted=True)
            return PlayResult(player.counts, interrupted=False)
    finally:
        if player is not None:
            player.node.destroy_node()
        leave()


def _loops(count: int) -> Iterator[int]:
    i = 0
    while count == 0 or i < count:
        yield i
        i += 1


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn what ROS refuses into a DataError."""
    from .ros_process import BAD_SETTINGS, sentence

    try:
        yield
    except BAD_SETTINGS as error:
        raise DataError(sentence(error)) from None


@contextmanager
def _signals_interrupt() -> Iterator[None]:
    """Let SIGTERM end the play as SIGINT does."""
    before = signal.getsignal(signal.SIGTERM)

    def interrupt(_number: int, _frame: Any) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _qos(latched: bool) -> Any:
    """Return the profile, or the depth, that create_publisher takes."""
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile

    if not latched:
        return _QUEUE_DEPTH
    return QoSProfile(depth=_LATCHED_DEPTH, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class _Player:
    def __init__(self, node: Any, options: PlayOptions, progress: Callable[[int], object] | None) -> None:
        self.node, self.options, self.progress = node, options, progress
        self.counts: dict[str, int] = {}
        self._publishers: dict[str, Any] = {}
        self._skipped: set[str] = set()
        self._clock: Any = None
        self._told_ns = 0
        self._names = dict(options.remappings)

    def announce(self, stream: Iterable[RawMessage]) -> None:
        """Create publishers of the first second's topics and wait for their subscribers."""
        start = None
        for message in stream:
            start = message.time_ns if start is None else start
            if message.time_ns - start > 1_000_000_000:
                break
            self._publisher(message)
        if start is None:
            raise DataError("there is nothing to play")
        if self.options.clock:
            from rosgraph_msgs.msg import Clock

            self._clock = self.node.create_publisher(Clock, CLOCK_TOPIC, 10)
        self._wait()

    def _wait(self) -> None:
        wanted, deadline = self.options.wait_for_subscribers, time.monotonic() + self.options.wait_timeout_s
        images = {t: p for t, p in self._publishers.items() if t not in topics.TRUTH_TYPES}
        while missing := [t for t, p in images.items() if p.get_subscription_count() < wanted]:
            if time.monotonic() > deadline:
                raise DataError(f"{missing[0]} has not {wanted} subscribers after {self.options.wait_timeout_s:g} s")
            time.sleep(0.02)
        if wanted:
            time.sleep(_SETTLE_S)

    def _publisher(self, message: RawMessage) -> Any:
        topic = self._names.get(message.topic, message.topic)
        if topic not in self._publishers and topic not in self._skipped:
            from .ros_process import message_class

            try:
                kind = message_class(message.kind)
            except (ImportError, AttributeError):
                self._skipped.add(topic)
                print(f"left out {topic}: the message type {message.kind} is not installed", file=sys.stderr)
                return None
            # Reliable: a bag is replayed to be received; sensor-data readers match it all the same.
            with _refusals():
                self._publishers[topic] = self.node.create_publisher(kind, topic, _qos(message.latched))
        return self._publishers.get(topic)

    def play_once(self, stream: Iterable[RawMessage], first: bool) -> None:
        """Publish one pass; `first` only tells the clock where to start."""
        origin_ns: int | None = None
        start = time.monotonic()
        for message in stream:
            if origin_ns is None:
                origin_ns, start = message.time_ns, time.monotonic()
                self._publish_clock(message.time_ns)
            self._sleep_until(start, origin_ns, message.time_ns)
            if abs(message.time_ns - self._told_ns) > _CLOCK_STEP_S * 1e9:  # behind the schedule nobody sleeps
                self._publish_clock(message.time_ns)
            publisher = self._publisher(message)
            if publisher is not None:
                publisher.publish(message.raw)
                topic = self._names.get(message.topic, message.topic)
                self.counts[topic] = self.counts.get(topic, 0) + 1
                if self.progress:
                    self.progress(sum(self.counts.values()))

    def _sleep_until(self, start: float, origin_ns: int, time_ns: int) -> None:
        rate = self.options.rate
        due = start + (time_ns - origin_ns) / 1e9 / rate
        while (left := due - time.monotonic()) > 0:
            if self._clock is None:
                time.sleep(left)
                return
            time.sleep(min(left, _CLOCK_STEP_S))
            self._publish_clock(min(time_ns, origin_ns + int((time.monotonic() - start) * rate * 1e9)))

    def _publish_clock(self, time_ns: int) -> None:
        if self._clock is None:
            return
        from rosgraph_msgs.msg import Clock

        self._told_ns = time_ns
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(time_ns, 1_000_000_000)
        self._clock.publish(message)


def resolve(topic: str) -> str:
    """Return a topic's full name, as a node without a namespace resolves it."""
    return topic if topic.startswith(("/", "~")) else f"/{topic}"


def require_topics(option: str, wanted: Iterable[str], there: Collection[str], where: str) -> None:
    """Refuse full names of topics that are not there: a misspelt one would play silence.

    Raises
    ------
    DataError
        With the topics that are there.
    """
    for topic in wanted:
        if topic not in there:
            names = ", ".join(sorted(there)[:_NAMED]) or "none"
            rest = f" and {len(there) - _NAMED} more" if len(there) > _NAMED else ""
            raise DataError(f"{option}: there is no topic {topic} {where}; there are {names}{rest}")


def parse_remappings(words: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return pairs of FROM:=TO words, as full names.

    Raises
    ------
    DataError
        When a word is something else.
    """
    pairs = []
    for word in words:
        source, separator, target = word.partition(":=")
        if not separator or not source or not target:
            raise DataError(f"--remap {word}: FROM:=TO is needed")
        pairs.append((resolve(source), resolve(target)))
    return tuple(pairs)
