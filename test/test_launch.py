"""Launch file, RViz view, DDS profile and topic docs say what the node does; real launch where it is installed."""

from __future__ import annotations

import importlib.util
import re
import runpy
import sys
import types
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import yaml

NAMESPACE = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


class Recorded:
    """Stands in for an action of `launch`: keeps what it was made of."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments, self.named = arguments, named


@pytest.fixture
def launch_file(repository: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run the launch file with recorders in the place of launch and launch_ros."""
    actions = (
        *("DeclareLaunchArgument", "OpaqueFunction", "SetEnvironmentVariable"),
        *("GroupAction", "IncludeLaunchDescription"),
    )
    fakes: dict[str, dict[str, Any]] = {
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda _: str(repository)},
        "launch": {"LaunchDescription": Recorded}, "launch_ros": {},
        "launch.actions": dict.fromkeys(actions, Recorded),
        "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Recorded},
        "launch.substitutions": {"LaunchConfiguration": Value},
        "launch_ros.actions": {"Node": Recorded, "LifecycleNode": Recorded},
    }  # fmt: skip
    for name, members in fakes.items():
        module = types.ModuleType(name)
        module.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(repository / "launch" / "estimator.launch.py"))


class Value:
    """A launch configuration whose values come from the context, which is a dict here."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self.name]


def started(launch_file: dict[str, Any], **given: str) -> list[Recorded]:
    declared = launch_file["generate_launch_description"]().arguments[0]
    context = {a.arguments[0]: a.named["default_value"] for a in declared if "default_value" in a.named}
    nodes: list[Recorded] = launch_file["start"]({**context, **given})
    return nodes


@pytest.mark.parametrize("camera", ("realsense", "oak", "orbbec", "azure_kinect", "openni", "none"))
def test_a_preset_remaps_every_input_of_the_node(launch_file: dict[str, Any], camera: str) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
    from room_layout_ros.inputs import IMU_TOPIC, INPUT_TOPICS

    (node,) = started(launch_file, camera=camera)
    remapped = dict(node.named["remappings"])
    assert set(remapped) == {*INPUT_TOPICS.values(), IMU_TOPIC}
    assert camera == "none" or all(re.fullmatch(r"(/[a-z0-9_]+)+", topic) for topic in remapped.values()), remapped


def test_the_documented_names_are_those_of_the_presets(launch_file: dict[str, Any], repository: Path) -> None:
    page = (repository / "docs" / "cameras.md").read_text("utf-8")
    for camera in launch_file["PRESETS"]:
        rows = "".join(line for line in page.splitlines() if line.startswith(f"| `{camera}`"))
        names = launch_file["names"](camera)
        topics = {t for registered in (True, False) for _, t in launch_file["remappings"](names, registered)}
        for name in (*topics, names.frame):
            assert f"`{name}`" in rows, camera


def test_the_documented_imu_of_a_realsense_is_switched_on(repository: Path) -> None:
    """Its driver has both halves off by default, and joins them on no topic."""
    (row,) = re.findall(
        r"^\| `realsense` .*/camera/camera/imu.*$", (repository / "docs" / "cameras.md").read_text(), re.M
    )
    for argument in ("enable_gyro:=true", "enable_accel:=true", "unite_imu_method:=2"):
        assert argument in row


def test_every_argument_is_documented(launch_file: dict[str, Any], repository: Path) -> None:
    page = (repository / "docs" / "cameras.md").read_text("utf-8")
    for name in launch_file["ARGUMENTS"]:
        assert f"`{name}:=" in page or f"{name}:=" in page, name


def test_the_node_knows_which_arguments_are_the_launch_files(launch_file: dict[str, Any]) -> None:
    from room_layout_ros.core.config import parameters
    from room_layout_ros.node_config import NodeConfig
    from room_layout_ros.ros_arguments import OF_LAUNCH

    of_node = {row.name for row in parameters(NodeConfig)} | {"use_sim_time"}
    assert set(OF_LAUNCH) == set(launch_file["ARGUMENTS"]) - of_node


def test_the_documented_remappings_are_those_of_the_launch_file(launch_file: dict[str, Any], repository: Path) -> None:
    page = (repository / "docs" / "cameras.md").read_text("utf-8")
    section = page.partition("## Without ros2 launch\n")[2].partition("\n## ")[0]
    given = dict(re.findall(r"-r ([a-z_/]+):=(/camera[\w/]+)", section))
    names = launch_file["names"]("realsense")
    assert given == dict(launch_file["remappings"](names))


def test_depth_in_its_own_view_comes_from_its_own_topics(launch_file: dict[str, Any]) -> None:
    (aligned,) = started(launch_file, camera="realsense")
    (own,) = started(launch_file, camera="realsense", depth_registered="false")
    assert dict(own.named["remappings"])["depth_registered/image_rect"] == "/camera/camera/depth/image_rect_raw"
    assert dict(own.named["remappings"])["depth/camera_info"] == "/camera/camera/depth/camera_info"
    assert [n.named["parameters"][1]["depth_registered"] for n in (aligned, own)] == [True, False]


def test_transports_and_imu_can_be_given(launch_file: dict[str, Any]) -> None:
    given = {"color_transport": "compressed", "depth_transport": "compressedDepth", "floor_frame": "ground"}
    (node,) = started(launch_file, camera="oak", imu="/body/imu", **given)
    assert given.items() <= node.named["parameters"][1].items()
    assert dict(node.named["remappings"])["imu"] == "/body/imu"
    (node,) = started(launch_file, camera="oak")
    assert not given.keys() & node.named["parameters"][1].keys(), "what is not given is left to params_file"
    assert dict(node.named["remappings"])["imu"] == "/oak/imu/data"


def test_what_the_launch_file_sets_are_parameters_with_allowed_values(launch_file: dict[str, Any]) -> None:
    from room_layout_ros.node_config import NodeConfig

    given = {"color_transport": "compressed", "depth_transport": "compressedDepth", "floor_frame": "ground"}
    (node,) = started(launch_file, depth_registered="false", **given)
    values = {name: value for name, value in node.named["parameters"][1].items() if name != "use_sim_time"}
    assert NodeConfig(**values).depth_registered is False


def test_two_cameras_share_no_name(launch_file: dict[str, Any], repository: Path) -> None:
    both = runpy.run_path(str(repository / "launch" / "two_cameras.launch.py"))
    *declared, left, right = both["generate_launch_description"]().arguments[0]
    context = {a.arguments[0]: a.named["default_value"] for a in declared}
    nodes = []
    for group in (left, right):
        (include,) = group.arguments[0]
        assert include.arguments[0].arguments[0] == str(repository / "launch" / "estimator.launch.py")
        arguments = {k: v.perform(context) if isinstance(v, Value) else v for k, v in include.named["launch_arguments"]}
        assert arguments.keys() <= launch_file["ARGUMENTS"].keys()
        nodes += started(launch_file, **arguments)
    names, floors = [], []
    for node in nodes:
        names.append(f"/{node.named['namespace']}/{node.named['name']}")
        floors.append(node.named["parameters"][1]["floor_frame"])
    assert names == ["/left/estimator", "/right/estimator"]
    assert floors == ["left_floor", "right_floor"]
    topics = [set(dict(node.named["remappings"]).values()) for node in nodes]
    assert not topics[0] & topics[1]


def test_the_name_of_the_camera_and_the_namespace_can_be_given(launch_file: dict[str, Any]) -> None:
    (node,) = started(launch_file, camera="orbbec", camera_name="left_camera", namespace="left", use_sim_time="true")
    assert node.named["namespace"] == "left"
    assert dict(node.named["remappings"])["rgb/camera_info"] == "/left_camera/color/camera_info"
    assert node.named["parameters"][1] == {"use_sim_time": True, "depth_registered": True}
    assert Path(node.named["parameters"][0]).is_file()


def test_the_clock_is_that_of_the_parameter_file_unless_it_is_given_and_then_rviz_has_it_too(
    launch_file: dict[str, Any],
) -> None:
    (node,) = started(launch_file)
    assert "use_sim_time" not in node.named["parameters"][1]
    for given in (True, False):
        for node in started(launch_file, rviz="true", use_sim_time=str(given).lower()):
            assert node.named["parameters"][-1]["use_sim_time"] is given


def test_executables_are_those_that_are_installed(launch_file: dict[str, Any], repository: Path) -> None:
    setup = (repository / "setup.py").read_text("utf-8")
    nodes = [*started(launch_file), *started(launch_file, lifecycle="true")]
    for node in nodes:
        assert f'"{node.named["executable"]} = room_layout_ros.node:' in setup


def test_rviz_shows_topics_of_the_node(launch_file: dict[str, Any], repository: Path) -> None:
    view = yaml.safe_load((repository / "config" / "estimator.rviz").read_text("utf-8"))
    shown = {d["Topic"]["Value"] for d in view["Visualization Manager"]["Displays"] if "Topic" in d}
    assert shown <= {f"/estimator/{topic}" for topic in launch_file["VIEWED"]}
    _, rviz = started(launch_file, rviz="true", namespace="left", node_name="rooms")
    assert ("/estimator/markers", "/left/rooms/markers") in rviz.named["remappings"]
    assert rviz.named["parameters"] == []
    assert Path(rviz.named["arguments"][1]).is_file()


def test_the_displays_that_need_the_transform_of_the_floor_are_documented(repository: Path) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
    from room_layout_ros.outputs import OUTPUTS

    view = yaml.safe_load((repository / "config" / "estimator.rviz").read_text("utf-8"))
    on_floor = {o.topic.replace("~", "/estimator") for o in OUTPUTS if o.on_floor}
    displays = {d["Name"]: d["Topic"]["Value"] for d in view["Visualization Manager"]["Displays"] if "Topic" in d}
    page = (repository / "docs" / "cameras.md").read_text("utf-8").partition("## RViz")[2]
    assert set(re.findall(r"\*\*([^*]+)\*\*", page)) == {n for n, topic in displays.items() if topic in on_floor}


@pytest.mark.parametrize(
    ("given", "frame"),
    (
        ({"camera": "realsense"}, "camera_color_optical_frame"),
        ({"camera": "realsense", "camera_name": "left/left_camera"}, "left_camera_color_optical_frame"),
        ({"camera": "oak"}, "oak_rgb_camera_optical_frame"),
        ({"camera": "none"}, "camera"),
        ({"camera": "oak", "fixed_frame": "odom"}, "odom"),
    ),
)
def test_rviz_shows_all_in_the_frame_of_the_camera(
    launch_file: dict[str, Any], given: dict[str, str], frame: str
) -> None:
    _, rviz = started(launch_file, rviz="true", **given)
    assert rviz.named["arguments"][2:] == ["-f", frame]


def test_the_dds_profile_has_room_for_images(repository: Path, launch_file: dict[str, Any]) -> None:
    tree = ET.parse(repository / "config" / "fastdds.xml")
    sizes = [int(e.text or 0) for e in tree.iter(f"{NAMESPACE}segment_size")]
    assert sizes == [32 * 1024 * 1024]
    assert [e.text for e in tree.iter(f"{NAMESPACE}useBuiltinTransports")] == ["false"]
    variables = [
        a.arguments for a in launch_file["generate_launch_description"]().arguments[0] if len(a.arguments) == 2
    ]
    assert variables[0][0] == "FASTRTPS_DEFAULT_PROFILES_FILE"


def test_every_topic_is_documented_with_its_type_and_frame(repository: Path) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
    from room_layout_ros.inputs import IMU_TOPIC, INPUT_TOPICS
    from room_layout_ros.outputs import OUTPUTS
    from room_layout_ros.publications import DIAGNOSTICS_TOPIC, LABEL_NAMES_TOPIC

    page = (repository / "docs" / "topics.md").read_text("utf-8")
    rows = re.findall(r"^\| `([^`]+)` \| (\S+) \| ([^|]+) \|", page, flags=re.MULTILINE)
    documented = {topic: kind for topic, kind, _ in rows}
    frames = {topic: frame for topic, _, frame in rows}
    expected = {o.topic: f"{o.message.__module__.split('.')[0]}/msg/{o.message.__name__}" for o in OUTPUTS}
    assert {t: kind for t, kind in documented.items() if t in expected} == expected
    assert set(documented) == {*expected, *INPUT_TOPICS.values(), IMU_TOPIC, LABEL_NAMES_TOPIC, DIAGNOSTICS_TOPIC}
    for output in OUTPUTS:
        assert f"| {output.meaning} |" in page
        assert frames[output.topic] == ("floor" if output.on_floor else "camera"), output.topic
    explained = set(re.findall(r"^\| ([a-z ]+) \| [^|]+ \| [^|]+ \|$", page, flags=re.MULTILINE))
    assert set(frames.values()) - {"-"} <= explained


@pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="launch is not installed (it is not on PyPI)"
)
@pytest.mark.parametrize("name", ("estimator", "two_cameras"))
def test_the_launch_file_loads_in_the_real_launch(repository: Path, name: str) -> None:
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    description = get_launch_description_from_python_launch_file(str(repository / "launch" / f"{name}.launch.py"))
    assert len(description.entities) >= 5
