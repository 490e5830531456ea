"""Two cameras of one kind: an estimator for each, in namespaces of their own. An example to copy and change.

    ros2 launch room_layout_ros two_cameras.launch.py camera:=realsense

Start each driver with a camera_name of its own, so that their topics and frames differ:

    ros2 launch realsense2_camera rs_launch.py camera_namespace:=left camera_name:=left_camera serial_no:=_1 \
        align_depth.enable:=true

Results are on /left/estimator/... and /right/estimator/..., the floor is in left_floor and right_floor.
"""

import os

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

SIDES = ("left", "right")


def estimator(side):
    """Return the estimator of one camera; a group, so that its arguments do not reach the other one."""
    file = os.path.join(get_package_share_directory("room_layout_ros"), "launch", "estimator.launch.py")  # noqa: PTH118
    arguments = {
        "camera": LaunchConfiguration("camera"),
        "camera_name": LaunchConfiguration(f"{side}_name"),
        "namespace": side,
        "floor_frame": f"{side}_floor",
    }
    return GroupAction(
        [IncludeLaunchDescription(PythonLaunchDescriptionSource(file), launch_arguments=arguments.items())]
    )


def generate_launch_description():
    camera = DeclareLaunchArgument("camera", default_value="realsense", description="preset, as estimator.launch.py")
    declared = [
        DeclareLaunchArgument(
            f"{side}_name",
            default_value=f"{side}/{side}_camera",
            description=f"name of the {side} camera in its topics",
        )
        for side in SIDES
    ]
    return LaunchDescription([camera, *declared, *map(estimator, SIDES)])
