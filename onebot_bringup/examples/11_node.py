"""A plain ROS node drives the robot of another process in a circle, and reports where it is.

Start `onebot_bringup` in one terminal. Run it with `python 11_node.py` in another; Ctrl-C ends it.
"""

from contextlib import suppress

import rclpy
from geometry_msgs.msg import Twist, Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node


class Circle(Node):
    """Commands 0.3 m/s forward and 0.3 rad/s to the left with each odometry."""

    def __init__(self):
        super().__init__("circle")
        self.commands = self.create_publisher(Twist, "velocity_controller/cmd_vel", 10)
        self.create_subscription(Odometry, "velocity_controller/odom", self.on_odometry, 10)

    def on_odometry(self, odometry):
        self.commands.publish(Twist(linear=Vector3(x=0.3), angular=Vector3(z=0.3)))
        at = odometry.pose.pose.position
        self.get_logger().info(f"at {at.x:.2f}, {at.y:.2f} m", throttle_duration_sec=1.0)


with suppress(KeyboardInterrupt):
    rclpy.init()
    rclpy.spin(Circle())
