"""The node as a user runs it: a process among others, over Fast DDS, to its last breath."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
pytest.importorskip("rosbags", reason="rosbags is not installed (pip: extra playback)")

from processes import ManyNodes, python, read_until, rest, slack
from rclpy.context import Context
from rclpy.node import Node
from room_frames import FRAME_ID, room_frame, stamp_ns
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.outputs import OUTPUTS
from room_layout_ros.ros_process import idle_files, leave

pytestmark = pytest.mark.dds

HERE = Path(__file__).resolve().parent
NODE = ("-m", "room_layout_ros.node", "--ros-args")
FRAMES = 75
RELIABILITY = "qos_overrides./rgb/image_rect_color.subscription.reliability"
DEPTH = "qos_overrides./depth_registered/image_rect/compressedDepth.subscription.depth"


@pytest.fixture(scope="module")
def many(repository: Path) -> Iterator[ManyNodes]:
    """Starts nodes that end at once, without loading anew for each."""
    nodes = ManyNodes(repository)
    yield nodes
    nodes.close()


def remapped(namespace: str, *parameters: str) -> Sequence[str]:
    return ["-r", f"__ns:={namespace}", *(part for p in parameters for part in ("-p", p))]


def played(repository: Path, bag: Path, namespace: str) -> tuple[str, dict[str, list[int]]]:
    """Play, estimate and record in three processes; return the player's words and the recorder's counts."""
    topics = [o.topic.replace("~", f"{namespace}/estimator") for o in OUTPUTS] + ["/diagnostics"]
    with (
        python(repository, *NODE, *remapped(namespace, "warm_start:=false")) as node,
        python(repository, "-m", "room_layout_ros.recording", "--out", str(bag), *topics) as recorder,
    ):
        read_until(node, "listening to")
        player_arguments = ("--frames", str(FRAMES), "--namespace", namespace)
        with python(repository, str(HERE / "dds_player.py"), *player_arguments) as player:
            sent = rest(player, 60 * slack())
        time.sleep(1.2)  # one more message on /diagnostics
        recorder.send_signal(signal.SIGINT)
        counts = json.loads(rest(recorder, 20 * slack()).strip().splitlines()[-1])
        node.send_signal(signal.SIGINT)
        rest(node, 10 * slack())
        assert node.returncode == 0
    return sent, counts


def messages_of(bag: Path) -> dict[str, list[Any]]:
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        topics: dict[str, list[Any]] = {}
        for connection, _, raw in reader.messages():
            topics.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
        return topics


def last_diagnostics(messages: list[Any], node: str) -> dict[str, dict[str, str]]:
    """Return the values of the last message of `node` by the name of the finding."""
    own = [m for m in messages if m.status[0].name.startswith(node + ":")]
    return {s.name.partition(": ")[2]: {v.key: v.value for v in s.values} for s in own[-1].status}


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def headed(message: Any) -> Iterator[Any]:
    """Yield every message with a header, nested ones too."""
    if hasattr(message, "header"):
        yield message
    for field in fields(message):
        part = getattr(message, field.name)
        for inner in part if isinstance(part, list) else [part]:
            if is_dataclass(inner):
                yield from headed(inner)


def check_agrees_with_offline(published: dict[str, list[Any]], estimator: LayoutEstimator, i: int) -> None:
    """Compare the messages about frame `i`, by the end of their topics' names, bit by bit."""
    estimate = estimator.estimate(room_frame(i))
    for topic in ("labels", "layout", "furniture"):
        (message,) = published[topic]
        assert bytes(message.data) == getattr(estimate, topic).tobytes(), f"{topic} of frame {i}"
    told = {m.polygon.id: [(p.x, p.y, p.z) for p in m.polygon.polygon.points] for m in published["polygons"]}
    assert len(told) == len(published["polygons"]), "one for each face"
    seen = {p.face: [tuple(corner) for corner in p.points_m.astype(np.float32).tolist()] for p in estimate.polygons}
    assert told == seen, f"polygons of frame {i}"


def test_three_processes_at_30_hz_account_for_every_frame_and_agree_with_offline(
    repository: Path, tmp_path: Path
) -> None:
    """Player, estimator, recorder: 640x480 pairs at 30 Hz; sums hold, and results are bit-equal with offline."""
    namespace = f"/run{os.getpid()}"
    sent, counts = played(repository, tmp_path / "bag", namespace)
    assert f"sent {FRAMES}" in sent
    topics = messages_of(tmp_path / "bag")
    labels = topics[f"{namespace}/estimator/labels"]
    facts = last_diagnostics(topics["/diagnostics"], f"{namespace.strip('/')}/estimator")

    color, depth, pairs = facts["input colour"], facts["input depth"], facts["estimates"]
    for stream in (color, depth):
        received = int(stream["received"])
        unmatched = FRAMES - received - int(stream["lost"])
        assert 0 <= unmatched <= 2, "the node counts what it missed, but for frames sent while discovery still ran"
        refused = sum(int(n) for key, n in stream.items() if key.startswith("refused"))
        assert received == int(stream["paired"]) + int(stream["superseded"]) + int(stream["waiting"]) + refused
        assert refused == 0
        assert int(stream["paired"]) == int(pairs["pairs"])
    dropped = {key: int(n) for key, n in pairs.items() if key.startswith("dropped")}
    assert set(dropped) <= {"dropped: newer frame"}
    empty = sum(int(n) for key, n in pairs.items() if key.startswith("no estimate"))
    assert int(pairs["pairs"]) == int(pairs["published"]) + empty + sum(dropped.values())
    assert int(pairs["in_flight"]) == 0
    assert int(pairs["pairs"]) >= FRAMES / 2  # all of them on an idle machine; one that stands still loses some in DDS

    assert len(labels) == counts[f"{namespace}/estimator/labels"][0] == int(pairs["published"]) >= 5 / slack()
    number = {stamp_ns(i): i for i in range(FRAMES)}
    stamps = [stamp_of(m) for m in labels]
    assert set(stamps) <= set(number)
    assert stamps == sorted(set(stamps))
    published: dict[int, dict[str, list[Any]]] = {stamp: defaultdict(list) for stamp in stamps}
    for output in OUTPUTS:
        name = output.topic.removeprefix("~/")
        parts = [part for m in topics[f"{namespace}/estimator/{name}"] for part in headed(m)]
        assert {part.header.frame_id for part in parts} == {f"{FRAME_ID}_floor" if output.on_floor else FRAME_ID}, name
        assert {stamp_of(part) for part in parts} == set(stamps), name
        for part in parts:
            published[stamp_of(part)][name].append(part)
    estimator = LayoutEstimator()
    for stamp in stamps:
        check_agrees_with_offline(published[stamp], estimator, number[stamp])


def test_f13_what_small_shared_memory_loses_is_lost_on_the_way_and_names_the_profile(repository: Path) -> None:
    namespace = f"/lossy{os.getpid()}"
    with python(repository, *NODE, *remapped(namespace, "lazy_inputs:=false")) as node:
        read_until(node, "listening to")
        arguments = (str(HERE / "dds_player.py"), "--frames", "150", "--namespace", namespace)
        with python(repository, *arguments, FASTRTPS_DEFAULT_PROFILES_FILE=""):
            said = read_until(node, "messages lost on the way")
        end_in_time(node, signal.SIGINT)
    assert f"FASTRTPS_DEFAULT_PROFILES_FILE={repository / 'config' / 'fastdds.xml'}" in said.splitlines()[-1]


@pytest.mark.parametrize("number", (signal.SIGINT, signal.SIGTERM), ids=("SIGINT", "SIGTERM"))
@pytest.mark.parametrize("moment", ("warming up", "idle", "in a frame"))
def test_f39_a_signal_ends_it_in_two_seconds_with_exit_code_0(
    repository: Path, number: signal.Signals, moment: str
) -> None:
    namespace = f"/signal{os.getpid()}"
    parameters = ["lazy_inputs:=false"] if moment == "in a frame" else []
    with python(repository, *NODE, *remapped(namespace, *parameters)) as node:
        if moment == "warming up":
            read_until(node, "warming up")
        elif moment == "idle":
            read_until(node, "warm after")
            time.sleep(0.3)
        else:
            read_until(node, "listening to")
            arguments = ("--frames", "40", "--namespace", namespace)
            with python(repository, str(HERE / "dds_player.py"), *arguments) as player:
                read_until(player, "playing")
                time.sleep(0.7)
                end_in_time(node, number)
            return
        end_in_time(node, number)


@pytest.mark.parametrize("apart_s", (0.02, 0.15))
def test_a_second_sigterm_during_the_end_is_no_other_end(repository: Path, apart_s: float) -> None:
    with python(repository, *NODE, *remapped(f"/twice{os.getpid()}")) as node:
        read_until(node, "warm after")
        node.send_signal(signal.SIGTERM)
        time.sleep(apart_s)
        end_in_time(node, signal.SIGTERM)


@pytest.mark.parametrize(
    ("module", "number"),
    (
        ("numpy", signal.SIGINT),
        ("numba", signal.SIGTERM),
        ("rclpy", signal.SIGINT),
        ("room_layout_ros.shell", signal.SIGTERM),
    ),
)
def test_f39_a_signal_while_it_loads_ends_it_with_exit_code_0(
    repository: Path, module: str, number: signal.Signals
) -> None:
    with python(repository, "-X", "importtime", *NODE) as node:
        read_until(node, rf"\| +{module}\b")  # Python names a module, or a part of it, when it has loaded it
        node.send_signal(number)
        said = rest(node, 20)
    assert node.returncode == 0, said
    assert "Traceback" not in said


def end_in_time(node: subprocess.Popen[str], number: signal.Signals) -> None:
    start = time.monotonic()
    node.send_signal(number)
    said = rest(node, 20 * slack())
    took = time.monotonic() - start
    assert node.returncode == 0, said
    assert "Traceback" not in said
    assert took < 2.0 * slack(), f"took {took:.1f} s"


@pytest.mark.parametrize(
    ("parameter", "words"),
    (
        ("max_stamp_gap:=7.0", "max_stamp_gap"),
        ("queue_size:=many", "queue_size"),
        ("max_depth_m:=.nan", "max_depth_m"),
        ("reset_gap:=0.01", "reset_gap"),
        ("camera_height:=11", "camera_height"),
        (f"{RELIABILITY}:=sometimes", f"{RELIABILITY} is 'sometimes'; allowed are"),
        (f"{RELIABILITY}:=3", RELIABILITY),
        (f"{DEPTH}:=0", f"{DEPTH} is 0; it must be at least 1"),
        ("qos_overrides./estimator/labels.publisher.reliability:=sometimes", "sometimes"),
        ("use_color:=false -p use_depth:=false", "use_color and use_depth are both false"),
        ("robot_hieght_m:=1.0", "'robot_hieght_m' is no parameter of this node; the nearest name is robot_height_m"),
        ("xyzzy:=1.0 -p qqq:=2", "'qqq' is no parameter of this node (and 1 more); `ros2 param list`"),
    ),
)
def test_f33_wrong_settings_at_the_start_are_a_sentence_and_exit_code_2(
    many: ManyNodes, parameter: str, words: str
) -> None:
    code, said = many.run("--ros-args", "-p", *parameter.split())
    assert code == 2, said
    assert "Traceback" not in said
    assert words in said.splitlines()[-1]


@pytest.mark.parametrize(
    ("word", "words"),
    (
        ("robot_height_m:=1.0", "estimator --ros-args -p robot_height_m:=1.0"),
        ("__node:=left", "estimator --ros-args -r __node:=left"),
        ("rgb/image_rect_color:=/x", "estimator --ros-args -r rgb/image_rect_color:=/x"),
        (
            "camera:=realsense",
            "estimator.launch.py camera:=realsense); docs/cameras.md, Without ros2 launch, has the -r",
        ),
        ("depth_registered:=false camera:=oak", "'camera:=oak' is an argument of the launch file"),
        ("depth_registered:=false", "estimator --ros-args -p depth_registered:=false"),
        ("namespace:=/left", "here it is --ros-args -r __ns:=/left"),
        ("imu:=/body/imu", "here it is --ros-args -r imu:=/body/imu"),
        ("--ros-args -p camera:=realsense", "'camera:=realsense' is an argument of the launch file"),
        ("--ros-args -p queue_size:=9 camera_height:=0.8", "estimator: -p is missing before camera_height:=0.8"),
        ("--ros-args -p queue_size:=9 rgb/camera_info:=/x", "estimator: -r is missing before rgb/camera_info:=/x"),
        ("--ros-args -p queue_size:=9 fast", "'fast' is no argument of ROS; what stands before it is complete"),
        ("--ros-args --fast", "'--fast' is no argument of ROS"),
        ("--ros-args -p color_transport=compressed", "missing in -p color_transport=compressed; write -p color_tran"),
        ("--ros-args -r a=/b", "':=' is missing in -r a=/b; write -r a:=/b"),
        ("--ros-args -p fast", "':=' is missing in -p fast; it must be -p NAME:=VALUE"),
        ("--ros-args -p fast:=", "nothing stands behind ':=' in -p fast:=; it must be -p NAME:=VALUE"),
        ("--ros-args -r", "nothing stands behind -r; it must be -r FROM:=TO"),
        ("--ros-args -r __ns:=left", "a namespace begins with '/': write -r __ns:=/left in the place of -r __ns:=left"),
        ("--params-file", "'--params-file' is no argument"),
        ("--ros-args --params-file nofile.yaml", "estimator: --params-file nofile.yaml: there is no such file"),
        ("-- extra", "'--' is no argument"),
        ("--ros-args -r __node:=left -- extra", "'extra' is no argument"),
    ),
)
def test_f33_words_that_are_none_of_ros_and_missing_files_are_refused(repository: Path, word: str, words: str) -> None:
    with python(repository, "-m", "room_layout_ros.node", *word.split()) as node:
        said = rest(node, 30)
    assert node.returncode == 2, said
    assert len(said.splitlines()) == 1
    assert words in said


def test_it_says_how_long_the_first_start_takes_and_when_it_is_ready(repository: Path) -> None:
    with python(repository, *NODE) as node:
        said = read_until(node, "ready, warm after")
        assert "the first start after an installation compiles for one to four minutes" in said
        end_in_time(node, signal.SIGINT)


def test_the_lifecycle_node_says_that_it_waits(repository: Path) -> None:
    run = "from room_layout_ros.node import lifecycle_main; raise SystemExit(lifecycle_main())"
    with python(repository, "-c", run, "--ros-args", "-r", "__ns:=/a") as node:
        read_until(node, "waits to be configured: ros2 lifecycle set /a/estimator configure")
        end_in_time(node, signal.SIGINT)


@pytest.mark.parametrize("main", ("main", "lifecycle_main"))
def test_help_says_how_it_is_used_and_starts_nothing(repository: Path, main: str) -> None:
    with python(
        repository, "-c", f"from room_layout_ros.node import {main}; raise SystemExit({main}())", "--help"
    ) as node:
        said = rest(node, 30)
    assert node.returncode == 0, said
    assert said.startswith("usage: lifecycle_estimator" if main == "lifecycle_main" else "usage: estimator")
    assert "docs/parameters.md" in said


def test_what_ros_and_launch_files_give_at_the_start_is_taken(repository: Path) -> None:
    given: tuple[str, ...] = (
        "-r __node:=left",
        "-r __ns:=/a",
        "-r rgb/camera_info:=/x",
        "-p use_sim_time:=false",
        "--log-level info",
    )
    given += ("-p start_type_description_service:=false", f"-p {RELIABILITY}:=reliable", "-p robot_height_m:=1")
    with python(repository, *NODE, *" ".join(given).split()) as node:
        assert "a.left" in read_until(node, "warm after|ready after")
        end_in_time(node, signal.SIGINT)


def test_f33_a_misspelt_remapping_is_a_warning_at_the_start_and_one_of_two_inputs_to_one_topic_is_none(
    repository: Path,
) -> None:
    rules = ("rgb/camera_info:=/depth/camera_info", "rgb/image_rect_colour:=/camera/image")
    given = [word for rule in rules for word in ("-r", rule)]
    with python(repository, *NODE, *given) as node:
        said = read_until(node, "warm after")
        end_in_time(node, signal.SIGINT)
    (line,) = [line for line in said.splitlines() if "changes nothing" in line]
    assert "[WARN]" in line
    assert line.endswith("the nearest name is rgb/image_rect_color")


def test_f33_a_missing_parameter_file_is_a_sentence_and_exit_code_2(repository: Path) -> None:
    with python(repository, *NODE, "--params-file", "/nowhere/estimator.yaml") as node:
        said = rest(node, 30)
    assert node.returncode == 2, said
    assert "Traceback" not in said
    assert "/nowhere/estimator.yaml" in said


@pytest.mark.parametrize(("text", "line"), (("camera_height: 1.0", 1), ("estimator:\n  camera_height: 1.0", 2)))
def test_f33_a_parameter_file_without_ros_parameters_is_a_sentence_and_exit_code_2(
    many: ManyNodes, tmp_path: Path, text: str, line: int
) -> None:
    file = tmp_path / "my.yaml"
    file.write_text(text)
    code, said = many.run("--ros-args", "--params-file", str(file))
    assert code == 2, said
    words = "'camera_height' has to stand below ros__parameters, and that below the name of the node"
    assert said == f"estimator: --params-file {file}, line {line}: {words}: see config/estimator.yaml\n"


@pytest.mark.parametrize(
    ("given", "words"),
    (
        (
            "--log-level loud",
            "Couldn't parse log level: '--log-level loud'. Error: Argument does not use a valid severity",
        ),
        ("-r __node:=a-b", "remap rule: '-r __node:=a-b'. Error: it is wrong behind its first 9 characters"),
    ),
)
def test_f33_what_only_ros_finds_wrong_names_no_place_in_its_source(many: ManyNodes, given: str, words: str) -> None:
    code, said = many.run("--ros-args", *given.split())
    assert code == 2, said
    assert said.splitlines()[-1].startswith("estimator: Couldn't parse")
    assert words in said.splitlines()[-1]
    assert "/project/" not in said
    assert "lexeme" not in said


HEIGHT = "ros__parameters: {camera_height: 1.5}"


@pytest.mark.parametrize(
    ("text", "hint"),
    (
        (f"estimatr: {{{HEIGHT}}}", "the nearest name is /estimatr"),
        (f"left: {{estimator: {{{HEIGHT}}}}}", "the nearest name is /left/estimator"),
        (f"/*/estimator: {{{HEIGHT}}}", "the nearest name is /*/estimator"),
        (f"a: {{{HEIGHT}}}\nb: {{{HEIGHT}}}", "it is for /a, /b"),
        ("", "it is for no node"),
        (f"/**: {{{HEIGHT}}}", None),
        (f"'*': {{{HEIGHT}}}", None),
        (f"/**/estimator: {{{HEIGHT}}}", None),
        (f"/estimator: {{{HEIGHT}}}\nother: {{{HEIGHT}}}", None),
    ),
)
def test_f33_a_parameter_file_that_holds_nothing_for_the_node_is_a_warning(
    tmp_path: Path, text: str, hint: str | None
) -> None:
    """As rclpy has it: where there is no warning, the value has come."""
    file = tmp_path / "my.yaml"
    file.write_text(text)
    context = Context()
    context.init(args=["--ros-args", "--params-file", str(file)])
    try:
        node = Node("estimator", context=context)
        said = list(idle_files(node, ["--ros-args", "--params-file", str(file)]))
        assert bool(node._parameter_overrides) == (hint is None)
        node.destroy_node()
    finally:
        context.try_shutdown()
    assert said == ([] if hint is None else [f"--params-file {file} holds nothing for /estimator; {hint}"])


def test_f33_a_parameter_file_of_other_nodes_is_a_warning_at_the_start(repository: Path) -> None:
    with python(repository, *NODE, "--params-file", "config/nav2_costmap.yaml") as node:
        said = read_until(node, "warm after")
        end_in_time(node, signal.SIGINT)
    (line,) = [line for line in said.splitlines() if "holds nothing" in line]
    assert "[WARN]" in line
    assert "config/nav2_costmap.yaml holds nothing for /estimator; it is for /local_costmap/local_costmap" in line


def test_f33_a_domain_that_is_none_is_a_sentence_and_exit_code_2(many: ManyNodes) -> None:
    code, said = many.run("--ros-args", ROS_DOMAIN_ID="9999")
    assert code == 2, said
    assert said == "estimator: ROS_DOMAIN_ID is '9999'; it must be a whole number of 0 to 232\n"


def test_the_documented_program_runs_two_nodes_in_one_process(repository: Path) -> None:
    page = (repository / "docs" / "node.md").read_text("utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    with python(repository, "-c", program) as node:
        seen = ""
        while seen.count("warm after") < 2:
            seen += read_until(node, "warm after")
        assert {"left.estimator", "right.estimator"} <= set(re.findall(r"\w+\.estimator", seen))
        end_in_time(node, signal.SIGINT)


def test_the_shipped_parameter_file_starts_the_node(repository: Path) -> None:
    with python(repository, *NODE, "--params-file", str(repository / "config" / "estimator.yaml")) as node:
        read_until(node, "warm after")
        end_in_time(node, signal.SIGTERM)


def test_the_collector_does_not_search_what_was_loaded(repository: Path) -> None:
    code = (
        "import gc; from room_layout_ros import estimator_node as e; "
        "e._spin = lambda *_: print('kept', gc.get_freeze_count(), 'searched', len(gc.get_objects())); "
        "e.run(e.EstimatorNode, [])"
    )
    with python(repository, "-c", code) as process:
        kept, searched = re.findall(r"kept (\d+) searched (\d+)", read_until(process, "kept"))[0]
    assert int(kept) > 10 * int(searched)


def test_a_signal_may_end_the_context_while_it_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    def end_twice() -> None:
        raise RuntimeError("rcl_shutdown already called on the given context")

    monkeypatch.setattr("rclpy.try_shutdown", end_twice)
    leave()
