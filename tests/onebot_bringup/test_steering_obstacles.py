"""How far the robot that is steered can go until it meets what its sensors see."""

import math
from pathlib import Path

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan, Range

from onebot_bringup.steering.obstacles import Footprint, Readings, described
from onebot_description.geometry.quaternions import from_rpy, to_matrix
from tests.onebot_bringup.steering_support import steered
from tests.onebot_control.control_support import CASTER, SEPARATION, urdf, wheel
from tests.onebot_control.test_sensor_topics import HALF, room
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for

ROBOT = """<robot name="box">
  <link name="base"><visual><geometry><box size="0.4 0.2 0.1"/></geometry></visual></link>
  <link name="lidar"/>
  <joint name="mount" type="fixed"><parent link="base"/><child link="lidar"/></joint>
</robot>"""


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, *, pitch: float = 0.0, yaw: float = 0.0):
    """The pose (4, 4) of a sensor."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = to_matrix(from_rpy((0.0, pitch, yaw))), (x, y, z)
    return pose


def scan(angle: float, *ranges: float) -> Readings:
    """What a scanner sees, a ray each 0.1 rad."""
    message = LaserScan(angle_min=angle, angle_increment=0.1, range_max=9.0, ranges=ranges)
    return Readings.from_scan(message)


@pytest.fixture
def footprint() -> Footprint:
    return Footprint.from_description(described(ROBOT))


@pytest.mark.parametrize(
    ("point", "linear", "angular", "clearance"),
    [
        ((1.0, 0.05), 0.3, 0.0, 0.8),
        ((1.0, 0.05), -0.3, 0.0, math.inf),  # it goes the other way
        ((-1.0, 0.05), -0.3, 0.0, 0.8),
        ((1.0, 0.15), 0.3, 0.0, math.inf),  # it passes
        ((1.0, 1.0), 0.5, 0.5, math.pi / 2 - 0.2),  # a quarter of a circle of 1 m
        ((1.0, -1.0), 0.5, -0.5, math.pi / 2 - 0.2),
        ((1.0, 0.05), 0.5, 0.5, math.inf),  # it turns away
        ((0.1, 0.0), 0.3, 0.0, math.inf),  # a part of itself
    ],
)
def test_how_far_the_robot_can_go(footprint, point, linear, angular, clearance):
    """By a scanner that looks backwards."""
    seen = 0.1 - point[0], -point[1]  # by the scanner
    rays = scan(math.atan2(*reversed(seen)), math.hypot(*seen), math.inf, math.nan)
    points = footprint.obstacles(rays, at(0.1, 0.0, 0.0, yaw=math.pi))
    assert footprint.clearance(points, linear, angular) == pytest.approx(clearance, abs=1e-5)


@pytest.mark.parametrize(
    ("place", "distance", "counts"),
    [
        (at(0.21, z=0.02, pitch=math.pi / 2), 0.07, False),  # a cliff sensor, on the ground
        (at(0.21, z=0.02, pitch=math.pi / 2), 0.5, False),  # and over an edge
        (at(0.2, z=0.1, pitch=0.3), 0.15 / math.sin(0.3) - 0.01, False),  # a tilted scanner
        (at(0.2, z=0.1, pitch=0.3), 0.2, True),  # it sees a box before that
        (at(0.2, z=-0.04), 1.0, True),  # a level scanner, one cm above the ground
        (at(0.2, z=0.5), 1.0, True),  # on a mast
        (at(0.2, z=0.1, pitch=-0.5), 1.0, False),  # the ceiling
    ],
)
def test_the_ground_and_the_ceiling_are_no_obstacles(footprint, place, distance, counts):
    """What stands in the way is, at whatever height its sensor is."""
    assert bool(len(footprint.obstacles(scan(0.0, distance), place))) is counts


def test_a_range_has_what_it_met_anywhere_on_its_cone(footprint):
    """A sonar, and a detector of a fixed distance (REP-117); +inf and nan say nothing."""
    message = Range(field_of_view=0.4, min_range=0.1, max_range=2.0, range=1.0)
    beside = at(0.2, 0.25)  # its axis passes the robot's side, its cone does not
    points = footprint.obstacles(Readings.from_range(message), beside)
    assert footprint.clearance(points, 0.3, 0.0) == pytest.approx(math.cos(0.2), abs=1e-6)
    message.field_of_view = 0.1
    points = footprint.obstacles(Readings.from_range(message), beside)
    assert footprint.clearance(points, 0.3, 0.0) == math.inf
    for nothing in (math.inf, math.nan, 0.05, 2.1):
        message.range = nothing
        assert not len(Readings.from_range(message).ranges)
    message.range, message.min_range = -math.inf, 2.0
    assert set(Readings.from_range(message).ranges) == {2.0}


def test_frames_have_the_prefix_of_the_robot(footprint):
    """The root's is found by the frame of any link; a description may be no robot."""
    assert footprint.root_frame("base") == "base"
    assert footprint.root_frame("robot1/lidar") == "robot1/base"
    assert described("<robot") is None
    assert Footprint.from_description(described('<robot name="x"><link name="a"/></robot>')) is None


def sensor(topic: str, kind: str, place: str, rays: int, half: float) -> str:
    """A link at a place, and a sensor of Gazebo classic there."""
    return f"""
  <link name="{topic}_link"/>
  <joint name="{topic}_joint" type="fixed"><parent link="base_link"/><child link="{topic}_link"/>
    <origin {place}/></joint>
  <gazebo reference="{topic}_link"><sensor type="ray" name="{topic}"><update_rate>10</update_rate>
    <ray><scan><horizontal><samples>{rays}</samples><min_angle>{-half}</min_angle>
      <max_angle>{half}</max_angle></horizontal></scan>
      <range><min>0.02</min><max>10</max></range></ray>
    <plugin name="{topic}_plugin" filename="libgazebo_ros_ray_sensor.so">
      <ros><remapping>~/out:={topic}</remapping></ros>
      <output_type>sensor_msgs/{kind}</output_type></plugin></sensor></gazebo>"""


FRONT = sensor("scan", "LaserScan", 'xyz="0 0 0.1"', 61, 0.7)
REAR = 'xyz="0 0 0.1" rpy="0 0 3.141592653589793"'
CLIFF = sensor("cliff", "LaserScan", 'xyz="0.08 0 0.02" rpy="0 1.5707963267948966 0"', 1, 0.01)


@pytest.mark.parametrize(
    ("sensors", "speed"),
    [
        pytest.param(sensor("b_scan", "LaserScan", REAR, 61, 0.7), 0.3, id="the front scanner"),
        pytest.param(sensor("sonar", "Range", REAR, 5, 0.1), -0.3, id="a sonar at the rear"),
    ],
)
def test_every_sensor_counts_in_the_direction_driven(
    peer: Peer, tmp_path: Path, sensors: str, speed: float
) -> None:
    """In a room, on the wire: the way to the wall, until the robot pushes it.

    A cliff sensor sees the ground, which is no obstacle.
    """
    sides = SEPARATION / 2
    model = str(tmp_path / "bot.urdf")
    robot = urdf(wheel("left", sides), wheel("right", -sides), CASTER, FRONT, sensors, CLIFF)
    Path(model).write_text(robot)
    simulated = ros_args(world=room(tmp_path), sensor_noise=False)
    footprint = Footprint.from_description(described(robot))
    reach = footprint.high[0] if speed > 0.0 else -footprint.low[0]
    with (
        NodeProcess("onebot_description.robot_state_publisher", model),
        NodeProcess("onebot_control.velocity_controller", model, *simulated),
        steered() as (_, page),
    ):
        truth = peer.hear(Odometry, "/velocity_controller/ground_truth")

        def gap() -> float:
            x = truth[-1].pose.pose.position.x
            return float(HALF - math.copysign(1.0, speed) * x - reach)

        def told() -> float:
            obstacle = page.state["obstacle"]
            return math.inf if obstacle is None else obstacle

        def tells(most: float) -> bool:
            return gap() < most and abs(told() - gap()) < 0.15

        wait_for(lambda: truth and page.state["listeners"] == 1, "the robot")
        page.hold(speed)
        wait_for(lambda: tells(1.6), "the way to the wall")
        wait_for(lambda: tells(0.7), "less of it")
        wait_for(lambda: gap() < 0.02, "the robot to push the wall")
        wait_for(lambda: told() < 0.1, "the wall")
        page.let_go()
