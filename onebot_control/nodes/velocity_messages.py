"""Velocity commands as messages: a Twist or a TwistStamped."""

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node

TWIST = "geometry_msgs/msg/Twist"
VELOCITY_TYPES: Mapping[str, Any] = {TWIST: Twist, "geometry_msgs/msg/TwistStamped": TwistStamped}
"""The message classes, by type name."""


def velocity_message(node: Node, kind: str, linear: float, lateral: float, angular: float) -> Any:
    """Return a command, stamped now if its type has a stamp.

    Args:
        node: its clock is used for the stamp.
        kind: one of VELOCITY_TYPES.
        linear: velocity forward, m/s.
        lateral: velocity to the left, m/s.
        angular: angular velocity to the left, rad/s.
    """
    message = VELOCITY_TYPES[kind]()
    if isinstance(message, TwistStamped):
        message.header.stamp = node.get_clock().now().to_msg()
    twist = twist_of(message)
    twist.linear.x, twist.linear.y, twist.angular.z = float(linear), float(lateral), float(angular)
    return message


def twist_of(message: Any) -> Twist:
    """Return the Twist in either message type."""
    return message.twist if isinstance(message, TwistStamped) else message
