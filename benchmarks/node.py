"""The node over DDS: results/s, age from capture to publish, every frame accounted for.

Camera (30 Hz, stamps of the wall clock), node and recorder are processes of their own; the recorder listens to every
output. Run it on a quiet machine: three processes share its cores.
"""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._frames import DATA
from room_layout_ros.playback import set_transport_profile

SECONDS = 20.0
GOAL_HZ, GOAL_P50_MS, GOAL_P99_MS = 15.0, 60.0, 150.0

_START_S = 300.0
"""The first start of a machine compiles the kernels."""
_REPORT_S = 1.5
"""One more message on /diagnostics comes within this."""
_UNANNOUNCED = 2
"""Frames sent while discovery still runs are lost without the middleware saying so."""


@dataclass(frozen=True)
class Run:
    """What three processes told of one run.

    Attributes
    ----------
    sent : frames that the camera published.
    facts : values of the node's last diagnostics by finding.
    arrivals_ns : {output: [(stamp, arrival)]} of every message that the recorder got.
    lost : {output: messages} that the middleware lost between node and recorder.
    """

    sent: int
    facts: Mapping[str, Mapping[str, str]]
    arrivals_ns: Mapping[str, list[tuple[int, int]]]
    lost: Mapping[str, int]

    @property
    def pairs(self) -> Mapping[str, str]:
        return self.facts["estimates"]

    def total(self, finding: str, prefix: str) -> int:
        """Return the sum of the counters whose names begin with `prefix`."""
        return sum(int(n) for key, n in self.facts[finding].items() if key.startswith(prefix))

    def ages_ms(self, *outputs: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return for each frame the time from its stamp to the arrival of the last message of these outputs."""
        last: dict[int, int] = {}
        for output in outputs:
            for stamp, arrival in self.arrivals_ns[output]:
                last[stamp] = max(arrival, last.get(stamp, 0))
        return np.array([arrival - stamp for stamp, arrival in last.items()]) * 1e-6

    def faults(self) -> list[str]:
        """Return which sums do not hold, in words."""
        found = []
        for stream in ("input colour", "input depth"):
            values = self.facts[stream]
            received, lost = int(values["received"]), int(values["lost"])
            ends = sum(int(values[k]) for k in ("paired", "superseded", "waiting")) + self.total(stream, "refused")
            if received != ends:
                found.append(f"{stream}: received {received}, accounted for {ends}")
            if not 0 <= self.sent - received - lost <= _UNANNOUNCED:
                found.append(f"{stream}: sent {self.sent}, received {received}, lost {lost}")
        made = int(self.pairs["pairs"])
        ends = sum(int(self.pairs[k]) for k in ("published", "in_flight"))
        ends += self.total("estimates", "no estimate") + self.total("estimates", "dropped")
        if made != ends:
            found.append(f"pairs {made}, accounted for {ends}")
        recorded, published = len(self.arrivals_ns["labels"]) + self.lost["labels"], int(self.pairs["published"])
        if recorded != published:
            found.append(f"labels published {published}, recorded or lost {recorded}")
        return found


def main(seconds: float = SECONDS, folder: Path | None = None) -> int:
    if importlib.util.find_spec("rclpy") is None:
        print("rclpy is not installed (extra: ros): nothing to measure")
        return 0
    folder = folder or next((DATA / n for n in ("corridor", "nyuv2") if (DATA / n / "camera.yaml").exists()), None)
    return show(measure(seconds, folder), seconds, "rendered" if folder is None else folder.name)


def measure(seconds: float, folder: Path | None, hd: bool = False) -> Run:
    """Run camera, node and recorder; `folder` None renders the frames, `hd` those of 1280x720."""
    from room_layout_ros.outputs import OUTPUTS

    namespace = f"/bench{os.getpid()}"
    topics = {o.topic.removeprefix("~/"): o.topic.replace("~", f"{namespace}/estimator") for o in OUTPUTS}
    camera = ["-m", "benchmarks._camera", "--seconds", f"{seconds:g}", "--namespace", namespace]
    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        bag = Path(temporary) / "bag"
        words = ["-m", "room_layout_ros.recording", *topics.values(), "/diagnostics", "--out", str(bag)]
        recorder = stack.enter_context(_process(words))
        node = stack.enter_context(_process(["-m", "room_layout_ros.node", "--ros-args", "-r", f"__ns:={namespace}"]))
        player = stack.enter_context(_process([*camera, *_pictures(folder, hd)]))
        sent = json.loads(_last_line(player, _START_S + 3 * seconds))["sent"]
        time.sleep(_REPORT_S)
        recorder.send_signal(signal.SIGINT)
        counts = json.loads(_last_line(recorder, 60.0))
        node.send_signal(signal.SIGINT)
        node.communicate(timeout=60.0)
        arrivals, facts = _read(bag, topics, f"{namespace.strip('/')}/estimator")
    return Run(sent, facts, arrivals, {name: counts.get(topic, (0, 0))[1] for name, topic in topics.items()})


def _pictures(folder: Path | None, hd: bool) -> list[str]:
    if folder is not None:
        return ["--frames", str(folder)]
    return ["--hd"] if hd else []


@contextmanager
def _process(words: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Start Python; end it at the latest at the end."""
    set_transport_profile()
    alone = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
    environment = {"AMENT_PREFIX_PATH": sys.prefix, **alone, **os.environ}
    environment["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parents[1]), environment.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, *words], env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def _last_line(process: subprocess.Popen[str], timeout_s: float) -> str:
    said = process.communicate(timeout=timeout_s)[0].strip()
    if process.returncode != 0 or not said:
        raise RuntimeError(f"{process.args!r} ended with {process.returncode}: {said[-500:]}")
    return said.splitlines()[-1]


def _read(
    bag: Path, topics: Mapping[str, str], node: str
) -> tuple[dict[str, list[tuple[int, int]]], dict[str, dict[str, str]]]:
    """Return stamp and arrival of every output, and the node's last diagnostics."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    names = {topic: name for name, topic in topics.items()}
    arrivals: dict[str, list[tuple[int, int]]] = {name: [] for name in topics}
    facts: dict[str, dict[str, str]] = {}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, arrival_ns, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.topic in names:
                for part in getattr(message, "markers", [message])[:1]:
                    stamp = part.header.stamp
                    arrivals[names[connection.topic]].append((stamp.sec * 10**9 + stamp.nanosec, arrival_ns))
            elif message.status[0].name.startswith(f"{node}:"):
                facts = {s.name.partition(": ")[2]: {v.key: v.value for v in s.values} for s in message.status}
    return arrivals, facts


def show(run: Run, seconds: float, title: str) -> int:
    """Print the tables; return 1 if a sum does not hold."""
    pairs = run.pairs
    print(f"{title}: {run.sent} frames at 30 Hz; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    rate = int(pairs["published"]) / seconds
    print(f"results/s {rate:.1f} (goal: {GOAL_HZ:g}, {'met' if rate >= GOAL_HZ else 'missed'})")
    print(f"{'age from capture, ms':<44}{'p50':>8}{'p99':>8}")
    _line("published, as the node says (last 256)", float(pairs["age_p50_ms"]), float(pairs["age_p99_ms"]))
    for name, outputs in (("labels at the recorder", ["labels"]), ("all outputs at the recorder", [*run.arrivals_ns])):
        ages = run.ages_ms(*outputs)
        p50, p99 = np.percentile(ages, (50, 99)) if ages.size else (np.nan, np.nan)
        _line(name, float(p50), float(p99))
    stages = {k.removeprefix("stage_ms: "): v for k, v in pairs.items() if k.startswith("stage_ms: ")}
    print("stages, ms: " + ", ".join(f"{name} {ms}" for name, ms in stages.items()))
    for stream in ("input colour", "input depth"):
        keys = ("received", "lost", "paired", "superseded", "waiting")
        refused = [k for k in run.facts[stream] if k.startswith("refused")]
        print(f"{stream}: " + ", ".join(f"{k} {run.facts[stream][k]}" for k in (*keys, *refused)))
    ends = [k for k in pairs if k.startswith(("published", "no estimate", "dropped", "in_flight"))]
    print(f"pairs {pairs['pairs']}: " + ", ".join(f"{k} {pairs[k]}" for k in ends))
    faults = run.faults()
    print("counts add up" if not faults else "COUNTS DO NOT ADD UP: " + "; ".join(faults))
    return int(bool(faults))


def _line(name: str, p50: float, p99: float) -> None:
    met = p50 <= GOAL_P50_MS and p99 <= GOAL_P99_MS
    print(f"{name:<44}{p50:>8.1f}{p99:>8.1f}  (goal: {GOAL_P50_MS:g}, {GOAL_P99_MS:g}, {'met' if met else 'missed'})")


if __name__ == "__main__":
    sys.exit(main())
