"""Runs the script onebot_bringup by ``ros2 launch onebot_bringup onebot_bringup.launch.py``."""

from launch import LaunchDescription

from onebot_bringup.launch import onebot_bringup
from onebot_bringup.launch.ros2_launch import launch_description


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments of the script, and run it with the given ones."""
    return launch_description(onebot_bringup)
