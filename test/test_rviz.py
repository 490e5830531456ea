"""The RViz view is made of plugins that RViz has, each on a topic of its type. RViz itself is not on PyPI."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

# Of rviz_default_plugins/plugins_description.xml in ROS 2, from Humble on: display and the messages that it takes.
DISPLAYS: dict[str, set[str]] = {
    "AccelStamped": {"geometry_msgs/msg/AccelStamped"},
    "Axes": set(),
    "Camera": {"sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"},
    "DepthCloud": {"sensor_msgs/msg/Image"},
    "Effort": {"sensor_msgs/msg/JointState"},
    "FluidPressure": {"sensor_msgs/msg/FluidPressure"},
    "Grid": set(),
    "GridCells": {"nav_msgs/msg/GridCells"},
    "Illuminance": {"sensor_msgs/msg/Illuminance"},
    "Image": {"sensor_msgs/msg/Image"},
    "InteractiveMarkers": {"visualization_msgs/msg/InteractiveMarkerUpdate"},
    "LaserScan": {"sensor_msgs/msg/LaserScan"},
    "Map": {"nav_msgs/msg/OccupancyGrid"},
    "Marker": {"visualization_msgs/msg/Marker"},
    "MarkerArray": {"visualization_msgs/msg/MarkerArray"},
    "Odometry": {"nav_msgs/msg/Odometry"},
    "Path": {"nav_msgs/msg/Path"},
    "PointCloud": {"sensor_msgs/msg/PointCloud"},
    "PointCloud2": {"sensor_msgs/msg/PointCloud2"},
    "PointStamped": {"geometry_msgs/msg/PointStamped"},
    "Polygon": {"geometry_msgs/msg/PolygonStamped"},
    "Pose": {"geometry_msgs/msg/PoseStamped"},
    "PoseArray": {"geometry_msgs/msg/PoseArray"},
    "PoseWithCovariance": {"geometry_msgs/msg/PoseWithCovarianceStamped"},
    "Range": {"sensor_msgs/msg/Range"},
    "RelativeHumidity": {"sensor_msgs/msg/RelativeHumidity"},
    "RobotModel": set(),
    "TF": {"tf2_msgs/msg/TFMessage"},
    "Temperature": {"sensor_msgs/msg/Temperature"},
    "TwistStamped": {"geometry_msgs/msg/TwistStamped"},
    "Wrench": {"geometry_msgs/msg/WrenchStamped"},
}
TOOLS = {"FocusCamera", "Interact", "Measure", "MoveCamera", "PublishPoint", "Select", "SetGoal", "SetInitialPose"}
VIEWS = {"FPS", "Orbit", "ThirdPersonFollower", "TopDownOrtho", "XYOrbit"}


@pytest.fixture
def view(repository: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load((repository / "config" / "estimator.rviz").read_text("utf-8"))
    manager: dict[str, Any] = loaded["Visualization Manager"]
    return manager


@pytest.fixture
def types(repository: Path) -> dict[str, str]:
    """Return the documented type of each topic; another test compares the page with the node."""
    page = (repository / "docs" / "topics.md").read_text("utf-8")
    return dict(re.findall(r"^\| `~/([^`]+)` \| (\S+) \|", page, flags=re.MULTILINE))


def test_each_display_tool_and_view_is_one_of_rviz(view: dict[str, Any]) -> None:
    displays, tools = ({item["Class"] for item in view[kind]} for kind in ("Displays", "Tools"))
    assert displays <= {f"rviz_default_plugins/{name}" for name in DISPLAYS}
    assert tools <= {f"rviz_default_plugins/{name}" for name in TOOLS}
    assert view["Views"]["Current"]["Class"].removeprefix("rviz_default_plugins/") in VIEWS


def test_each_display_takes_the_messages_of_its_topic(view: dict[str, Any], types: dict[str, str]) -> None:
    shown = [display for display in view["Displays"] if "Topic" in display]
    assert len(shown) >= 7
    for display in shown:
        kind = types[display["Topic"]["Value"].removeprefix("/estimator/")]
        assert kind in DISPLAYS[display["Class"].removeprefix("rviz_default_plugins/")], display["Name"]


def test_what_lies_on_the_floor_is_shown_with_the_floor(view: dict[str, Any]) -> None:
    shown = {display["Topic"]["Value"] for display in view["Displays"] if "Topic" in display}
    assert {f"/estimator/{topic}" for topic in ("free_space", "scan", "room_outline", "floor_pose")} <= shown
