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
    actions = ("DeclareLaunchArgument", "OpaqueFunction", "SetEnvironmentVariable")
    fakes: dict[str, dict[str, Any]] = {
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda _: str(repository)},
        "launch": {"LaunchDescription": Recorded}, "launch_ros": {},
        "launch.actions": dict.fromkeys(actions, Recorded),
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
    from room_layout_ros.inputs import INPUT_TOPICS

    (node,) = started(launch_file, camera=camera)
    remapped = dict(node.named["remappings"])
    assert set(remapped) == set(INPUT_TOPICS.values()) - {"depth/camera_info"}
    assert camera == "none" or all(re.fullmatch(r"(/[a-z_]+)+", topic) for topic in remapped.values()), remapped


def test_the_documented_names_are_those_of_the_presets(launch_file: dict[str, Any], repository: Path) -> None:
    page = (repository / "docs" / "cameras.md").read_text("utf-8")
    for camera in launch_file["PRESETS"]:
        (row,) = [line for line in page.splitlines() if line.startswith(f"| `{camera}`")]
        for _, topic in launch_file["remappings"](camera):
            assert f"`{topic}`" in row


def test_the_name_of_the_camera_and_the_namespace_can_be_given(launch_file: dict[str, Any]) -> None:
    (node,) = started(launch_file, camera="orbbec", camera_name="left_camera", namespace="left", use_sim_time="true")
    assert node.named["namespace"] == "left"
    assert dict(node.named["remappings"])["rgb/camera_info"] == "/left_camera/color/camera_info"
    assert node.named["parameters"][1] == {"use_sim_time": True}
    assert Path(node.named["parameters"][0]).is_file()


def test_executables_are_those_that_are_installed(launch_file: dict[str, Any], repository: Path) -> None:
    setup = (repository / "setup.py").read_text("utf-8")
    nodes = [*started(launch_file), *started(launch_file, lifecycle="true")]
    for node in nodes:
        assert f'"{node.named["executable"]} = room_layout_ros.node:' in setup


def test_rviz_shows_topics_of_the_node(launch_file: dict[str, Any], repository: Path) -> None:
    view = yaml.safe_load((repository / "config" / "estimator.rviz").read_text("utf-8"))
    shown = {d["Topic"]["Value"] for d in view["Visualization Manager"]["Displays"] if "Topic" in d}
    assert shown <= {f"/estimator/{topic}" for topic in launch_file["VIEWED"]}
    _, rviz = started(launch_file, rviz="true", namespace="left")
    assert ("/estimator/markers", "/left/estimator/markers") in rviz.named["remappings"]
    assert Path(rviz.named["arguments"][1]).is_file()


def test_the_dds_profile_has_room_for_images(repository: Path, launch_file: dict[str, Any]) -> None:
    tree = ET.parse(repository / "config" / "fastdds.xml")
    sizes = [int(e.text or 0) for e in tree.iter(f"{NAMESPACE}segment_size")]
    assert sizes == [32 * 1024 * 1024]
    assert [e.text for e in tree.iter(f"{NAMESPACE}useBuiltinTransports")] == ["false"]
    variables = [
        a.arguments for a in launch_file["generate_launch_description"]().arguments[0] if len(a.arguments) == 2
    ]
    assert variables[0][0] == "FASTRTPS_DEFAULT_PROFILES_FILE"


def test_every_topic_is_documented_with_its_type(repository: Path) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
    from room_layout_ros.inputs import INPUT_TOPICS
    from room_layout_ros.outputs import OUTPUTS
    from room_layout_ros.publications import DIAGNOSTICS_TOPIC, LABEL_NAMES_TOPIC
    from room_layout_ros.subscriptions import IMU_TOPIC

    page = (repository / "docs" / "topics.md").read_text("utf-8")
    documented = dict(re.findall(r"^\| `([^`]+)` \| (\S+)", page, flags=re.MULTILINE))
    expected = {o.topic: f"{o.message.__module__.split('.')[0]}/msg/{o.message.__name__}" for o in OUTPUTS}
    assert {t: kind for t, kind in documented.items() if t in expected} == expected
    assert set(documented) == {*expected, *INPUT_TOPICS.values(), IMU_TOPIC, LABEL_NAMES_TOPIC, DIAGNOSTICS_TOPIC}
    for output in OUTPUTS:
        assert f"| {output.meaning} |" in page


@pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="launch is not installed (it is not on PyPI)"
)
def test_the_launch_file_loads_in_the_real_launch(repository: Path) -> None:
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    description = get_launch_description_from_python_launch_file(str(repository / "launch" / "estimator.launch.py"))
    assert len(description.entities) >= 8
