"""Tests a node, which has to stop half a meter before a wall, however far away it starts.

Run it with `pytest 06_test_stopper.py`. The fixture `ros_simulation` comes with the installation.
"""

import pytest
from geometry_msgs.msg import Twist, Vector3
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan


class Stopper(Node):
    def __init__(self) -> None:
        super().__init__("stopper")
        self.commands = self.create_publisher(Twist, "velocity_controller/cmd_vel", 10)
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)

    def on_scan(self, scan: LaserScan) -> None:
        speed = max(0.0, min(0.5, 0.8 * (scan.ranges[len(scan.ranges) // 2] - 0.5)))
        self.commands.publish(Twist(linear=Vector3(x=speed)))


@pytest.mark.parametrize("x", [0.0, 1.5])
def test_it_stops_before_the_wall(ros_simulation, x):
    ros = ros_simulation(world="maze", x=x, y=0.8, sensors=True)
    ros.add(Stopper())
    ros.simulation.run(10.0)
    assert ros.simulation.robot.distance_ahead() == pytest.approx(0.5, abs=0.1)
