"""For ``ros2 launch mrm_description mrm_bringup.launch.py``: runs the script mrm_bringup."""

from launch import LaunchDescription

from mrm_description.launch import mrm_bringup
from onebot_bringup.launch.ros2_launch import launch_description


def generate_launch_description() -> LaunchDescription:
    """Declare the script's arguments, and run it with the given values."""
    return launch_description(mrm_bringup)
