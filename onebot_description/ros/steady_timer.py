"""Timers of nodes by the steady clock."""

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer


def steady_timer(node: Node, seconds: float, callback: Callable[[], object]) -> Timer:
    """Create a timer on the steady clock, because ROS time may stand still."""
    return node.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
