"""A ROS node drives OneBot to x = 1 m in lockstep with the simulation: both runs are bit-identical.

Run it with `python 05_lockstep.py`. For a robot of `onebot_bringup`, call `rclpy.spin(Driver())`.
"""

from geometry_msgs.msg import Twist, Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node

from onebot_control import Simulation


class Driver(Node):
    """Commands a velocity for each odometry message."""

    def __init__(self) -> None:
        super().__init__("driver")
        self.commands = self.create_publisher(Twist, "velocity_controller/cmd_vel", 10)
        self.create_subscription(Odometry, "velocity_controller/odom", self.on_odometry, 10)

    def on_odometry(self, odometry: Odometry) -> None:
        speed = min(0.5, 0.8 * (1.0 - odometry.pose.pose.position.x))
        self.commands.publish(Twist(linear=Vector3(x=speed)))


for _ in range(2):
    with Simulation() as simulation, simulation.ros() as ros:
        ros.add(Driver())  # returns when its topics are connected
        simulation.run(8.0)
        print(f"at {simulation.time:g} s: x = {simulation.robot.pose.x} m")
