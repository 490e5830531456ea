"""The demo's three processes: recorder, estimator node and player, over DDS, on this machine alone."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np

from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import free_space_of_frame
from room_layout_ros.core.picture import draw_overlay
from room_layout_ros.datasets import DataError, good_samples, open_source
from room_layout_ros.datasets.bag import open_reader
from room_layout_ros.datasets.bag_topics import COLOR_INFO_TOPIC, COLOR_TOPIC, DEPTH_TOPIC
from room_layout_ros.playback import set_transport_profile

NODE = "/estimator"
START_S = 180.0
"""The first start of a machine compiles the kernels."""

_QUIET_S = 1.5
_STOP_S = 15.0
_SHARE = 0.4
"""Share of the node's speed that is asked of it where every frame shall be estimated: it has two neighbours here."""


@dataclass(frozen=True, slots=True)
class Process:
    """A running process and the file it writes its words to."""

    name: str
    popen: subprocess.Popen[bytes]
    log: Path

    def alive_or_refuse(self) -> None:
        """Raise a DataError with the last words of a process that ended by itself."""
        code = self.popen.poll()
        if code is not None:
            raise DataError(f"the {self.name} ended with exit code {code}: {self.last_words()} (log: {self.log})")

    def last_words(self) -> str:
        """Return the last line of its log."""
        lines = self.log.read_text("utf-8", "replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def stop(self) -> None:
        """Ask it to end, and make it end."""
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGINT)
        try:
            self.popen.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()


def run_live(
    bag: Path, out: Path, stamps_ns: Sequence[int], rate: float | None, settings: Sequence[str] = ()
) -> tuple[Path, tuple[str, ...]]:
    """Play a bag into the node and record what it publishes.

    Parameters
    ----------
    bag : Path
        With the topic names of the node.
    out : Path
        Folder for the recording (results/) and the logs of the processes (log/).
    stamps_ns : sequence of int
        Of the frames in the bag.
    rate : float or None
        Multiple of real time; None is slow enough for every frame to be estimated.
    settings : sequence of str
        Words for the node, see `node_words`.

    Returns
    -------
    Path
        The recorded .mcap.
    tuple of str
        What fell short, in sentences.

    Raises
    ------
    DataError
        When a process ends early, or nothing is recorded.
    """
    set_transport_profile()
    environment = ros_environment(out)
    speed = _speed(bag, stamps_ns, rate)
    results = out / "results"
    with _processes() as start:
        log = out / "log"
        log.mkdir(exist_ok=True)
        recorder = start(
            "recorder", ["-m", "room_layout_ros.recording", *recorded_topics(), "--out", str(results)], environment, log
        )
        node = start("estimator", ["-m", "room_layout_ros.node", *settings], environment, log)
        words = ["--rate", f"{speed:.3f}", "--wait-for-subscribers", "1", "--wait-timeout", f"{START_S:g}"]
        words += ["--topics", *played_topics(bag)]
        player = start("player", ["-m", "room_layout_ros.cli", "play", str(bag), *words], environment, log)
        _watch((recorder, node), player, duration_s(stamps_ns) / speed)
        time.sleep(_QUIET_S)
        node.stop()
        recorder.stop()
    return _recorded(results, recorder), _notes(recorder, speed, chosen=rate is None)


def played_topics(bag: Path) -> list[str]:
    """Return the topics to play."""
    with open_reader(bag) as reader:
        there = {connection.topic for connection in reader.connections}
    return [topic for topic in (COLOR_TOPIC, COLOR_INFO_TOPIC, DEPTH_TOPIC) if topic in there]


def node_words(bag: Path, pose: Mapping[str, float]) -> list[str]:
    """Return the words that let the node do without a stream that the bag has not, and know how the camera hangs."""
    uses = {"use_color": COLOR_TOPIC, "use_depth": DEPTH_TOPIC}
    there = played_topics(bag)
    settings = [f"{name}:=false" for name, topic in uses.items() if topic not in there]
    settings += ["pose_source:=parameters", *(f"{name}:={value}" for name, value in pose.items())] if pose else []
    words = [word for setting in settings for word in ("-p", setting)]
    return ["--ros-args", *words] if words else []


def recorded_topics() -> list[str]:
    """Return all that the node publishes."""
    from room_layout_ros.outputs import OUTPUTS
    from room_layout_ros.publications import DIAGNOSTICS_TOPIC, LABEL_NAMES_TOPIC

    topics = [*(output.topic for output in OUTPUTS), LABEL_NAMES_TOPIC, DIAGNOSTICS_TOPIC]
    return [topic.replace("~", NODE) for topic in topics]


def usual_gap_s(stamps_ns: Sequence[int]) -> float:
    """Return the median time from frame to frame; of a single frame a thirtieth of a second."""
    return float(np.median(np.diff(np.sort(stamps_ns)))) * 1e-9 if len(stamps_ns) > 1 else 1 / 30


def duration_s(stamps_ns: Sequence[int]) -> float:
    """Return the time from the first frame to the end of the last."""
    return (max(stamps_ns) - min(stamps_ns)) * 1e-9 + usual_gap_s(stamps_ns)


def ros_environment(out: Path) -> dict[str, str]:
    """Return the environment of the processes: this machine only, a domain of their own, logs in `out`."""
    environment = dict(os.environ)
    environment.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    environment.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    environment["ROS_LOG_DIR"] = str((out / "log" / "ros").absolute())
    environment["PYTHONUNBUFFERED"] = "1"
    return environment


@contextmanager
def _processes() -> Iterator[Callable[[str, list[str], Mapping[str, str], Path], Process]]:
    """Give a function that starts a process; all of them are gone at the end, whatever happens."""
    running: list[Process] = []
    files: list[IO[bytes]] = []

    def start(name: str, words: list[str], environment: Mapping[str, str], log: Path) -> Process:
        path = log / f"{name}.txt"
        files.append(path.open("wb"))
        # Sessions of their own: Ctrl-C reaches us, and we end them in order.
        popen = subprocess.Popen(
            [sys.executable, *words],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=files[-1],
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        running.append(Process(name, popen, path))
        return running[-1]

    try:
        yield start
    finally:
        for process in reversed(running):
            process.stop()
        for file in files:
            file.close()


def _watch(others: tuple[Process, ...], player: Process, seconds: float) -> None:
    """Wait for the player to end while the others live; the bar follows the clock of the bag."""
    begun: float | None = None
    end = time.monotonic() + START_S + 2 * seconds + 30
    node = others[-1]
    with progress_bar("play into the node", max(1, round(seconds)), "s") as progress:
        while player.popen.poll() is None:
            for process in others:
                process.alive_or_refuse()
            if begun is None and "listening to" in node.log.read_text("utf-8", "replace"):
                begun = time.monotonic()
            progress(0 if begun is None else min(round(time.monotonic() - begun), max(1, round(seconds))))
            if time.monotonic() > end:
                raise DataError(f"the player has not ended after {seconds:.0f} s of play (log: {player.log})")
            time.sleep(0.1)
        progress(max(1, round(seconds)))
    if player.popen.returncode != 0:
        raise DataError(f"the player failed: {player.last_words()} (log: {player.log}, and {node.log})")


def _speed(bag: Path, stamps_ns: Sequence[int], rate: float | None) -> float:
    """Return the multiple of real time to play at; a single frame knows none."""
    if len(stamps_ns) == 1:
        return 1.0
    return _possible_rate(bag, usual_gap_s(stamps_ns)) if rate is None else rate


def _possible_rate(bag: Path, gap_s: float) -> float:
    """Return a rate at which the node estimates every frame, measured on the bag's first frames, `gap_s` apart."""
    estimator, taken_s = LayoutEstimator(), []
    for sample in islice(good_samples(open_source(bag)), 8):
        begin = time.perf_counter()
        estimate = estimator.estimate(sample.frame)
        free_space_of_frame(sample.frame, estimate, estimator.config)
        draw_overlay(sample.frame, estimate)
        taken_s.append(time.perf_counter() - begin)
    usual_s = float(np.median(taken_s[1:] or taken_s))  # the first loads the kernels
    return min(1.0, max(0.02, _SHARE * gap_s / usual_s))


def _recorded(results: Path, recorder: Process) -> Path:
    files = sorted(results.glob("*.mcap")) if results.is_dir() else []
    if len(files) != 1:
        raise DataError(f"the recorder wrote {len(files)} MCAP files: {recorder.last_words()} (log: {recorder.log})")
    return files[0]


def _notes(recorder: Process, speed: float, chosen: bool) -> tuple[str, ...]:
    """Say what was lost on the way, and how fast the bag was played; `chosen` where that was measured, not given."""
    notes = []
    counts: dict[str, list[int]] = {}
    with contextlib.suppress(ValueError):
        counts = json.loads(recorder.last_words())
    _, lost = counts.get(f"{NODE}/labels", [0, 0])
    if lost:
        notes.append(f"{lost} label images were lost on the way to the recorder.")
    if speed < 0.995:
        why = ", at which this machine should estimate every frame" if chosen else ""
        notes.append(f"Played at {speed:.2f} of real time{why}.")
    return tuple(notes)
