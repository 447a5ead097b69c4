"""Conventions of ros2_control's controllers: names of their nodes and frames. No ROS here."""

from typing import NamedTuple

# The usual names of the nodes with parameters of controllers.
DRIVE_CONTROLLER = "velocity_controller"
BROADCASTER = "joint_state_broadcaster"
MANAGER = "controller_manager"
DEFAULT_JOINT_CONTROLLER = "joint_trajectory_controller"

# The corners of a mecanum drive, in the order in which its wheels are named.
CORNERS = "front_left", "front_right", "rear_right", "rear_left"

IN_EACH_CYCLE = "every controller runs in each control cycle"  # why a parameter has no effect
WORLD_FRAME = "world"  # the default of the parameter world_frame_id


def prefixed(frame: str, enabled: bool, prefix: str, namespace: str) -> str:
    """Return the name of a frame with diff_drive_controller's prefix.

    Args:
        frame: the name without prefix.
        enabled: the parameter tf_frame_prefix_enable.
        prefix: the parameter tf_frame_prefix; if empty or "~", the namespace is the prefix.
        namespace: the node's namespace.
    """
    if not enabled:
        return frame
    words = (namespace if prefix in ("", "~") else prefix).removesuffix("/").removeprefix("/")
    return f"{words}/{frame}" if words else frame


def namespace_prefix(namespace: str) -> str:
    """Return the default frame prefix of a namespace: "robot1/" for "/robot1"."""
    return prefixed("", True, "", namespace)


class DriveNode(NamedTuple):
    """The node of a drive, as named in control files."""

    name: str = DRIVE_CONTROLLER
    command: str = "cmd_vel"  # its topic of commands
    odometry: str = "odom"
