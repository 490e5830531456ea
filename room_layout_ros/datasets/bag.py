"""Frames out of a rosbag2 (sqlite3 or mcap), through rosbags: no ROS installation needed."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import N_FACES

from . import bag_messages as messages
from .bag_recovery import RawMessage, messages_around_damage
from .bag_topics import (
    CLASSES_TOPIC,
    LAYOUT_TOPIC,
    POSE_TOPIC,
    TRUTH_TYPES,
    BagTopics,
    choose_topics,
    compressed_depth,
)
from .calibration import CameraCalibration, read_calibration
from .errors import DataError
from .sample import MAX_NYU40, BadFrame, FrameTruth, Sample

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader

NAMES_KEY = "room_layout_names"
"""Entry of the bag's custom data that keeps the names of the frames: JSON, stamp to name."""

_REPAIRS = "lost metadata: ros2 bag reindex; a cut .mcap: mcap recover; a damaged .db3: sqlite3 .recover"

MAX_WAITING = 60
"""Images of one stream that wait for their partner: two seconds at 30 Hz."""
_RESET_NS = 500_000_000
"""Stamps that step back further than this start anew: the recording of a bag that loops."""

Calibration = CameraCalibration | DataError
"""Of a camera_info, or why it cannot be used."""


@contextmanager
def open_reader(path: Path) -> Iterator[Reader]:
    """Open a rosbag2, whatever is wrong with it ends as one sentence.

    Raises
    ------
    DataError
        When it is damaged, cut, or has no metadata and not exactly one storage file.
    """
    messages.need_rosbags()
    from rosbags.rosbag2 import Reader

    target = _target(path)
    reader = Reader(target)
    try:
        reader.open()
    except Exception as error:  # noqa: BLE001 - a cut file makes sqlite3, struct, yaml and assertion errors too
        raise DataError(f"{path} cannot be opened as a rosbag2: {_reason(error)} ({_REPAIRS})") from None
    try:
        yield reader
    finally:
        reader.close()


def _target(path: Path) -> Path:
    if not path.exists():
        raise DataError(f"{path} does not exist; a rosbag2 folder or its .db3 or .mcap file is needed")
    if path.is_file() or (path / "metadata.yaml").exists():
        return path
    files = [p for p in path.iterdir() if p.suffix in (".db3", ".mcap")]
    if len(files) != 1:
        raise DataError(f"{path} has no metadata.yaml and {len(files)} storage files; run: ros2 bag reindex {path}")
    return files[0]


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__


def raw_messages(reader: Reader, topics: set[str], path: Path, recover: bool = False) -> Iterator[RawMessage]:
    """Yield (connection, log time, CDR) of some topics in the order of time.

    Parameters
    ----------
    recover : bool
        Read on behind damaged parts; what is lost is said at the end.

    Raises
    ------
    DataError
        When the bag is cut or damaged on the way, at once, or with `recover` after all that can be read; and when
        fewer messages came than it announces (a chunk without a checksum hides its damage).
    """
    connections = [c for c in reader.connections if c.topic in topics]
    count, damage = 0, list[Exception]()

    def read(start_ns: int | None) -> Iterator[RawMessage]:
        return reader.messages(connections, start=start_ns)

    try:
        for item in messages_around_damage(read, reader.end_time, damage) if recover else read(None):
            yield item
            count += 1
    except GeneratorExit:
        raise
    except Exception as error:  # noqa: BLE001 - as above
        raise DataError(f"{path} is damaged after {count} messages: {_reason(error)}") from None
    announced = sum(c.msgcount for c in connections)
    if damage or count < announced:
        why = f" ({_reason(damage[0])})" if damage else ""
        raise DataError(f"{path} is damaged{why}: {announced - count} of its {announced} messages are lost")


@dataclass(frozen=True, slots=True)
class BagSource:
    """A rosbag2 as a source of frames: colour and depth paired by stamp, exactly, else within a gap."""

    path: Path
    topics: BagTopics
    types: dict[str, str]
    count: int
    names: dict[int, str]
    max_stamp_gap_ns: int
    assume_registered: bool = False
    recover: bool = False
    camera: CameraCalibration | None = None
    """In the place of the camera_info, which is not read then."""
    passed_over: str = ""
    """Why a topic of the name of depth is not read, where no other is; "" where there is none."""

    @property
    def title(self) -> str:
        """What it is, for people."""
        return f"bag {self.path}"

    @property
    def length(self) -> int:
        """Number of frames: images of the depth topic, or of the colour topic where there is no depth."""
        return self.count

    def __iter__(self) -> Iterator[Sample | BadFrame]:
        """Yield a frame, or an error value, for each depth image (colour image where there is no depth).

        Raises
        ------
        DataError
            When the bag is damaged, after the frames that could be read: those before the damage, or with `recover`
            all.
        """
        wanted = {
            *self.topics.images,
            *((self.topics.info,) if self.topics.info else ()),
            *(t for t in TRUTH_TYPES if self.types.get(t) == TRUTH_TYPES[t]),
        }
        with open_reader(self.path) as reader:
            assembly = _Assembly(self, self._calibration(reader))
            stream = raw_messages(reader, wanted, self.path, self.recover)
            damage: DataError | None = None
            try:
                for _, group in groupby(stream, key=lambda item: item[1]):
                    for connection, _time, raw in group:
                        assembly.add(connection.topic, raw)
                    yield from assembly.ready(end=False)
            except DataError as error:
                damage = error
            yield from assembly.ready(end=True)
            if damage is not None:
                raise damage

    def first_calibration(self) -> CameraCalibration:
        """Return the calibration that was given, else the first usable one in the bag."""
        with open_reader(self.path) as reader:
            return self._calibration(reader)

    def _calibration(self, reader: Reader) -> CameraCalibration:
        if self.camera is not None:
            return self.camera
        problem: DataError | None = None
        for connection, _, raw in raw_messages(reader, {self.topics.info or ""}, self.path, self.recover):
            try:
                return messages.decode_calibration(messages.decode(raw, connection.msgtype))
            except DataError as error:
                problem = problem or error
        what = f" has no message on {self.topics.info}" if problem is None else f": {self.topics.info}: {problem}"
        raise DataError(f"{self.path}{what}; the camera is unknown (give a calibration file with --camera)")


@dataclass(slots=True)
class _Assembly:
    """Messages waiting to become frames; bounded."""

    source: BagSource
    calibration: Calibration
    """The latest; an error is that of the frames which come with it."""
    leaders: OrderedDict[int, Any] = field(default_factory=OrderedDict)
    colors: OrderedDict[int, Any] = field(default_factory=OrderedDict)
    truths: dict[str, OrderedDict[int, Any]] = field(default_factory=lambda: {t: OrderedDict() for t in TRUTH_TYPES})
    errors: list[str] = field(default_factory=list)
    emitted: int = 0
    used: set[int] = field(default_factory=set)
    """Stamps of the colour images that had their exact partner; they remain the nearest of other depth images."""
    newest: dict[str, int] = field(default_factory=dict)
    """Stamp of the last image by topic."""
    finished: list[Sample | BadFrame] = field(default_factory=list)
    """Frames of before a jump back, until `ready` yields them."""

    def add(self, topic: str, raw: bytes) -> None:
        topics = self.source.topics
        try:
            message = messages.decode(raw, self.source.types[topic])
        except DataError as error:
            if topic in topics.images:
                self.errors.append(f"{topic}: {error}")
            return
        if topic == topics.info:
            self.calibration = _calibration_or_error(topic, message)
            return
        if topic in self.truths:
            store = self.truths[topic]
        else:
            store = self.leaders if topic == (topics.depth or topics.color) else self.colors
        stamp_ns = messages.stamp_of(message)
        if topic in topics.images:
            self._follow(topic, stamp_ns)
        store[stamp_ns] = (message, self.calibration)
        store.move_to_end(stamp_ns)
        if store is self.colors:
            self.used = (self.used & self.colors.keys()) - {stamp_ns}
        while len(store) > MAX_WAITING and store is not self.leaders:
            store.popitem(last=False)

    def _follow(self, topic: str, stamp_ns: int) -> None:
        """Finish what waits and forget the colour images, as soon as the first of both streams jumps back."""
        before = self.newest.get(topic, 0)
        other = max((t for name, t in self.newest.items() if name != topic), default=0)
        if min(before, other) > stamp_ns + _RESET_NS:
            self.finished = list(self.ready(end=True))
            self.colors.clear()
        self.newest[topic] = stamp_ns

    def ready(self, end: bool) -> Iterator[Sample | BadFrame]:
        """Yield every frame whose partner has come, or can come no more."""
        finished, self.finished = self.finished, []
        yield from finished
        for error in self.errors:
            yield BadFrame(self._name(-1), error)
            self.emitted += 1
        self.errors.clear()
        while self.leaders:
            stamp_ns, (leader, calibration) = next(iter(self.leaders.items()))
            partner = self._partner(stamp_ns)
            if partner != stamp_ns and not end and self._may_still_come(stamp_ns):
                return
            self.leaders.popitem(last=False)
            yield self._frame(stamp_ns, leader, calibration, partner)
            self.emitted += 1

    def _may_still_come(self, stamp_ns: int) -> bool:
        """Whether a colour image nearer to this stamp than those seen may follow."""
        topics, newest = self.source.topics, next((s for s in reversed(self.colors) if s not in self.used), None)
        paired = bool(topics.color and topics.depth)
        past = newest is not None and newest >= stamp_ns + self.source.max_stamp_gap_ns
        return paired and not past and len(self.leaders) <= MAX_WAITING

    def _partner(self, stamp_ns: int) -> int | None:
        if stamp_ns in self.colors and stamp_ns not in self.used:
            return stamp_ns
        near = [s for s in self.colors if s != stamp_ns and abs(s - stamp_ns) <= self.source.max_stamp_gap_ns]
        return min(near, key=lambda s: abs(s - stamp_ns), default=None)

    def _name(self, stamp_ns: int) -> str:
        return self.source.names.get(stamp_ns, f"{self.emitted:06d}")

    def _frame(self, stamp_ns: int, leader: Any, calibration: Calibration, partner: int | None) -> Sample | BadFrame:
        name = self._name(stamp_ns)
        try:
            return self._sample(name, stamp_ns, leader, calibration, partner)
        except ValueError as error:
            return BadFrame(name, str(error), stamp_ns)

    def _sample(self, name: str, stamp_ns: int, leader: Any, calibration: Calibration, partner: int | None) -> Sample:
        topics = self.source.topics
        if isinstance(calibration, DataError):
            raise calibration
        color_message, depth_message = (leader, None) if topics.depth is None else (None, leader)
        if topics.color and topics.depth:
            if partner is None:
                gap_ms = self.source.max_stamp_gap_ns / 1e6
                raise DataError(
                    f"no colour image within {gap_ms:g} ms of this depth image; --max-stamp-gap sets the time"
                )
            color_message, _ = self.colors[partner]
            if partner == stamp_ns:
                self.used.add(partner)
            self._check_registered(color_message, depth_message)
        color = None if color_message is None else messages.decode_color(color_message)
        depth_m = None if depth_message is None else messages.decode_depth(depth_message)
        frame = RgbdFrame(calibration.intrinsics, color, depth_m, stamp_ns, str(leader.header.frame_id), name)
        layout = self._truth(LAYOUT_TOPIC, stamp_ns, lambda m: messages.decode_index(m, N_FACES))
        labels40 = self._truth(CLASSES_TOPIC, stamp_ns, lambda m: messages.decode_index(m, MAX_NYU40))
        truth = None if layout is None and labels40 is None else FrameTruth(layout, labels40)
        return Sample(frame, truth, self._truth(POSE_TOPIC, stamp_ns, messages.decode_pose))

    def _check_registered(self, color: Any, depth: Any) -> None:
        frames = str(color.header.frame_id), str(depth.header.frame_id)
        if frames[0] != frames[1] and not self.source.assume_registered:
            raise DataError(
                f"depth is in frame {frames[1]!r}, colour in {frames[0]!r}; register it, or say --assume-registered"
            )

    def _truth(self, topic: str, stamp_ns: int, read: Callable[[Any], Any]) -> Any:
        item = self.truths[topic].pop(stamp_ns, None)
        return None if item is None else read(item[0])


def _calibration_or_error(topic: str, message: Any) -> Calibration:
    try:
        return messages.decode_calibration(message)
    except DataError as error:
        return DataError(f"{topic}: {error}")


def open_bag(
    path: Path,
    max_stamp_gap_ns: int = 20_000_000,
    assume_registered: bool = False,
    recover: bool = False,
    camera: Path | None = None,
    **topics: str,
) -> BagSource:
    """Open a rosbag2 as a source of frames.

    Parameters
    ----------
    max_stamp_gap_ns : int
        Colour and depth pair when their stamps are equal, else up to this far apart.
    assume_registered : bool
        Believe that depth is registered to colour although their frame ids differ.
    recover : bool
        Read on behind damaged parts; the loss is the error at the end.
    camera : path, optional
        ROS camera calibration YAML that takes the place of the bag's camera_info.
    **topics
        color_topic, depth_topic, color_info_topic, depth_info_topic: see `choose_topics`.

    Raises
    ------
    DataError
        When the bag is damaged, its topics cannot be told, `camera` is no calibration, or a camera_info is named too.
    """
    if camera is not None and not {"color_info_topic", "depth_info_topic"}.isdisjoint(topics):
        raise DataError(f"--camera {camera} takes the place of the camera_info; name no topic of one besides")
    calibration = None if camera is None else read_calibration(camera)
    with open_reader(path) as reader:
        types = {c.topic: c.msgtype for c in reader.connections}
        counts: dict[str, int] = {}
        for c in reader.connections:
            counts[c.topic] = counts.get(c.topic, 0) + c.msgcount
        names = _names(reader)
        unread = {topic: _why_no_depth(reader, topic, path) for topic in compressed_depth(types)}
    in_png = [topic for topic, why in unread.items() if not why]
    chosen = choose_topics(types, **topics, needs_info=calibration is None, in_png=in_png)
    count = counts[chosen.depth or chosen.color or ""]
    told = "" if chosen.depth else "; ".join(f"{topic} is not read: {why}" for topic, why in unread.items())
    return BagSource(path, chosen, types, count, names, max_stamp_gap_ns, assume_registered, recover, calibration, told)


def _why_no_depth(reader: Reader, topic: str, path: Path) -> str:
    """Return why the format of a topic cannot be read as depth; "" where it can, though single images be damaged."""
    try:
        for connection, _, raw in raw_messages(reader, {topic}, path):
            messages.check_depth_format(messages.decode(raw, connection.msgtype))
            return ""
    except DataError as error:
        return str(error)
    return "it has no message"


def _names(reader: Reader) -> dict[int, str]:
    custom = reader.storage.metadata.custom or {}
    try:
        entries = json.loads(custom.get(NAMES_KEY, "{}"))
        # A name becomes a file name: nothing that leaves the folder may pass.
        return {int(k): str(v) for k, v in entries.items() if v and not set(str(v)) & set("/\\\0") and v[0] != "."}
    except (ValueError, AttributeError, TypeError):
        return {}
