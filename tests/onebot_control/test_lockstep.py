"""Nodes in lockstep with a Simulation behave in the same way each time, at any speed."""

from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image, JointState, LaserScan
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage

from onebot_control import OneBotError, Simulation
from onebot_control.nodes.lockstep import Lockstep
from onebot_description.ros.topic_qos import LATCHED
from tests.onebot_control.arm_support import ArmClient, goal, point
from tests.onebot_control.node_support import NODE, Stepped

COMMANDS = "velocity_controller/cmd_vel"
MAZE = {"world": "maze", "x": 1.3, "y": 0.8, "sensors": True, "seed": 3}

pytestmark = pytest.mark.usefixtures("ros_domain")


class Stopper(Node):
    """Drives ahead, and stops half a meter before what it sees."""

    def __init__(self) -> None:
        super().__init__("stopper")
        self.scans: list[LaserScan] = []
        self.speed = -1.0
        self.commands = self.create_publisher(Twist, COMMANDS, 10)
        self.create_subscription(LaserScan, "scan", self.on_scan, qos_profile_sensor_data)

    def on_scan(self, scan: LaserScan) -> None:
        self.scans.append(scan)
        self.command(min(scan.ranges[175:186]) - 0.5)

    def command(self, room: float) -> None:
        self.speed = min(0.5, 0.8 * room) if room > 0.1 else 0.0
        command = Twist()
        command.linear.x = self.speed
        self.commands.publish(command)


class TimedStopper(Stopper):
    """Commands by a timer of 20 Hz on simulated time."""

    def __init__(self) -> None:
        super().__init__()
        self.room, self.ticks = 0.0, 0
        self.create_timer(0.05, self.tick)

    def on_scan(self, scan: LaserScan) -> None:
        self.room = min(scan.ranges[175:186]) - 0.5

    def tick(self) -> None:
        self.ticks += 1
        self.command(self.room)


def stopped(make: Callable[[], Stopper]) -> tuple[Any, ...]:
    """Where and when a robot stops, and what it has seen."""
    with Simulation(**MAZE) as simulation, simulation.ros() as ros:
        robot, node = simulation.robot, make()
        ros.add(node)
        simulation.run(until=lambda: node.speed == 0.0 and robot.twist.linear < 1e-4, timeout=30.0)
        assert 2.1 < robot.pose.x < 2.4
        seen = [tuple(scan.ranges) for scan in node.scans]
        return simulation.time, robot.pose, robot.odometry, seen


@pytest.mark.parametrize("make", [Stopper, TimedStopper], ids=["by scans", "by a timer"])
def test_a_node_stops_at_the_same_place_each_time(make: Callable[[], Stopper]) -> None:
    assert stopped(make) == stopped(make)


def test_each_measurement_that_is_due_is_published() -> None:
    """At 10 Hz from the first cycle on; it is what the robot measures then in Python."""
    with Simulation(**MAZE) as simulation, simulation.ros() as ros:
        node, robot = Stopper(), simulation.robot
        node.commands = node.create_publisher(Twist, "unused", 10)
        ros.add(node)
        measured = []
        for _ in range(20):
            measured.append(robot.scan().ranges.tolist())
            simulation.run(0.1)
        assert [scan.ranges.tolist() for scan in node.scans] == measured
        stamps = [scan.header.stamp.sec + 1e-9 * scan.header.stamp.nanosec for scan in node.scans]
        assert stamps == pytest.approx([0.01 + 0.1 * count for count in range(20)], abs=1e-9)


def test_a_coroutine_may_await_what_takes_simulated_time(
    ros_simulation: Callable[..., Lockstep[Simulation]],
) -> None:
    """An action's result, as rclpy's users await it in a timer."""
    ros = ros_simulation("package://mrm_description/urdf/mrm.xacro")
    client, ended = ArmClient(), list[tuple[float, int]]()

    async def move() -> None:
        timer.cancel()
        handle = await client.action.send_goal_async(goal(point(1.0, 0.3)))
        answer = await handle.get_result_async()
        ended.append((ros.simulation.time, answer.result.error_code))

    timer = client.create_timer(0.5, move, ReentrantCallbackGroup())
    ros.add(client)
    ros.simulation.run(2.0)
    [(time, code)] = ended
    assert code == 0 and time == pytest.approx(1.5, abs=0.1)


def test_topics_and_services_are_those_of_the_controller() -> None:
    with Simulation() as simulation, simulation.ros() as ros:
        stepped, robot = Stepped(ros), simulation.robot
        joints = stepped.hear(JointState, "joint_states")
        odom, tf = stepped.hear(Odometry, f"{NODE}/odom"), stepped.hear(TFMessage, "/tf")
        robot.drive(0.5)
        simulation.run(1.0)
        assert (len(joints), len(odom)) == (100, 50)
        # That of the odometry, and since somebody listens, of robot_state_publisher.
        children = {one.child_frame_id for message in tf for one in message.transforms}
        assert {"base_link", "left_wheel"} <= children
        assert stepped.call(Trigger, f"{NODE}/reset_odometry").success
        assert robot.odometry.x == 0.0 < robot.pose.x
        refused = stepped.call(SetBool, f"{NODE}/pause", data=True)
        assert not refused.success and "Simulation.run" in refused.message
        with pytest.raises(OneBotError, match="time cannot go back"):
            simulation.reset()
        with pytest.raises(OneBotError, match="already"):
            simulation.ros()
    assert not rclpy.ok()


def test_what_cannot_be_connected_is_named() -> None:
    """Another QoS as the node is added, another type where the topic is created."""
    with Simulation(**MAZE) as simulation, simulation.ros() as ros:
        node = Node("listener")
        node.create_subscription(JointState, "joint_states", print, LATCHED)
        with pytest.raises(OneBotError, match="not connected with the robot: /joint_states.*QoS"):
            ros.add(node)
        with pytest.raises(
            OneBotError, match='"listener" uses /scan as .*/Image, but .*/LaserScan'
        ):
            node.create_subscription(Image, "scan", print, 10)
