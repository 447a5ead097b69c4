"""Nodes with tf2 and filters of messages in lockstep, as the tutorials of ROS 2 write them."""

from collections.abc import Callable
from typing import Any

import message_filters
import pytest
import tf2_ros
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

import onebot_description  # noqa: F401  (finds the packages)
from onebot_control import Simulation
from onebot_control.nodes.lockstep import Lockstep


class Follower(Node):
    """Looks up the wheel at each scan's stamp, and pairs scans with odometry.

    It subscribes to the scan first: transforms come before it nevertheless.
    """

    def __init__(self, name: str = "follower", frame: str = "odom", **options: Any) -> None:
        super().__init__(name)
        self.frame = frame
        self.places: list[tuple[float, ...]] = []
        self.pairs: list[tuple[float, float]] = []
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)
        self.buffer = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.buffer, self, **options)
        scans = message_filters.Subscriber(
            self, LaserScan, "scan", qos_profile=qos_profile_sensor_data
        )
        odometry = message_filters.Subscriber(self, Odometry, "odom")
        self.both = message_filters.TimeSynchronizer([scans, odometry], 10)
        self.both.registerCallback(self.on_both)

    def on_scan(self, scan: LaserScan) -> None:
        for source in (scan.header.frame_id, "left_wheel"):
            found = self.buffer.lookup_transform(self.frame, source, scan.header.stamp)
            at, turn = found.transform.translation, found.transform.rotation
            self.places.append((at.x, at.y, turn.x, turn.y, turn.z, turn.w))

    def on_both(self, scan: LaserScan, odometry: Odometry) -> None:
        self.pairs.append((scan.ranges[0], odometry.pose.pose.position.x))


def run(ros: Lockstep[Simulation], *nodes: Node) -> None:
    ros.add(*nodes)
    ros.simulation.robot.drive(0.3, 0.4)
    ros.simulation.run(1.5)


@pytest.mark.usefixtures("ros_domain")
def test_a_transform_is_known_when_a_scan_asks_for_it() -> None:
    """Runs are bit-identical; a listener's own thread leaves the node to lockstep."""
    ends = []
    for options in ({}, {"spin_thread": True}):
        with Simulation(world="maze", y=0.8, sensors=True) as simulation:
            with simulation.ros(nav2_topics=True) as ros:
                node = Follower(**options)
                run(ros, node)
                places, pose = node.places, simulation.robot.odometry
        assert len(places) == 30 and len(node.pairs) == 15
        assert places[-2][0] != places[0][0] and places[-1] != places[1]
        assert abs(places[-2][0] - pose.x) < 0.2  # the lidar is on the robot
        ends.append((places, node.pairs))
    assert ends[0] == ends[1]


def test_a_robot_state_publisher_of_ones_own_is_the_only_one(
    ros_simulation: Callable[..., Lockstep[Simulation]],
) -> None:
    from onebot_description.robot_state_publisher import RobotStatePublisher

    ros = ros_simulation(world="maze", y=0.8, sensors=True, nav2_topics=True)
    own, node = RobotStatePublisher(ros.simulation.robot.description), Follower()
    run(ros, own, node)
    assert node.places and node.count_publishers("/robot_description") == 1


def test_a_listener_that_is_made_later(
    ros_simulation: Callable[..., Lockstep[Simulation]],
) -> None:
    """Also in a callback, and with a thread, of a node that is in lockstep already."""
    ros = ros_simulation(world="maze", y=0.8, sensors=True)
    node, made = Node("late"), list[tf2_ros.TransformListener]()
    buffer = tf2_ros.Buffer()

    def make() -> None:
        timer.cancel()
        made.append(tf2_ros.TransformListener(buffer, node, spin_thread=True))

    timer = node.create_timer(0.1, make)
    ros.add(node)
    assert node.count_publishers("/robot_description") == 0  # nobody listens to TF
    ros.simulation.run(0.5)
    latest = buffer.get_latest_common_time("odom", "left_wheel")
    assert latest.nanoseconds == pytest.approx(ros.simulation.time * 1e9, abs=2e7)
    made[0].executor.shutdown()
    made[0].dedicated_listener_thread.join(30.0)
