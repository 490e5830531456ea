"""Start the estimator on the topics of a known camera.

    ros2 launch room_layout_ros estimator.launch.py camera:=realsense
    ros2 launch room_layout_ros estimator.launch.py camera:=orbbec namespace:=left camera_name:=left_camera rviz:=true

Two cameras: two launches (or two includes) with different `namespace`.
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

from launch import LaunchDescription

# Topics of the drivers with depth aligned to colour; {camera} is the argument camera_name.
# preset: (default camera_name, colour, camera_info, depth, how the driver is told to align depth)
PRESETS = {
    "realsense": (
        "camera/camera",
        "/{camera}/color/image_raw",
        "/{camera}/color/camera_info",
        "/{camera}/aligned_depth_to_color/image_raw",
        "align_depth.enable:=true",
    ),
    "oak": (
        "oak",
        "/{camera}/rgb/image_raw",
        "/{camera}/rgb/camera_info",
        "/{camera}/stereo/image_raw",
        "pipeline type RGBD (depth is aligned to rgb by default)",
    ),
    "orbbec": (
        "camera",
        "/{camera}/color/image_raw",
        "/{camera}/color/camera_info",
        "/{camera}/depth/image_raw",
        "depth_registration:=true",
    ),
    "azure_kinect": (
        "",
        "{camera}/rgb/image_raw",
        "{camera}/rgb/camera_info",
        "{camera}/depth_to_rgb/image_raw",
        "depth_to_rgb is aligned by itself",
    ),
    "openni": (
        "camera",
        "/{camera}/rgb/image_raw",
        "/{camera}/rgb/camera_info",
        "/{camera}/depth_registered/image_raw",
        "depth_registration:=true",
    ),
    # image_proc and depth_image_proc; also `room-layout play`
    "none": ("", "rgb/image_rect_color", "rgb/camera_info", "depth_registered/image_rect", ""),
}


def remappings(camera, camera_name=""):
    """Return (from, to) of the three inputs for a preset."""
    usual_name, color, info, depth, _ = PRESETS[camera]
    name = (camera_name or usual_name).strip("/")
    if camera == "azure_kinect":
        name = f"/{name}" if name else ""
    return [
        ("rgb/image_rect_color", color.format(camera=name)),
        ("rgb/camera_info", info.format(camera=name)),
        ("depth_registered/image_rect", depth.format(camera=name)),
    ]


def start(context):
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    share = get_package_share_directory("room_layout_ros")
    common = {
        "package": "room_layout_ros",
        "name": "estimator",
        "namespace": value["namespace"],
        "output": "screen",
        "parameters": [value["params_file"], {"use_sim_time": value["use_sim_time"].lower() == "true"}],
        "remappings": remappings(value["camera"], value["camera_name"]),
    }
    if value["lifecycle"].lower() == "true":
        nodes = [LifecycleNode(executable="lifecycle_estimator", **common)]
    else:
        nodes = [Node(executable="estimator", **common)]
    if value["rviz"].lower() == "true":
        view = os.path.join(share, "config", "estimator.rviz")  # noqa: PTH118
        own = f"/{value['namespace'].strip('/')}/estimator".replace("//", "/")
        renamed = [(f"/estimator/{topic}", f"{own}/{topic}") for topic in VIEWED]
        nodes.append(Node(package="rviz2", executable="rviz2", arguments=["-d", view], remappings=renamed))
    return nodes


VIEWED = ("overlay", "labels", "markers", "objects", "free_space", "obstacles", "floor", "scan")

ARGUMENTS = {
    "camera": ("none", "preset of topic names: " + ", ".join(PRESETS)),
    "camera_name": ("", "name of the camera in its topics, where it is not the driver's usual one"),
    "namespace": ("", "namespace of the node, for several cameras"),
    "params_file": ("", "parameters (default: config/estimator.yaml of the package)"),
    "use_sim_time": ("false", "time from /clock"),
    "lifecycle": ("false", "start the lifecycle node; it waits for configure and activate"),
    "rviz": ("false", "start RViz with the package's view"),
}


def generate_launch_description():
    share = get_package_share_directory("room_layout_ros")
    defaults = {"params_file": os.path.join(share, "config", "estimator.yaml")}  # noqa: PTH118
    declared = [
        DeclareLaunchArgument(
            name,
            default_value=defaults.get(name, default),
            description=meaning,
            choices=list(PRESETS) if name == "camera" else None,
        )
        for name, (default, meaning) in ARGUMENTS.items()
    ]
    profile = os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE") or os.path.join(share, "config", "fastdds.xml")  # noqa: PTH118
    return LaunchDescription(
        [*declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", profile), OpaqueFunction(function=start)]
    )
