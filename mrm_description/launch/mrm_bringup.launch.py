"""For ``ros2 launch mrm_description mrm_bringup.launch.py``: runs the script mrm_bringup."""

from launch import LaunchDescription

from mrm_description.launch import mrm_bringup
from onebot_bringup.launch.ros2_launch import launch_description


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments of the script, and run it with those given."""
    return launch_description(mrm_bringup)
