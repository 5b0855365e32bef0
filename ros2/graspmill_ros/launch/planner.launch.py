"""Starts the node: ros2 launch graspmill_ros planner.launch.py depth:=/camera/depth/image_rect_raw camera_info:=/camera/depth/camera_info"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

#: Topics of the node, and those of common drivers.
TOPICS = {
    "depth": "/camera/depth/image_rect_raw",
    "camera_info": "/camera/depth/camera_info",
    "mask": "/mask",
    "cloud": "/camera/depth/color/points",
}


def generate_launch_description() -> LaunchDescription:
    params = str(Path(get_package_share_directory("graspmill_ros")) / "config" / "params.yaml")
    arguments = {**TOPICS, "params": params}
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name, default_value=value) for name, value in arguments.items()),
            Node(
                package="graspmill_ros",
                executable="planner",
                name="graspmill_planner",
                output="screen",
                parameters=[LaunchConfiguration("params")],
                remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
            ),
        ]
    )
