"""Start the estimator on the topics of a known camera.

    ros2 launch room_layout_ros estimator.launch.py camera:=realsense
    ros2 launch room_layout_ros estimator.launch.py camera:=orbbec depth_registered:=false
    ros2 launch room_layout_ros estimator.launch.py camera:=none color_transport:=compressed rviz:=true

Two cameras: two_cameras.launch.py.
"""

import os
from typing import NamedTuple

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

from launch import LaunchDescription


class Preset(NamedTuple):
    """Names of a driver; {camera} is the argument camera_name, {prefix} the last part of it."""

    camera_name: str
    color: str
    camera_info: str
    aligned_depth: str
    """Depth in the view of the colour camera."""
    depth: str
    """Depth in its own view."""
    depth_info: str
    imu: str
    frame: str
    """Optical frame of the colour camera."""


PRESETS = {
    "realsense": Preset(
        "camera/camera",
        "/{camera}/color/image_raw",
        "/{camera}/color/camera_info",
        "/{camera}/aligned_depth_to_color/image_raw",
        "/{camera}/depth/image_rect_raw",
        "/{camera}/depth/camera_info",
        "/{camera}/imu",
        "{prefix}_color_optical_frame",
    ),
    "oak": Preset(
        "oak",
        "/{camera}/rgb/image_raw",
        "/{camera}/rgb/camera_info",
        "/{camera}/stereo/image_raw",
        "/{camera}/stereo/image_raw",
        "/{camera}/stereo/camera_info",
        "/{camera}/imu/data",
        "{prefix}_rgb_camera_optical_frame",
    ),
    "orbbec": Preset(
        "camera",
        "/{camera}/color/image_raw",
        "/{camera}/color/camera_info",
        "/{camera}/depth/image_raw",
        "/{camera}/depth/image_raw",
        "/{camera}/depth/camera_info",
        "/{camera}/gyro_accel/sample",
        "{prefix}_color_optical_frame",
    ),
    "azure_kinect": Preset(
        "",
        "/{camera}/rgb/image_raw",
        "/{camera}/rgb/camera_info",
        "/{camera}/depth_to_rgb/image_raw",
        "/{camera}/depth/image_raw",
        "/{camera}/depth/camera_info",
        "/{camera}/imu",
        "rgb_camera_link",
    ),
    "openni": Preset(
        "camera",
        "/{camera}/rgb/image_raw",
        "/{camera}/rgb/camera_info",
        "/{camera}/depth_registered/image_raw",
        "/{camera}/depth/image_raw",
        "/{camera}/depth/camera_info",
        "/{camera}/imu",
        "{prefix}_rgb_optical_frame",
    ),
    # image_proc and depth_image_proc; also `room-layout play`. Relative: they follow the namespace.
    "none": Preset(
        "",
        "rgb/image_rect_color",
        "rgb/camera_info",
        "depth_registered/image_rect",
        "depth/image_rect",
        "depth/camera_info",
        "imu",
        "camera",
    ),
}


def names(camera, camera_name=""):
    """Return the preset with its names filled in."""
    preset = PRESETS[camera]
    name = (camera_name or preset.camera_name).strip("/")
    filled = (part.format(camera=name, prefix=name.rpartition("/")[2]).replace("//", "/") for part in preset)
    return Preset(*filled)


def remappings(preset, depth_registered=True, imu=""):
    """Return (from, to) of every input."""
    return [
        ("rgb/image_rect_color", preset.color),
        ("rgb/camera_info", preset.camera_info),
        ("depth_registered/image_rect", preset.aligned_depth if depth_registered else preset.depth),
        ("depth/camera_info", preset.depth_info),
        ("imu", imu or preset.imu),
    ]


def start(context):
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    preset = names(value["camera"], value["camera_name"])
    registered = value["depth_registered"].lower() == "true"
    given = {name: value[name] for name in ("color_transport", "depth_transport", "floor_frame") if value[name]}
    clock = {"use_sim_time": value["use_sim_time"].lower() == "true"} if value["use_sim_time"] else {}
    common = {
        "package": "room_layout_ros",
        "name": value["node_name"],
        "namespace": value["namespace"],
        "output": "screen",
        "parameters": [value["params_file"], {"depth_registered": registered, **clock, **given}],
        "remappings": remappings(preset, registered, value["imu"]),
    }
    if value["lifecycle"].lower() == "true":
        nodes = [LifecycleNode(executable="lifecycle_estimator", **common)]
    else:
        nodes = [Node(executable="estimator", **common)]
    if value["rviz"].lower() == "true":
        nodes.append(rviz(value, value["fixed_frame"] or preset.frame, clock))
    return nodes


def rviz(value, fixed_frame, clock):
    view = os.path.join(get_package_share_directory("room_layout_ros"), "config", "estimator.rviz")  # noqa: PTH118
    own = f"/{value['namespace'].strip('/')}/{value['node_name']}".replace("//", "/")
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=value["namespace"],
        arguments=["-d", view, "-f", fixed_frame],
        parameters=[clock] if clock else [],
        remappings=[(f"/estimator/{topic}", f"{own}/{topic}") for topic in VIEWED],
    )


VIEWED = (
    *("overlay", "labels", "markers", "objects"),
    *("free_space", "obstacles", "floor", "scan", "room_outline", "floor_pose"),
)

ARGUMENTS = {
    "camera": ("none", "preset of topic names: " + ", ".join(PRESETS)),
    "camera_name": ("", "name of the camera in its topics, where it is not the driver's usual one"),
    "namespace": ("", "namespace of the node, for several cameras"),
    "node_name": ("estimator", "name of the node"),
    "params_file": ("", "parameters (default: config/estimator.yaml of the package)"),
    "depth_registered": (
        "true",
        "false: depth in its own view, registered here (docs/cameras.md); wins over params_file",
    ),
    "color_transport": ("", "raw or compressed (default: as params_file says)"),
    "depth_transport": ("", "raw, compressedDepth or compressed (default: as params_file says)"),
    "imu": ("", "topic of the IMU for pose_source imu, where it is not the driver's usual one"),
    "floor_frame": ("", "name of the frame on the floor (default: as params_file says)"),
    "use_sim_time": ("", "true: time from /clock (default: as params_file says)"),
    "lifecycle": ("false", "start the lifecycle node; it waits for configure and activate"),
    "rviz": ("false", "start RViz with the package's view"),
    "fixed_frame": ("", "RViz shows all in this frame (default: the optical frame of the preset's colour camera)"),
}

SWITCHES = ("depth_registered", "use_sim_time", "lifecycle", "rviz")
CHOICES = {"camera": list(PRESETS), **{name: ["true", "false", "True", "False"] for name in SWITCHES}}
CHOICES["use_sim_time"].append("")


def generate_launch_description():
    share = get_package_share_directory("room_layout_ros")
    defaults = {"params_file": os.path.join(share, "config", "estimator.yaml")}  # noqa: PTH118
    declared = [
        DeclareLaunchArgument(
            name, default_value=defaults.get(name, default), description=meaning, choices=CHOICES.get(name)
        )
        for name, (default, meaning) in ARGUMENTS.items()
    ]
    profile = os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE") or os.path.join(share, "config", "fastdds.xml")  # noqa: PTH118
    return LaunchDescription(
        [*declared, SetEnvironmentVariable("FASTRTPS_DEFAULT_PROFILES_FILE", profile), OpaqueFunction(function=start)]
    )
